"""Votes of depth maps in a cell, and the heights that are elected."""

import numpy as np
import pytest

from orthomill.tasks.densification.canopy.votes import MOST, cast, elected, smoothed


def cells(*heights: float) -> tuple[np.ndarray, np.ndarray]:
    votes, count = np.zeros((MOST, 1, 1), np.float32), np.zeros((1, 1), np.uint8)
    for height in heights:
        cast(votes, count, np.array([[0.0], [0.0], [height]]), 0.4, np.empty((1, 1), np.float32))
    return votes, count


@pytest.mark.parametrize(
    ("heights", "height"),
    [
        ((10.0, 10.5, 11.0, 3.0), 10.5),
        ((3.0, 3.2, 3.4, 10.0, 10.5, 11.0), 10.5),
        ((3.0, 3.1, 3.2, 3.3, 10.0, 10.5, 11.0), 3.15),
        ((10.0, 10.5, 3.0), np.nan),
        ((10.0, 11.4, 12.8), 11.4),
        ((), np.nan),
    ],
)
def test_the_largest_group_wins_and_of_two_the_higher(heights, height):
    assert elected(*cells(*heights), 1.5)[0, 0] == pytest.approx(height, nan_ok=True)


def test_no_more_maps_vote_than_there_is_room_for():
    votes, count = cells(*([5.0] * MOST + [50.0] * MOST))
    assert count[0, 0] == MOST and elected(votes, count, 1.5)[0, 0] == 5


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
