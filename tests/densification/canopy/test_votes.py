"""Votes of depth maps in a cell, and the heights that are elected."""

import numpy as np
import pytest

from orthomill.tasks.densification.canopy.votes import MOST, cast, elected, group, smoothed


def cells(*heights: float) -> tuple[np.ndarray, np.ndarray]:
    votes, count = np.zeros((MOST, 1, 1), np.float32), np.zeros((1, 1), np.uint8)
    for height in heights:
        cast(votes, count, np.array([[0.0], [0.0], [height]]), 0.4, np.empty((1, 1), np.float32))
    return votes, count


def grouped(*heights: float) -> list[float]:
    votes, count = cells(*heights)
    group(votes, count, 1.5)
    return votes[: count[0, 0], 0, 0].tolist()


@pytest.mark.parametrize(
    ("heights", "means"),
    [
        ((10.0, 10.5, 11.0, 3.0), [10.5]),
        ((3.0, 3.25, 3.5, 10.0, 10.5, 11.0), [10.5, 3.25]),
        ((10.0, 10.5, 3.0), []),
        ((10.0, 11.5, 13.0), [11.5]),
        ((10.0, 11.0, 12.0, 13.0), [12.0, 11.0]),
        ((), []),
    ],
)
def test_maps_that_differ_by_no_more_than_leaves_are_a_group(heights, means):
    assert grouped(*heights) == pytest.approx(means)


@pytest.mark.parametrize(
    ("ends", "goes_on", "height"), [((3, 5), (2, 0), 20.0), ((3, 5), (3, 0), 5.0), ((3, 5), (4, 4), 5.0), ((0, 0), (0, 1), np.nan)]
)
def test_the_uppermost_group_at_which_more_lines_end_than_go_on_is_the_surface(ends, goes_on, height):
    groups, count = np.zeros((MOST, 1, 1), np.float32), np.full((1, 1), 2, np.uint8)
    groups[:2, 0, 0] = 20.0, 5.0
    lines = np.zeros((2, MOST, 1, 1), np.uint8)
    lines[0, :2, 0, 0], lines[1, :2, 0, 0] = ends, goes_on
    assert elected(groups, count, lines)[0, 0] == pytest.approx(height, nan_ok=True)


def test_no_more_maps_vote_than_there_is_room_for():
    assert grouped(*([5.0] * MOST + [50.0] * MOST)) == [5.0]


def test_a_map_votes_once_in_every_cell_that_its_pixels_cover():
    votes, count = np.zeros((MOST, 7, 9), np.float32), np.zeros((7, 9), np.uint8)
    places = np.array([[4.2, 5.0, 100.0, np.nan], [3.0, 3.0, 3.0, 3.0], [2.0, 8.0, 9.0, 9.0]])
    cast(votes, count, places, 1.5, np.empty((7, 9), np.float32))
    row, col = np.indices((7, 9))
    rows = np.abs(row - 3) <= 1
    assert (count == (rows & (col >= 3) & (col <= 6))).all()
    assert (votes[0][rows & (col >= 4) & (col <= 6)] == 8).all() and (votes[0][rows & (col == 3)] == 2).all()


def test_medians_close_small_gaps_only():
    heights = np.full((20, 20), 5.0, np.float32)
    heights[4, 4] = 50
    heights[6, 6] = np.nan
    heights[:, 12:] = np.nan
    found = smoothed(heights, 2)
    assert (found[:, :11] == 5).all() and np.isnan(found[:, 14:]).all()
