"""Cross-validation, refusals and correlations of a calibration on simulated corners."""

from dataclasses import replace

import numpy as np
import pytest
from board_corners import EASY, corners_of, easy_calibration

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.calibration.board_tables import BoardPhotos, Corners, PhotoSearch
from orthomill.tasks.calibration.solving.arranging import arrange, arrangement_of
from orthomill.tasks.calibration.solving.calibration_precision import correlations
from orthomill.tasks.calibration.solving.lens_models import MODELS
from orthomill.tasks.calibration.solving.model_choice import choice, compare, held_out


@pytest.fixture(scope="module")
def solved():
    return easy_calibration()


def test_held_out_photographs_choose_the_model_that_made_them(solved):
    target, result = solved
    checks = {model: one.check for model, one in compare(result, result.corners, target, MODELS).items()}
    assert choice(checks) in (MODELS[1], MODELS[3])
    assert checks[MODELS[1]].rms < 0.9 * checks[MODELS[0]].rms
    assert checks[MODELS[1]].rms == pytest.approx(0.3 * np.sqrt(2), rel=0.1)
    assert checks[MODELS[1]].worst[1] < 4.0


def test_too_few_photographs_are_refused_or_not_checked(solved):
    target, _ = solved
    found = corners_of(replace(EASY, photos=4))[1]
    assert held_out(arrangement_of(found, target).result) is None
    with pytest.raises(GeometryError, match="Only 2 photographs"):
        arrangement_of(found[:2], target)


def test_no_boards_at_all_say_what_was_found(solved):
    nothing = Corners(*(np.empty(0, kind) for kind in ("int32", "int32", "int32", float, float)))
    photos = BoardPhotos(paths=("a.jpg", "b.jpg"), size=solved[0].size)
    searches = tuple(PhotoSearch(photo=n, boards=0, larger=1, blur=None, overexposed=0.0) for n in "ab")
    with pytest.raises(GeometryError, match=r"Of 2 photographs 0 show boards with 6 x 5.*2 have more corners"):
        arrange(photos, (nothing, nothing), searches, solved[0])


def test_correlations_with_the_places_of_boards_are_low(solved):
    table = correlations(solved[1])
    in_plane = table.typical[:3, [table.columns.index(name) for name in ("tX", "tY", "theta")]]
    assert in_plane.max() < 0.3
    assert table.typical.max() <= 1.0 + 1e-9 and (table.largest >= table.typical - 1e-12).all()
