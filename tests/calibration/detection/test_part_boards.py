"""Numbering, refusal and parts of drawn boards: what the search makes of a candidate."""

import numpy as np
import pytest
from drawn_boards import corner_grid, drawn, homography_of
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.calibration.board_tables import Arranged, ArrangedPhoto, Prediction
from orthomill.tasks.calibration.detection.board_detection import (
    Refusal,
    _refusal,
    board_grid,
    grey_image,
    numbered,
    paint_over,
    pyramid,
    regular,
    through_levels,
)
from orthomill.tasks.calibration.detection.board_photographs import corners_of_boards, overview_level, to_overview
from orthomill.tasks.calibration.detection.cut_boards import _offsets, find_cut_boards
from orthomill.tasks.calibration.detection.saddles import crossings, spacings
from orthomill.tasks.calibration.detection.second_search import complete_corners, near_predictions

SIZE = (6, 5)
H = homography_of(22.0, 0.0, (60.0, 150.0)) @ np.diag([1.0, -1.0, 1.0])
"""y of the board upwards, so that its numbering is counter-clockwise in an upright photo."""
BOARD, GRID = drawn(H, SIZE, (210, 240)), corner_grid(H, SIZE)


@pytest.mark.parametrize("angle", [0.0, 50.0, 140.0, -100.0])
def test_every_way_to_list_the_corners_is_numbered_alike(angle):
    turned = homography_of(20.0, angle, (110.0, 110.0)) @ np.diag([1.0, -1.0, 1.0])
    turned = turned @ np.array([[1.0, 0.0, -2.5], [0.0, 1.0, -2.0], [0.0, 0.0, 1.0]])
    image, truth = drawn(turned, SIZE, (220, 220)), corner_grid(turned, SIZE)
    for listed in (truth, truth[::-1], truth[:, ::-1], truth[::-1, ::-1]):
        assert np.array_equal(numbered(image, listed), truth)


def test_a_board_is_accepted_and_a_part_of_it_is_a_larger_one():
    assert _refusal(BOARD, GRID) is None
    assert _refusal(BOARD, GRID[:, :4]) is Refusal.LARGER and _refusal(BOARD, GRID[:3]) is Refusal.LARGER


@pytest.mark.parametrize("wrong", ["shifted", "flat", "low contrast", "bent", "twice as wide"])
def test_other_candidates_are_no_boards(wrong):
    image, grid = BOARD, GRID
    if wrong == "shifted":
        grid = GRID + 11.0
    elif wrong == "flat":
        image = np.full_like(BOARD, 90)
    elif wrong == "low contrast":
        image = (100 + (BOARD > 128) * 3).astype(np.uint8)
    elif wrong == "bent":
        grid = GRID.copy()
        grid[2] += 12.0
    else:
        grid = GRID[:, ::2]
    assert _refusal(image, grid) is Refusal.NO_BOARD


def test_perspective_is_regular_and_a_missed_row_is_not():
    tilted = corner_grid(homography_of(22.0, 10.0, (50.0, 50.0), (0.02, 0.01)), SIZE)
    assert regular(tilted) and not regular(np.delete(tilted, 2, axis=0))


@settings(deadline=None, max_examples=20)
@given(count=st.integers(1, 6), of=st.integers(1, 6), before=st.booleans(), behind=st.booleans())
def test_a_part_begins_where_its_ends_allow(count, of, before, behind):
    offsets = _offsets(count, of, before, behind)
    assert all(0 <= first <= of - count for first in offsets)
    if before:
        assert offsets in ([], [0])
    if behind and offsets:
        assert offsets == [of - count]
    if not before and not behind:
        assert len(offsets) == max(of - count + 1, 0)


@pytest.mark.parametrize(
    ("frame", "rows", "cols"),
    [
        (np.s_[:, :165], slice(0, 5), slice(0, 4)),
        (np.s_[:, 95:], slice(0, 5), slice(2, 6)),
        (np.s_[:125, :], slice(2, 5), slice(0, 6)),
        (np.s_[95:, :], slice(0, 3), slice(0, 6)),
    ],
)
def test_a_drawn_board_cut_on_one_side_keeps_its_numbers(frame, rows, cols):
    image = np.ascontiguousarray(BOARD[frame])
    shift = [frame[1].start or 0, frame[0].start or 0]
    found = find_cut_boards([image], np.empty((0, 5, 6, 2)), SIZE, alone=False)
    assert len(found.corners) == 1 and found.unnumbered == 0 and found.other == ()
    known = np.isfinite(found.corners[0]).all(axis=-1)
    assert known[rows, cols].all() and known.sum() <= known[rows, cols].size + 6
    assert np.abs(found.corners[0][known] + shift - GRID[known]).max() < 0.3


def test_a_part_without_an_end_is_used_only_alone_and_a_board_of_another_size_never():
    inside = np.ascontiguousarray(drawn(homography_of(22.0, 0.0, (-60.0, -60.0)), (12, 11), (140, 150)))
    none = np.empty((0, 11, 12, 2))
    assert find_cut_boards([inside], none, (12, 11), alone=False).unnumbered == 1
    used = find_cut_boards([inside], none, (12, 11), alone=True)
    assert used.unnumbered == 0 and len(used.corners) == 1 and np.isfinite(used.corners).all(axis=-1).sum() >= 12
    other = find_cut_boards([BOARD], np.empty((0, 6, 9, 2)), (9, 6), alone=True)
    assert other.other == ((6, 5),) and len(other.corners) == 0


