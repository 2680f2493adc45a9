"""The two surfaces at a wall: planes that are continued, and where there are none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.colouring.edges.wall_surfaces import FEWEST, REACH, at_pixels, wall_surfaces

CELL = 0.5
SHAPE = (40, 40)
ROW, COL = np.mgrid[:40, :40].astype(float)


def step(upper: float = 8.0, slope: float = 0.0) -> np.ndarray:
    """Ground on a slope (m per cell to the right), and a roof of constant height above it from column 20 on."""
    return (slope * COL + np.where(COL >= 20, upper, 0.0)).astype(np.float32)


def blurred(heights: np.ndarray, width: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Heights with a ramp over 2 `width` cells at the wall, and which cells are measured: all but the ramp."""
    out, measured = heights.copy(), np.ones(SHAPE, bool)
    for k in range(-width, width):
        share = (k + width + 0.5) / (2 * width)
        out[:, 20 + k] = (1 - share) * heights[:, 19 - width] + share * heights[:, 20 + width]
        measured[:, 20 + k] = False
    return out, measured


def plane_by_numpy(heights: np.ndarray, smooth: np.ndarray, row: int, col: int, above: bool) -> np.ndarray:
    """Weighted least squares with np.linalg.lstsq through the heights of one side of 4 m."""
    near = (np.abs(ROW - row) <= REACH) & (np.abs(COL - col) <= REACH) & smooth & ((heights > 4.0) == above)
    right, down = COL[near] - col, ROW[near] - row
    weight = 1.0 / (2.0 + right**2 + down**2)
    weight /= weight.sum()
    z = heights[near].astype(float)
    mean = (weight * z).sum()
    design = np.column_stack([np.ones_like(right), right, down]) * np.sqrt(weight)[:, None]
    # The ridge: a slope costs half a cell squared.
    design = np.vstack([design, [0, np.sqrt(0.5), 0], [0, 0, np.sqrt(0.5)]])
    found = np.linalg.lstsq(design, np.concatenate([np.sqrt(weight) * (z - mean), [0, 0]]), rcond=None)[0]
    return found + np.array([mean, 0, 0])


def test_both_surfaces_are_continued_into_the_blur():
    heights, measured = blurred(step())
    found = wall_surfaces(heights, measured, CELL)
    np.testing.assert_allclose(found.upper[10:30, 17:23], np.broadcast_to([8.0, 0, 0], (20, 6, 3)), atol=1e-5)
    np.testing.assert_allclose(found.lower[10:30, 17:23], np.zeros((20, 6, 3)), atol=1e-5)
    assert found.doubtful[:, 18:22].all() and not found.doubtful[:, :14].any() and not found.doubtful[:, 26:].any()


def test_planes_agree_with_numpy():
    rng = np.random.default_rng(5)
    heights = step(slope=0.05) + rng.normal(0, 0.05, SHAPE).astype(np.float32)
    heights, measured = blurred(heights)
    found = wall_surfaces(heights, measured, CELL)
    smooth = np.abs(COL - 19.5) > 2
    np.testing.assert_array_equal(found.smooth, smooth)
    for row, col in ((12, 18), (20, 21), (0, 19), (39, 20)):
        np.testing.assert_allclose(found.upper[row, col], plane_by_numpy(heights, smooth, row, col, True), atol=1e-4)
        np.testing.assert_allclose(found.lower[row, col], plane_by_numpy(heights, smooth, row, col, False), atol=1e-4)


@pytest.mark.parametrize("heights", [step(0.9), step(0.0, 0.9), np.random.default_rng(1).uniform(0, 9, SHAPE).astype(np.float32)])
def test_without_a_wall_between_planes_there_are_no_two_surfaces(heights):
    """A low step, a steep slope, and rubble."""
    found = wall_surfaces(heights, np.ones(SHAPE, bool), CELL)
    assert np.isnan(found.upper).all() and np.isnan(found.lower).all() and not found.doubtful.any()


