"""Judgement, advice and files of a calibration."""

import json
from dataclasses import replace
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from orthomill.schemas.camera import Camera
from orthomill.schemas.errors import GeometryError
from orthomill.tasks.calibration.board_tables import BoardPhotos, Corners, PhotoSearch
from orthomill.tasks.calibration.cameras.camera_exchange import agisoft_xml, colmap_cameras, opencv_yaml, opensfm_camera
from orthomill.tasks.calibration.reporting.advice import geometry, geometry_warnings, result_warnings, search_warnings
from orthomill.tasks.calibration.solving.arranging import arrange, arrangement_of
from orthomill.tasks.calibration.solving.calibration_precision import correlations
from orthomill.tasks.calibration.solving.chessboards import camera_of
from orthomill.tasks.calibration.solving.model_choice import MODELS, HeldOut, choice, compare, held_out
from orthomill.tasks.calibration.solving.solving import CalibrationTarget, solve
from orthomill.tasks.geometry.distortion import image_to_pixel
from orthomill.tasks.simulation.boards.board_scene import SIX_BOARDS, BoardSetup, floor_corners, places_of, views_of

LENS = SIX_BOARDS.camera.model_copy(update={"p1": 0.002, "p2": -0.001})
EASY = replace(SIX_BOARDS, boards=3, photos=8, camera=LENS)


def corners(setup: BoardSetup, noise: float = 0.3) -> tuple[CalibrationTarget, list[np.ndarray]]:
    generator = np.random.default_rng(1)
    target = CalibrationTarget((setup.camera.width, setup.camera.height), setup.board.corners, setup.board.square, setup.boards)
    floor = floor_corners(places_of(setup), setup.board)
    pixels = [np.array([view.project(board) for board in floor]) for view in views_of(setup)]
    return target, [target.centred(own + generator.normal(0, noise, own.shape)) for own in pixels]


@pytest.fixture(scope="module")
def solved():
    target, found = corners(EASY)
    known = arrangement_of(found, target)
    return target, solve(target, (known.result.state,), known.start.corners, MODELS[3])


def test_held_out_photographs_choose_the_model_that_made_them(solved):
    target, result = solved
    judged = compare(result, target)
    assert choice(judged) in (MODELS[1], MODELS[3])
    assert judged[MODELS[1]].rms < 0.9 * judged[MODELS[0]].rms
    assert judged[MODELS[1]].rms == pytest.approx(0.3 * np.sqrt(2), rel=0.1)
    assert judged[MODELS[1]].worst[1] < 4.0
    assert choice(dict.fromkeys(MODELS)) == MODELS[0]


def test_too_few_photographs_are_refused_or_not_judged(solved):
    target, _ = solved
    few = replace(EASY, photos=4)
    known = arrangement_of(corners(few)[1], target)
    assert held_out(known.result, target, MODELS[0]) is None
    with pytest.raises(GeometryError, match="Only 2 photographs"):
        arrangement_of(corners(few)[1][:2], target)


def test_no_boards_at_all_say_what_was_found():
    target, nothing = corners(EASY)[0], Corners(*(np.empty(0, kind) for kind in ("int32", "int32", "int32", float, float)))
    photos = BoardPhotos(paths=("a.jpg", "b.jpg"), size=target.size)
    searches = tuple(PhotoSearch(photo=n, boards=0, false=0, larger=1, blur=None, overexposed=0.0) for n in "ab")
    with pytest.raises(GeometryError, match=r"Of 2 photographs 0 show boards with 6 x 5.*2 have more corners"):
        arrange(photos, (nothing, nothing), searches, target)


def test_good_photographs_raise_no_warning_and_poor_ones_say_why(solved):
    target, result = solved
    assert [
        text for text in geometry_warnings(result, geometry(result, target)) if "cells" not in text and "Strong" not in text
    ] == []
    flat, found = corners(replace(EASY, tilt=(1.0, 4.0), turned=False, photos=6))
    known = arrangement_of(found, flat)
    said = " ".join(geometry_warnings(known.result, geometry(known.result, flat)))
    assert "straight down" in said and "turned by 90 degrees" in said and "c and Z0" in said
    fine = held_out(result, target, MODELS[1])
    worse = HeldOut(2.0, 2.0, fine.difference + 50 * fine.sigma, fine.sigma)
    said = " ".join(result_warnings(result, worse, target))
    assert "times worse" in said and "halves of the photographs differ" in said


def test_blurred_overexposed_and_larger_boards_are_named():
    said = " ".join(search_warnings((PhotoSearch(photo="a", boards=1, false=0, larger=0, blur=4.0, overexposed=0.0),
                                     PhotoSearch(photo="b", boards=1, false=0, larger=2, blur=1.0, overexposed=0.4))))  # fmt: skip
    assert "a (4.0 px)" in said and "b (40 %)" in said and "more corners than stated were found and left out in b" in said


