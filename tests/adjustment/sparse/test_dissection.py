"""Nested dissection: a valid elimination tree on any pattern, and small fronts on blocks as they are flown."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array

from orthomill.tasks.adjustment.sparse.block_matrix import pattern_of
from orthomill.tasks.adjustment.sparse.dissection import LEAF, dissected

NONE = np.zeros(0, np.int64)


def pattern_of_pairs(pairs, groups):
    pairs = np.asarray(pairs).reshape(-1, 2)
    cliques = csr_array((np.ones(pairs.size), pairs.ravel(), 2 * np.arange(len(pairs) + 1)), shape=(len(pairs), groups))
    return pattern_of(6 * np.arange(groups + 1), cliques)


def grid(rows, per):
    """Photographs in strips; neighbours along and across share points."""
    number = np.arange(rows * per).reshape(rows, per)
    along = np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()])
    return pattern_of_pairs(np.vstack([along, np.column_stack([number[:-1].ravel(), number[1:].ravel()])]), rows * per)


def filled(pattern, fronts):
    """The neighbours of every front by symbolic elimination, one group after the other."""
    groups = len(pattern.start) - 1
    near = [set() for _ in range(groups)]
    for g, h in zip(pattern.rows, pattern.partner, strict=True):
        if g != h:
            near[g].add(int(h))
            near[h].add(int(g))
    out = []
    for front in fronts:
        own = set(front.own.tolist())
        boundary = set().union(*(near[g] for g in own)) - own if own else set()
        for g in boundary:
            near[g] = (near[g] | boundary) - own - {g}
        out.append(boundary)
    return out


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), photos=st.integers(1, 60), others=st.integers(0, 4), links=st.integers(0, 120))
def test_any_pattern_gives_a_valid_elimination_tree(seed, photos, others, links):
    rng = np.random.default_rng(seed)
    pattern = pattern_of_pairs(rng.integers(0, photos + others, (links, 2)), photos + others)
    last = np.unique(rng.integers(0, photos, rng.integers(0, 3)))
    fronts = dissected(pattern, photos, last)
    assert sorted(np.concatenate([front.own for front in fronts])) == list(range(photos + others))
    assert [front.parent for front in fronts].count(-1) == 1 and fronts[-1].parent == -1
    assert all(front.parent > number for number, front in enumerate(fronts[:-1]))
    assert set(last) <= set(fronts[-1].own)
    for front, expected in zip(fronts, filled(pattern, fronts), strict=True):
        assert expected <= set(front.boundary.tolist()), "elimination fills nothing outside the fronts"
        if front.parent >= 0:
            parent = fronts[front.parent]
            assert set(front.boundary) <= set(parent.own) | set(parent.boundary), "a front contributes to its parent only"


def test_a_small_block_is_one_front():
    fronts = dissected(grid(3, 4), LEAF, NONE)
    assert len(fronts) == 1 and len(fronts[0].own) == LEAF and not len(fronts[0].boundary)


def test_a_strip_is_cut_by_single_photographs():
    fronts = dissected(grid(1, 200), 200, NONE)
    sizes = [len(front.own) for front in fronts]
    assert max(sizes) <= LEAF and max(len(front.own) + len(front.boundary) for front in fronts) <= LEAF + 2
    assert sizes.count(1) >= 15


@pytest.mark.parametrize("side", [12, 20])
def test_fronts_of_a_square_block_grow_with_its_side_only(side):
    fronts = dissected(grid(side, side), side * side, NONE)
    # Separators of a square grid are its diagonals at most; the largest front sees four of them.
    assert max(len(front.own) for front in fronts) <= 2 * side
    assert max(len(front.own) + len(front.boundary) for front in fronts) <= 5 * side


def test_parts_without_common_points_have_no_separator():
    pairs = [(i, i + 1) for i in range(29)] + [(i, i + 1) for i in range(30, 59)]
    fronts = dissected(pattern_of_pairs(pairs, 60), 60, NONE)
    assert not len(fronts[-1].own), "nothing separates what is not connected"
    for front in fronts:
        sides = {int(g) // 30 for g in np.concatenate([front.own, front.boundary])}
        assert len(sides) <= 1


def test_the_camera_of_the_whole_block_is_eliminated_last():
    photos = 40
    pairs = [(i, i + 1) for i in range(photos - 1)] + [(i, photos) for i in range(photos)]
    fronts = dissected(pattern_of_pairs(pairs, photos + 1), photos, NONE)
    assert photos in fronts[-1].own


def test_a_camera_of_few_photographs_is_eliminated_with_them():
    photos = 120
    pairs = [(i, i + 1) for i in range(photos - 1)] + [(i, photos) for i in range(3)]
    fronts = dissected(pattern_of_pairs(pairs, photos + 1), photos, NONE)
    number = next(k for k, front in enumerate(fronts) if photos in front.own)
    assert number < len(fronts) - 1 and {0, 1, 2} & set(fronts[number].own.tolist())
