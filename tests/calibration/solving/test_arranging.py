"""From corners to identified boards: tables, predictions of missed boards, and messages."""

import numpy as np
import pytest
from board_corners import EASY, corner_table, easy_arrangement, easy_tables

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.calibration.board_tables import Corners, PhotoSearch
from orthomill.tasks.calibration.solving.arranging import _seen, arrange, found_boards, undistorted
from orthomill.tasks.calibration.solving.solving import CalibrationTarget
from orthomill.tasks.geometry.distortion import image_to_pixel

TARGET = CalibrationTarget((800, 600), (4, 3), 0.05)


def test_tables_of_corners_become_boards_with_unknown_corners_nan():
    (boards,) = found_boards((corner_table([0, 1, 1], [1, 0, 3], [2, 0, 1], [(399.5, 299.5), (0, 0), (410.0, 290.0)]),), TARGET)
    assert boards.shape == (2, 12, 2) and np.isfinite(boards).all(axis=-1).sum() == 3
    assert boards[0, 2 * 4 + 1].tolist() == [0.0, 0.0] and boards[1, 4 + 3] == pytest.approx([10.5, 9.5])
    (none,) = found_boards((corner_table([], [], [], []),), TARGET)
    assert none.shape == (0, 12, 2)


def test_undistorted_coordinates_are_those_that_the_lens_images_there():
    camera = EASY.camera
    target = CalibrationTarget((camera.width, camera.height), (6, 5), 0.05)
    ideal = np.array([[300.0, -200.0], [-900.0, 700.0], [np.nan, np.nan]])
    xy = np.full((3, 2), np.nan)
    xy[:2] = target.centred(image_to_pixel(camera, ideal[:2]))
    found = undistorted(xy, np.array(camera.interior))
    assert found[:2] == pytest.approx(ideal[:2], abs=1e-6) and np.isnan(found[2]).all()


def test_a_board_that_one_photo_lacks_is_predicted_where_it_is():
    photos, corners, searches = easy_tables()
    target, _ = easy_arrangement()
    lost = corners[2].take(corners[2].board != 1)
    lost = Corners(lost.board - (lost.board > 1), lost.column, lost.row, lost.x, lost.y)
    arranged = arrange(photos, (*corners[:2], lost, *corners[3:]), searches, target)
    assert arranged.boards == 3 and arranged.incomplete == (photos.names[2],)
    (prediction,) = arranged.photos[2].predictions
    truth = corners[2].take(corners[2].board == 1)
    assert np.array(prediction.pixels) == pytest.approx(truth.pixels, abs=5.0), "without the tangential distortion"
    assert len(arranged.photos[2].names) == 2 and prediction.board not in arranged.photos[2].names
    assert arranged.photos[2].certain


def test_a_photo_with_a_single_board_predicts_no_others():
    photos, corners, searches = easy_tables()
    alone = corners[4].take(corners[4].board == 0)
    arranged = arrange(photos, (*corners[:4], alone, *corners[5:]), searches, easy_arrangement()[0])
    own = arranged.photos[4]
    assert own.names == (0,) and not own.certain and own.predictions == ()


def search(**changes) -> PhotoSearch:
    return PhotoSearch(**{"photo": "a", "boards": 1, "blur": 1.0, "overexposed": 0.0, **changes})


@pytest.mark.parametrize(
    ("searches", "words"),
    [
        ((search(boards=2), search(boards=0)), "Of 2 photographs 1 show boards with 4 x 3 inner corners, 2 whole boards in all."),
        ((search(cut=2), search(boards=0, cut=1)), "1 whole boards and 3 cut ones in all."),
        ((search(boards=0, other=((9, 6), (9, 6))),), "boards with 9 x 6 inner corners were seen in 1 photographs"),
        ((search(boards=0, larger=3),), "3 have more corners than that."),
    ],
)
def test_a_failure_says_what_the_search_found(searches, words):
    assert words in _seen(searches, TARGET)


def test_boards_that_determine_nothing_are_refused_with_what_was_found():
    photos, corners, searches = easy_tables()
    nothing = corner_table([], [], [], [])
    with pytest.raises(GeometryError, match=r"Only 2 photographs show.*\(Of 8 photographs 8 show boards"):
        arrange(photos, (*corners[:2], *[nothing] * 6), searches, easy_arrangement()[0])
