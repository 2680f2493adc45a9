"""Boards that the frame cuts: which corners they show; boards of another size; and photos of boards only in part, calibrated."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.calibration.board_setups import SIX_BOARDS, floor_corners, places_of, views_of
from orthomill.schemas.raster import Window
from orthomill.tasks.calibration.detection.board_photographs import PhotoCorners, photo_corners
from orthomill.tasks.calibration.solving.arranging import arrangement_of, found_boards
from orthomill.tasks.calibration.solving.solving import CalibrationTarget
from orthomill.tasks.geometry.view import View
from orthomill.tasks.simulation.boards.board_rendering import BoardFilm, photograph_floor
from orthomill.tasks.simulation.boards.board_scene import BoardType

CAMERA = SIX_BOARDS.camera.model_copy(update={"width": 900, "height": 600}).changed(c=760.0, x0=2.0, y0=1.0, k1=-0.1, k2=0.03)
SETUP = replace(SIX_BOARDS, camera=CAMERA, boards=1, photos=8, board=BoardType((9, 6), 0.03, 0.03), seed=5, back=1.3)


def aside(view: View, right: float, up: float, nearer: float = 0.0) -> View:
    """The view shifted sideways, m in its own axes."""
    return replace(view, centre=view.centre + view.rotation.T @ np.array([right, up, -nearer]))


def search_of(view: View, corners: tuple[int, int] = (9, 6), boards: int = 1, exact: bool = True) -> PhotoCorners:
    window = Window(0, 0, CAMERA.height, CAMERA.width)
    image = photograph_floor(view, places_of(SETUP), SETUP.board, BoardFilm(0.6, 2.0), window)
    return photo_corners(image[:, :, None], "p", corners, boards, exact)


def misses(view: View, found) -> np.ndarray:
    """px between corners and the true places of those numbers."""
    true = view.project(floor_corners(places_of(SETUP), SETUP.board)[0]).reshape(6, 9, 2)
    return np.linalg.norm(true[found.row, found.column] - found.pixels, axis=1)


@pytest.mark.parametrize(("right", "up"), [(0.2, 0.0), (-0.2, 0.0), (0.0, 0.12), (0.0, -0.12)])
@pytest.mark.parametrize("photo", [2, 5])
def test_a_board_cut_on_one_side_keeps_the_numbers_of_its_corners(photo, right, up):
    view = aside(views_of(SETUP)[photo], right, up)
    outcome = search_of(view)
    search, found = outcome.search, outcome.corners
    assert (search.boards, search.cut, search.unnumbered) == (0, 1, 0)
    assert 15 <= len(found) < 54 and misses(view, found).max() < 0.3


def test_a_part_that_can_be_any_is_used_alone_and_only_of_exact_boards():
    view = aside(views_of(SETUP)[0], 0.0, 0.0, nearer=0.33)
    outcome = search_of(view)
    assert outcome.search.cut == 1 and len(outcome.corners) >= 12
    assert search_of(view, exact=False).search.unnumbered == 1 and len(search_of(view, exact=False).corners) == 0


@pytest.mark.parametrize("stated", [(10, 7), (8, 5), (7, 6), (12, 9)])
def test_the_true_number_of_corners_is_reported(stated):
    outcome = search_of(views_of(SETUP)[2], stated)
    assert len(outcome.corners) == 0 and outcome.search.other == ((9, 6),)


def test_one_board_is_calibrated_from_photos_that_cut_it():
    generator = np.random.default_rng(1)
    views = [aside(view, *generator.uniform(-0.15, 0.15, 2)) for view in views_of(SETUP)]
    outcomes = [search_of(view) for view in views]
    assert sum(outcome.search.cut for outcome in outcomes) >= 4
    target = CalibrationTarget((CAMERA.width, CAMERA.height), (9, 6), 0.03, 1)
    result = arrangement_of(found_boards(tuple(outcome.corners for outcome in outcomes), target), target).result
    sigma = np.sqrt(np.diag(result.interior_covariance))[:5]
    assert len(result.state.rotation) == 8 and result.sigma0 < 0.05
    assert (np.abs(result.state.interior[:5] - CAMERA.interior[:5]) < 4 * sigma).all()
