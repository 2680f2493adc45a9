"""The last job of a calibration from chessboards: its results agree with each other and with the adjustment."""

import inspect

import numpy as np
import pytest
from board_corners import corner_table, easy_arrangement, easy_calibration, easy_tables, everything_named

from orthomill.schemas.errors import PhotoError, WorkflowError
from orthomill.schemas.photo import Header, Photo, Photos
from orthomill.tasks.adjustment.boards.board_network import PARAMETERS
from orthomill.tasks.calibration import chessboards
from orthomill.tasks.calibration.board_tables import Prediction
from orthomill.tasks.calibration.chessboards import Model, calibration_record, camera_of, index_board_photos, residual_table
from orthomill.tasks.calibration.report.chessboard_calibration import CalibrationProducts, from_chessboards
from orthomill.tasks.calibration.solving.lens_models import MODELS, with_affinity

FIVE = Model(MODELS[0].free)


def photo(name: str, **changes) -> Photo:
    width, height = easy_tables()[0].size
    facts = {"name": name, "path": f"{name}.jpg", "width": width, "height": height, "bands": 3, "dtype": "uint8", "camera": "cam"}
    return Photo(**{**facts, **changes})


@pytest.fixture(scope="module")
def calibrated() -> CalibrationProducts:
    """EASY from its tables, with five parameters, run alone."""
    photos, corners, searches = easy_tables()
    return from_chessboards(photos, everything_named(photos, 3), corners, (), searches, easy_arrangement()[0], FIVE)


def test_photographs_of_one_size_are_indexed_by_unique_names():
    headers = [Header(path=path, width=8, height=6, bands=3, dtype="uint8") for path in ("a/1.jpg", "b/1.jpg", "b/2.jpg")]
    photos = index_board_photos(tuple(headers))
    assert photos.size == (8, 6) and photos.names == ("a_1", "b_1", "2")
    with pytest.raises(PhotoError, match=r"a/1\.jpg has 8 x 6 pixels, but not c\.jpg"):
        index_board_photos((*headers, Header(path="c.jpg", width=6, height=8, bands=3, dtype="uint8")))


def test_the_results_are_the_writes_of_the_job_and_agree_with_each_other(calibrated):
    assert calibrated._fields == tuple(inspect.get_annotations(CalibrationProducts))
    assert calibrated.cameras.cameras == {"chessboards": calibrated.camera} and calibrated.cameras.of_photo == {}
    assert calibrated.calibration.camera == calibrated.camera and calibrated.calibration.sigma0 == calibrated.camera.sigma0
    assert repr(calibrated.camera.c) in calibrated.colmap.text and "standard_errors" in calibrated.opencv.text
    assert all(page.text for page in (calibrated.opensfm, calibrated.agisoft))
    figures = {figure.name: figure.value for figure in calibrated.report.figures}
    assert figures["board_photos"] == 8 and figures["boards"] == 24 and figures["c"] == round(calibrated.camera.c, 3)


def test_parameters_that_are_not_asked_for_are_zero_and_fixed(calibrated):
    assert (calibrated.camera.lens.k3, calibrated.camera.lens.p1, calibrated.camera.lens.p2) == (0.0, 0.0, 0.0)
    covariance = np.array(calibrated.camera.covariance)
    assert (np.diag(covariance)[:5] > 0).all() and (covariance[5:] == 0).all()


def test_without_a_stated_model_the_held_out_photographs_choose(monkeypatch):
    photos, corners, _ = easy_tables()
    real = chessboards.choice
    # Among all models that one, at first; then, as ever, the one of square pixels if it is as good.
    monkeypatch.setattr(chessboards, "choice", lambda checks: real(checks) if len(checks) == 2 else with_affinity(MODELS[1]))
    target = easy_arrangement()[0]
    result = chessboards.calibrate(everything_named(photos, 3), corners, (), target, Model(None)).result
    assert (
        result.network.free == MODELS[1].free and result.state.interior[5] == 0.0 and abs(result.state.interior[6] - 0.002) < 5e-4
    )


