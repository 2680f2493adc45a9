"""Photographs by a fisheye lens, from files to a surface: every stage knows the camera by its lens."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
import yaml
from small_site import command_in

from orthomill.schemas.camera import Camera, FisheyeLens
from orthomill.tasks.geometry.distortion import pixel_to_image
from orthomill.tasks.geometry.rotation import rotation_matrix

WIDE = Camera(name="wide", width=480, height=480, c=290.0, lens=FisheyeLens(k1=0.02, k2=-0.004))
"""65 degrees off its axis in the corners of the frame"""
SITE, HEIGHT, PIXEL = np.array([500000.0, 4000000.0]), 40.0, 0.15
"""m: the middle of the site, flying height, and the ground pixel below the photographs, rounded up"""
SEED = 7


def ground(x, y):
    """Heights of the ground, m."""
    return 1.5 * np.sin(x / 17.0) + np.cos(y / 13.0)


def texture(x, y):
    """Grey levels of the ground at points (n,) m: noise of five octaves."""
    rng, total = np.random.default_rng(SEED), np.zeros(x.shape)
    for octave in range(5):
        noise = rng.normal(size=(512, 512)).astype(np.float32)
        cell = PIXEL * 1.5 * 2**octave
        col, row = (np.mod(x / cell, 510.0) + 0.5).astype(np.float32), (np.mod(y / cell, 510.0) + 0.5).astype(np.float32)
        total += cv2.remap(noise, col.reshape(480, 480), row.reshape(480, 480), cv2.INTER_LINEAR).ravel()
    return np.clip(128 + 24 * total, 1, 255)


def photograph(centre, angles):
    """The photograph (480, 480) uint8 from a place with omega, phi, kappa in degrees."""
    row, col = np.mgrid[:480, :480]
    ideal = pixel_to_image(WIDE, np.column_stack([col.ravel(), row.ravel()]).astype(float))
    rays = np.column_stack([ideal, np.full(len(ideal), -WIDE.c)]) @ rotation_matrix(*np.radians(angles))
    level = rays[:, :2] / -rays[:, 2:]
    depth = np.full(len(ideal), centre[2])
    for _ in range(30):
        depth = 0.5 * depth + 0.5 * (centre[2] - ground(*(centre[:2] + depth[:, None] * level).T))
    x, y = (centre[:2] + depth[:, None] * level).T
    return np.round(texture(x, y)).reshape(480, 480).astype(np.uint8)


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A finished run of two strips of two photographs, the camera constant of which is given wrong by 2 px."""
    root, rng = tmp_path_factory.mktemp("fisheye"), np.random.default_rng(SEED)
    (root / "photographs").mkdir()
    (root / "workflows").mkdir()
    rows = ["photo,x,y,z,sigma_x,sigma_y,sigma_z"]
    for i, (east, north) in enumerate([(x, y) for y in (-9.0, 9.0) for x in (-9.0, 9.0)]):
        centre = np.array([east, north, HEIGHT]) + rng.normal(0, 0.5, 3)
        cv2.imwrite(str(root / "photographs" / f"p{i}.png"), photograph(centre, rng.normal(0, 2, 3)))
        rows.append(f"p{i}," + ",".join(f"{v:.3f}" for v in (*(centre[:2] + SITE), centre[2])) + ",0.02,0.02,0.02")
    (root / "positions.csv").write_text("\n".join(rows) + "\n")
    workflow = {
        "project": "wide",
        "crs": "EPSG:32634",
        "photographs": {"kind": "folder", "path": "photographs"},
        "cameras": {"kind": "given", "c": 292.0, "sigma_c": 4.0, "lens": "fisheye", "k1": 0.02, "k2": -0.004},
        "positions": {"kind": "file", "path": "positions.csv"},
        "control": {"kind": "none"},
        "stages": [*("photos", "calibration", "tie_points", "orientation", "epipolar"), {"kind": "densification", "cell": 0.8}],
    }
    (root / "workflows" / "wide.yaml").write_text(yaml.safe_dump(workflow, sort_keys=False))
    command_in(root, "run", "wide", "--sequential")
    return root / "runs" / "wide"


@pytest.mark.slow
def test_its_surface_is_the_ground(project: Path):
    with rasterio.open(project / "products" / "dsm.tif") as file:
        heights = file.read(1, masked=True).filled(np.nan)
        rows, cols = np.mgrid[: file.height, : file.width]
        x, y = (np.asarray(v).reshape(heights.shape) for v in rasterio.transform.xy(file.transform, rows.ravel(), cols.ravel()))
    error = heights - ground(x - SITE[0], y - SITE[1])
    near = (np.abs(x - SITE[0]) < 30.0) & (np.abs(y - SITE[1]) < 30.0)
    assert np.isfinite(error[near]).mean() > 0.9
    # By the lens of another kind the edges of this field would lie metres off.
    assert np.nanpercentile(np.abs(error[near]), 90) < 0.5 * PIXEL
