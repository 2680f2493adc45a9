"""The calibrated camera in the formats of other programs: their own formulas image every point at the same pixel."""

import json
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from orthomill.schemas.camera import Camera
from orthomill.tasks.calibration.cameras.camera_exchange import FORMATS, agisoft_xml, colmap_cameras, opencv_yaml, opensfm_camera
from orthomill.tasks.geometry.distortion import image_to_pixel

SHEARED = Camera(name="s", width=800, height=600, c=700, x0=5, y0=-4, k1=-0.1, k2=0.02, k3=0.01, p1=0.001, p2=-0.002)


def opencv_reads(camera: Camera, name: str, tmp_path) -> np.ndarray:
    """A matrix of the file, as OpenCV reads it."""
    path = tmp_path / "camera.yaml"
    path.write_text(opencv_yaml(camera))
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    return file.getNode(name).mat().copy()


def test_opencv_reads_its_file_and_sees_the_same(tmp_path):
    matrix, lens = (opencv_reads(SHEARED, name, tmp_path) for name in ("camera_matrix", "distortion_coefficients"))
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
    return np.column_stack(
        [a * radial + 2 * p[0] * a * b + p[1] * (r2 + 2 * a * a), b * radial + p[0] * (r2 + 2 * b * b) + 2 * p[1] * a * b]
    )


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


def test_affinity_and_skew_reach_opencv_with_its_y_downwards(tmp_path):
    camera = SHEARED.changed(affinity=2e-3, skew=5e-4)
    matrix = opencv_reads(camera, "camera_matrix", tmp_path)
    assert matrix[0, 0] == pytest.approx(700.0 * 1.002) and matrix[1, 1] == 700.0
    # x = x0 + c ((1 + affinity) xd + skew yd) with y upwards.
    up = np.array([0.2, -0.3])
    x = 5.0 + 700.0 * (1.002 * up[0] + 5e-4 * up[1])
    assert (matrix @ [up[0], -up[1], 1.0])[0] == pytest.approx(399.5 + x)


def test_affinity_and_skew_are_b1_and_b2_of_agisoft():
    sheared = ElementTree.fromstring(agisoft_xml(SHEARED.changed(affinity=2e-3, skew=5e-4)).encode())
    assert float(sheared.findtext("b1", "")) == pytest.approx(1.4) and float(sheared.findtext("b2", "")) == pytest.approx(-0.35)
    assert "<b2>0.0</b2>" in agisoft_xml(SHEARED), "not -0.0"


def test_standard_errors_follow_the_order_that_the_file_states(tmp_path):
    variances = np.arange(1.0, 18.0) ** 2
    camera = SHEARED.model_copy(update={"covariance": tuple(map(tuple, np.diag(variances).tolist()))})
    sigma = opencv_reads(camera, "standard_errors", tmp_path).ravel()
    assert sigma.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 8.0, 6.0], "c x0 y0 k1 k2 p1 p2 k3"
    assert "standard_errors" not in opencv_yaml(SHEARED), "unknown precision is not written as zero"


def test_colmap_takes_the_model_that_holds_all_parameters():
    full, plain = (colmap_cameras(SHEARED.changed(k3=k3)).splitlines()[1].split() for k3 in (0.01, 0.0))
    assert full[:8] == ["1", "FULL_OPENCV", "800", "600", "700.0", "700.0", "405.0", "304.0"]
    assert len(full) == 4 + 12 and full[-3:] == ["0.0"] * 3, "the denominator of the rational model is 1"
    assert plain[1] == "OPENCV" and len(plain) == 4 + 8


def test_opensfm_counts_in_units_of_the_longer_side():
    for size in ((800, 600), (600, 800)):
        own = json.loads(opensfm_camera(SHEARED.model_copy(update={"width": size[0], "height": size[1]})))["s"]
        assert own["focal_x"] == own["focal_y"] == 0.875 and (own["c_x"], own["c_y"]) == (5.0 / 800, 4.0 / 800)


def test_numbers_survive_being_written(tmp_path):
    camera = SHEARED.changed(c=700.0 + 1.0 / 3.0, k1=-0.1 - 1e-13)
    assert opencv_reads(camera, "camera_matrix", tmp_path)[1, 1] == camera.c
    assert json.loads(opensfm_camera(camera))["s"]["k1"] == camera.lens.k1
    assert float(colmap_cameras(camera).splitlines()[1].split()[8]) == camera.lens.k1
    assert float(ElementTree.fromstring(agisoft_xml(camera).encode()).findtext("f")) == camera.c


def test_every_format_has_a_file_of_its_own():
    assert len({known.file for known in FORMATS.values()}) == len(FORMATS) == 4
    assert all(known.text(SHEARED).endswith("\n") for known in FORMATS.values())