def test_the_record_holds_every_photograph_and_board_with_its_precision(calibrated):
    record, (photos, _, _) = calibrated.calibration, easy_tables()
    assert record.parameters == PARAMETERS and len(record.values) == len(record.covariance) == 17
    assert tuple(own.name for own in record.photographs) == photos.names and [own.name for own in record.boards] == [
        "board 1",
        "board 2",
        "board 3",
    ]
    assert record.boards[0].place == (0.0, 0.0, 0.0) and record.boards[0].place_sigma == (0.0, 0.0, 0.0)
    assert all(max(own.place_sigma) < 0.01 and max(own.angles_sigma) < 1.0 for own in record.photographs)


def test_residuals_are_in_pixels_of_the_photograph(calibrated):
    target, result = easy_calibration()
    residuals, names = residual_table(result, list(easy_tables()[0].names), target), easy_tables()[0].names
    assert len(residuals) == len(result.corners) and set(residuals.photo) == set(names)
    assert residuals.dx == pytest.approx(result.residual[:, 0]) and residuals.dy == pytest.approx(-result.residual[:, 1])
    assert np.array_equal(residuals.row * 6 + residuals.column, result.corners.corner)
    computed = np.column_stack([residuals.x - residuals.dx, residuals.y - residuals.dy])
    assert np.abs(target.centred(computed) - (result.corners.xy - result.residual)).max() < 1e-9


def test_the_camera_has_the_covariance_of_its_parameters():
    target, result = easy_calibration()
    camera = camera_of(result, "x", target.size)
    assert camera.interior == tuple(result.state.interior) and camera.source == "chessboards"
    assert np.array(camera.covariance) == pytest.approx(result.interior_covariance)
    record = calibration_record(result, camera, list(easy_tables()[0].names), None, target)
    assert record.held_out is None and record.redundancy == result.redundancy


def test_corners_of_the_second_search_are_added_and_do_not_replace_the_first():
    photos = easy_tables()[0]
    target, known = easy_arrangement()
    arranged = everything_named(photos, 3)
    own = arranged.photos[0].model_copy(update={"predictions": (Prediction(board=0, pixels=((0.0, 0.0),)),)})
    arranged = arranged.model_copy(update={"photos": (own, *arranged.photos[1:])})
    few = known.start.corners.take(~((known.start.corners.photo == 0) & (known.start.corners.board == 2)))
    second = corner_table([0, 2], [0, 5], [0, 4], [(1.0, 2.0), (3.0, 4.0)])
    merged = chessboards._with_completed(few, arranged, (second,), known.start.photo, target)
    assert len(merged) == len(few) + 1
    new = merged.take((merged.photo == 0) & (merged.board == 2))
    assert new.corner.tolist() == [29] and target.pixels(new.xy).tolist() == [[3.0, 4.0]]


def served(*photos: Photo, serves: str) -> CalibrationProducts:
    tables, corners, searches = easy_tables()
    return from_chessboards(
        tables, everything_named(tables, 3), corners, (), searches, easy_arrangement()[0], FIVE, Photos(photos=photos), serves
    )


def test_the_calibrated_camera_serves_the_photographs_that_match():
    outcome = served(photo("a"), photo("b", camera="other", focal_mm=4.0, pixel_um=2.0), serves="a*")
    assert outcome.cameras.of("a").source == "chessboards" and outcome.cameras.of("b").c == 2000.0
    assert any("nominal" in text for text in outcome.report.warnings)
    with pytest.raises(WorkflowError, match=r"No photograph matches 'z\*'"):
        served(photo("a"), serves="z*")
    with pytest.raises(PhotoError, match=r"b \(4912 x 4912\)"):
        served(photo("b", height=4912), serves="*")