def test_correlations_with_the_places_of_boards_are_low(solved):
    _, result = solved
    table = correlations(result)
    in_plane = table.typical[:3, [table.columns.index(name) for name in ("tX", "tY", "theta")]]
    assert in_plane.max() < 0.3
    assert table.typical.max() <= 1.0 + 1e-9 and (table.largest >= table.typical - 1e-12).all()


SHEARED = Camera(name="s", width=800, height=600, c=700, x0=5, y0=-4, k1=-0.1, k2=0.02, k3=0.01, p1=0.001, p2=-0.002)


def test_opencv_reads_its_file_and_sees_the_same(tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(opencv_yaml(SHEARED))
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    matrix, lens = file.getNode("camera_matrix").mat(), file.getNode("distortion_coefficients").mat()
    points = np.random.default_rng(0).uniform(-0.4, 0.4, (20, 2))
    ours = image_to_pixel(SHEARED, 700.0 * points)
    theirs, _ = cv2.projectPoints(
        np.column_stack([points[:, 0], -points[:, 1], np.ones(20)]), np.zeros(3), np.zeros(3), matrix, lens
    )
    assert theirs.reshape(-1, 2) == pytest.approx(ours, abs=1e-9)


def brown(x: np.ndarray, k: tuple[float, float, float], p: tuple[float, float]) -> np.ndarray:
    """Distorted points (N, 2) of OpenCV's and COLMAP's model, y down."""
    a, b = x.T
    r2 = a * a + b * b
    radial = 1 + k[0] * r2 + k[1] * r2**2 + k[2] * r2**3
    return np.column_stack([a * radial + 2 * p[0] * a * b + p[1] * (r2 + 2 * a * a),
                            b * radial + p[0] * (r2 + 2 * b * b) + 2 * p[1] * a * b])  # fmt: skip


def test_other_programs_see_the_same_by_their_own_formulas():
    points = np.random.default_rng(1).uniform(-0.45, 0.45, (30, 2))
    ours, down = image_to_pixel(SHEARED, 700.0 * points), points * [1, -1]
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = map(float, colmap_cameras(SHEARED).splitlines()[1].split()[4:13])
    colmap = brown(down, (k1, k2, k3), (p1, p2)) * [fx, fy] + [cx, cy]
    assert colmap - 0.5 == pytest.approx(ours, abs=1e-6), "COLMAP counts from the corner of the first pixel"
    own = json.loads(opensfm_camera(SHEARED))["s"]
    normal = brown(down, (own["k1"], own["k2"], own["k3"]), (own["p1"], own["p2"]))
    normal = normal * [own["focal_x"], own["focal_y"]] + [own["c_x"], own["c_y"]]
    assert 800 * normal + [400 - 0.5, 300 - 0.5] == pytest.approx(ours, abs=1e-6), "OpenSfM: in units of the longer side"
    one = {node.tag: float(node.text) for node in ElementTree.fromstring(agisoft_xml(SHEARED).encode()) if node.tag != "projection"}
    x, y = down.T
    r2 = x * x + y * y
    radial = 1 + one["k1"] * r2 + one["k2"] * r2**2 + one["k3"] * r2**3
    xd = x * radial + one["p1"] * (r2 + 2 * x * x) + 2 * one["p2"] * x * y
    yd = y * radial + one["p2"] * (r2 + 2 * y * y) + 2 * one["p1"] * x * y
    u = one["width"] / 2 + one["cx"] + xd * one["f"] + xd * one["b1"] + yd * one["b2"]
    v = one["height"] / 2 + one["cy"] + yd * one["f"]
    assert np.column_stack([u, v]) - 0.5 == pytest.approx(ours, abs=1e-6), "Metashape's manual, appendix on camera models"


def test_other_programs_get_their_own_words(solved):
    assert colmap_cameras(SHEARED).splitlines()[1].split()[:8] == [
        "1",
        "FULL_OPENCV",
        "800",
        "600",
        "700.0",
        "700.0",
        "405.0",
        "304.0",
    ]
    assert '"focal_x": 0.875' in opensfm_camera(SHEARED) and '"c_y": 0.005' in opensfm_camera(SHEARED)
    assert "<p1>-0.002</p1>" in agisoft_xml(SHEARED) and "<cx>5.0</cx>" in agisoft_xml(SHEARED)
    target, result = solved
    camera = camera_of(result, "x", target.size)
    assert "standard_errors" in opencv_yaml(camera) and camera.covariance[0][0] > 0