def test_noise_and_whole_boards_give_no_parts():
    noise = np.random.default_rng(0).integers(0, 255, (120, 160)).astype(np.uint8)
    assert len(find_cut_boards([noise], np.empty((0, 5, 6, 2)), SIZE, alone=True).corners) == 0
    found = find_cut_boards([BOARD], GRID[None], SIZE, alone=True)
    assert len(found.corners) == 0 and found.other == (), "the board that is known is painted over"


def test_painting_over_leaves_no_corner():
    image = BOARD.copy()
    paint_over(image, GRID)
    middle = GRID.reshape(-1, 2).round().astype(int)
    assert len(np.unique(image[middle[:, 1], middle[:, 0]])) == 1


def test_predicted_corners_are_found_where_they_are_and_hidden_ones_are_not():
    image = BOARD.copy()
    image[80:110, 95:135] = 128
    points, good = near_predictions(image, GRID + np.array([1.3, -0.8]))
    hidden = (GRID[..., 0] > 93) & (GRID[..., 0] < 137) & (GRID[..., 1] > 78) & (GRID[..., 1] < 112)
    assert hidden.sum() == 4 and not good[hidden].any() and good.sum() >= 20
    assert np.abs(points[good] - GRID[good]).max() < 0.1


def test_a_prediction_that_is_far_off_or_inverted_finds_nothing():
    assert not near_predictions(BOARD, GRID + 9.0)[1].any()
    assert not near_predictions(255 - BOARD, GRID)[1].any(), "squares of the wrong colour"


def test_predictions_of_a_wrong_lens_are_corrected_from_corner_to_corner_and_nothing_else_is_found():
    column, row = np.meshgrid(np.arange(6), np.arange(5))
    wrong = GRID + np.stack([0.5 * column**2, 0.4 * row * column], axis=-1)
    points, good = near_predictions(BOARD, wrong)
    assert np.abs(wrong - GRID).max() > 10 and good.sum() >= 26
    assert np.abs(points[good] - GRID[good]).max() < 0.1


def test_edges_and_squares_are_no_corners_however_near_they_are_predicted():
    across, down = spacings(GRID)
    assert (crossings(BOARD, GRID, across, down)[1] > 0.75).all()
    for step in (0.5 * across, 0.5 * down, 0.5 * (across + down), 0.25 * (across + down)):
        assert (crossings(BOARD, GRID[:-1, :-1] + step[:-1, :-1], across[:-1, :-1], down[:-1, :-1])[1] < 0.4).all()


def test_the_second_search_lists_the_corners_of_its_predictions():
    outside = GRID.copy()
    outside[:, 5] = np.nan
    near, far = (tuple(map(tuple, grid.reshape(-1, 2).tolist())) for grid in (outside, GRID + 9.0))
    predicted = (Prediction(board=3, pixels=near), Prediction(board=1, pixels=far))
    arranged = Arranged(boards=4, photos=(ArrangedPhoto(photo="p", names=(), certain=True, predictions=predicted),))
    found = complete_corners(BOARD[:, :, None], arranged, "p", SIZE)
    assert set(found.board) == {3} and set(found.column) <= set(range(5)) and len(found) == 25
    assert found.pixels == pytest.approx(GRID[found.row, found.column], abs=0.1)


def test_corners_of_boards_are_listed_without_unknown_ones():
    part = GRID.copy()
    part[0, 0] = np.nan
    table = corners_of_boards(np.array([GRID, part]))
    assert len(table) == 59 and np.bincount(table.board).tolist() == [30, 29]
    assert (table.board.dtype, table.column.dtype, table.x.dtype) == (np.int32, np.int32, np.float64)
    assert table.pixels[:30] == pytest.approx(GRID.reshape(-1, 2))


def test_overviews_are_halved_until_they_fit():
    assert [overview_level((width, 800)) for width in (1100, 1101, 2200, 2202, 5472)] == [0, 1, 1, 2, 3]
    # The centre of the first pixel of a level is that of the 2 x 2 pixels above.
    assert to_overview(np.array([0.5, 0.5]), (2000, 800)) == pytest.approx([0.0, 0.0])


def test_pyramids_halve_and_corners_come_back_through_them():
    levels = pyramid(BOARD, 120)
    assert [level.shape for level in levels] == [(210, 240), (105, 120)]
    coarse = (GRID - 0.5) / 2.0 + 0.3
    assert np.abs(through_levels(coarse, levels, 1) - GRID).max() < 0.1
    assert np.abs(through_levels(GRID + 0.4, levels, 0) - GRID).max() < 0.1


def test_sixteen_bits_become_eight_without_losing_contrast():
    wide = np.repeat((BOARD.astype(np.uint16) * 20)[:, :, None], 3, axis=2)
    grey = grey_image(wide)
    assert grey.dtype == np.uint8 and grey.shape == BOARD.shape and np.ptp(grey) > 200


def test_the_grid_of_a_board_is_listed_row_by_row():
    assert board_grid((3, 2)).tolist() == [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]]
