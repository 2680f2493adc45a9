"""Heights of many pairs over one cell: what is near the reference enters, the most precise stay."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from village_pair import stack_of

from orthomill.tasks.densification.gridding import HeightCells
from orthomill.tasks.densification.height_stack import SLOTS, HeightStack


def cell_of(height: float, sigma: float = 0.1) -> HeightCells:
    return HeightCells(np.array([[height]]), np.array([[sigma]], np.float32))


def kept(stack) -> list[float]:
    return sorted(stack.height[np.isfinite(stack.height)].tolist())


def test_only_heights_near_the_reference_enter():
    assert kept(stack_of(*map(cell_of, (8.9, 9.1, 10.0, 11.0, 11.1)), reference=10.0, tolerance=1.0)) == [9.1, 10.0, 11.0]


def test_without_a_reference_every_height_enters():
    assert kept(stack_of(cell_of(-40.0), cell_of(7.0), reference=np.nan, tolerance=1.0)) == [-40.0, 7.0]


def test_a_single_wrong_reference_does_not_keep_a_right_height_out():
    reference = np.full((9, 9), 10.0)
    reference[4, 4], reference[:, 7:] = 14.0, 20.0
    stack = HeightStack.over(reference, np.full((9, 9), 1.0, np.float32))
    stack.add(HeightCells(np.full((9, 9), 10.5), np.full((9, 9), 0.1, np.float32)))
    assert np.isfinite(stack.height[0, :, :6]).all(), "the references around the wrong one tell"
    assert np.isnan(stack.height[0, :, 7:]).all(), "on the roof, even at its edge, they are the roof's"
    row, col = np.indices((9, 9))
    assert np.array_equal(stack.near(row, col, np.full((9, 9), 10.5)), np.isfinite(stack.height[0]))


def test_near_unknown_references_only_the_own_one_counts():
    reference = np.full((9, 9), 10.0)
    reference[4, 4], reference[3, 3] = 14.0, np.nan
    stack = HeightStack.over(reference, np.full((9, 9), 1.0, np.float32))
    stack.add(HeightCells(np.full((9, 9), 10.5), np.full((9, 9), 0.1, np.float32)))
    assert np.isnan(stack.height[0, 4, 4]) and np.isfinite(stack.height[0, 3, 3])


def test_pairs_without_a_height_take_no_slot():
    assert kept(stack_of(*[cell_of(np.nan)] * 30, cell_of(5.0))) == [5.0]


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(1, 1000), min_size=1, max_size=3 * SLOTS, unique=True))
def test_the_most_precise_heights_stay_in_any_order(sigmas):
    stack = stack_of(*(cell_of(float(s), s * 1e-3) for s in sigmas))
    assert kept(stack) == sorted(map(float, sigmas))[:SLOTS]


def test_of_equal_standard_errors_the_first_stay():
    assert kept(stack_of(*(cell_of(float(k)) for k in range(2 * SLOTS)))) == list(map(float, range(SLOTS)))


@pytest.mark.parametrize("count", [1, 3])
def test_cells_do_not_mix(count):
    pairs = [HeightCells(np.arange(6.0).reshape(2, 3) + k, np.full((2, 3), 0.1, np.float32)) for k in range(count)]
    stack = stack_of(*pairs)
    for k in range(count):
        assert np.array_equal(stack.height[k], pairs[k].height)