@pytest.mark.parametrize("measured", [True, False])
def test_a_surface_needs_some_smooth_cells_measured_or_not(measured):
    heights, codes = np.zeros(SHAPE, np.float32), np.full(SHAPE, measured)
    heights[20:24, 20 : 20 + FEWEST // 2 + 1] = 8.0
    assert not np.isfinite(wall_surfaces(heights, codes, CELL).upper).any()
    heights[20:24, 20 : 20 + FEWEST // 2 + 2] = 8.0
    assert np.isfinite(wall_surfaces(heights, codes, CELL).upper).any()


def test_a_cell_is_certain_when_everything_around_it_is_measured_and_smooth():
    heights, measured = blurred(step())
    measured[30, 5] = False
    found = wall_surfaces(heights, measured, CELL)
    assert found.smooth[30, 5] and not found.certain[30, 4] and found.certain[30, 3]
    assert not found.certain[0].any(), "beyond the edge of the model nothing is measured"


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6), row=st.integers(8, 16), col=st.integers(8, 16))
def test_a_part_gives_what_the_whole_gives(seed, row, col):
    rng = np.random.default_rng(seed)
    heights = (8.0 * (rng.random((8, 8)) < 0.4)).repeat(5, 0).repeat(5, 1).astype(np.float32)
    measured = rng.random(SHAPE) < 0.9
    whole = wall_surfaces(heights, measured, CELL)
    part = np.s_[row - REACH - 1 : row + 12 + REACH + 1, col - REACH - 1 : col + 12 + REACH + 1]
    own = wall_surfaces(np.ascontiguousarray(heights[part]), np.ascontiguousarray(measured[part]), CELL)
    inner, place = np.s_[REACH + 1 : REACH + 13, REACH + 1 : REACH + 13], np.s_[row : row + 12, col : col + 12]
    for name in ("upper", "lower", "smooth", "certain"):
        np.testing.assert_array_equal(getattr(own, name)[inner], getattr(whole, name)[place], err_msg=name)


@pytest.mark.parametrize("divisor", [1, 2, 3])
def test_pixels_lie_on_the_plane_of_their_cell(divisor):
    planes = np.stack([np.arange(6.0).reshape(2, 3), np.full((2, 3), 0.6), np.full((2, 3), -0.3)], -1).astype(np.float32)
    found = at_pixels(planes, divisor)
    for r in range(2 * divisor):
        for c in range(3 * divisor):
            height, right, down = planes[r // divisor, c // divisor]
            x, y = (c % divisor + 0.5) / divisor - 0.5, (r % divisor + 0.5) / divisor - 0.5
            assert found[r, c] == pytest.approx(height + right * x + down * y, abs=1e-5)


@pytest.mark.parametrize("tallest", [6.0, 12.0, 200.0])
def test_the_widest_gap_divides_terraces_however_tall(tallest):
    """Terraces of about two heights: the upper surface lies above the widest gap with enough cells on either side."""
    rng = np.random.default_rng(int(tallest))
    level = rng.permutation(np.arange(9) % 2).reshape(3, 3) * tallest + rng.uniform(0, 0.3, (3, 3))
    heights = np.kron(level, np.ones((14, 14)))[:40, :40].astype(np.float32)
    found = wall_surfaces(heights, np.ones(SHAPE, bool), CELL)
    divided = 0
    for row in range(0, 40, 3):
        for col in range(0, 40, 3):
            near = np.sort(heights[(np.abs(ROW - row) <= REACH) & (np.abs(COL - col) <= REACH) & found.smooth].astype(float))
            gaps = np.diff(near)[FEWEST - 1 : len(near) - FEWEST]
            if not len(gaps) or gaps.max() < 2 * CELL or not np.isfinite(found.upper[row, col, 0]):
                continue
            at = int(gaps.argmax()) + FEWEST
            lower, upper = near[:at], near[at:]
            # A plane through nearly level heights, continued to the cell, stays near them.
            assert lower.min() - 0.5 <= found.lower[row, col, 0] <= lower.max() + 0.5
            assert upper.min() - 0.5 <= found.upper[row, col, 0] <= upper.max() + 0.5
            divided += 1
    assert divided > 5
