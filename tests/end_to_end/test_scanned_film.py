"""Photographs of a tiny block as scans of film, each laid differently on the scanner, against the same photographs as they are."""

import numpy as np
import pytest
import tiny_block
import yaml
from PIL import Image
from scipy.ndimage import map_coordinates
from small_site import command_in

from orthomill.schemas.orientation import Block

pytestmark = pytest.mark.slow

PIXEL_MM, SCAN_MM = 0.050, 0.046
PICTURE = (480 * PIXEL_MM, 460 * PIXEL_MM)
MARKS = {f"{i}": (x, y) for i, (x, y) in enumerate([(-13, 12.5), (13, 12.5), (13, -12.5), (-13, -12.5), (0, 12.7), (13.2, 0)])}
FACTOR = PIXEL_MM / SCAN_MM
STAGES = ["calibration", "tie_points", "orientation"]


def scanned(picture, rng):
    """The scan (rows, cols) with crosses in a dark margin, and where the marks are measured (0.05 px), by mark."""
    turn, (across, down) = np.radians(rng.uniform(-2, 2)), SCAN_MM * (1 + rng.normal(0, 0.002, 2))
    to_scan = np.array([[np.cos(turn) / across, -np.sin(turn) / across], [-np.sin(turn) / down, -np.cos(turn) / down]])
    origin, (width, height) = np.array([310.0, 300.0]) + rng.uniform(-6, 6, 2), (620, 600)
    col, row = np.meshgrid(np.arange(width), np.arange(height))
    mm = (np.column_stack([col.ravel(), row.ravel()]) - origin) @ np.linalg.inv(to_scan).T
    col, row = mm[:, 0] / PIXEL_MM + (480 - 1) / 2, (460 - 1) / 2 - mm[:, 1] / PIXEL_MM
    grey = map_coordinates(picture.astype(float), [row, col], order=3, mode="nearest")
    grey[(np.abs(col - 239.5) > 240) | (np.abs(row - 229.5) > 230)] = 12.0
    for mark in MARKS.values():
        off = np.abs(mm - mark)
        grey[(off.min(axis=1) < 0.06) & (off.max(axis=1) < 0.4)] = 245.0
    at = {name: origin + to_scan @ mark + rng.normal(0, 0.05, 2) for name, mark in MARKS.items()}
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8).reshape(height, width), at


def oriented(root, name, cameras, photos_stage, photographs):
    workflow = {
        "project": name,
        "crs": "EPSG:2100",
        "photographs": {"kind": "folder", "path": photographs},
        "cameras": cameras,
        "tile": 256,
        "positions": {"kind": "file", "path": "positions.csv"},
        "stages": [photos_stage, *STAGES],
    }
    (root / "workflows" / f"{name}.yaml").write_text(yaml.safe_dump(workflow, sort_keys=False))
    command_in(root, "run", name, "--sequential")
    return Block.model_validate_json((root / "runs" / name / "tables" / "orientation" / "block.json").read_bytes())


@pytest.fixture(scope="module")
def blocks(tmp_path_factory):
    """The block of the photographs as they are, and that of their scans."""
    root, rng = tmp_path_factory.mktemp("film"), np.random.default_rng(4)
    for folder in ("plain", "scans", "workflows"):
        (root / folder).mkdir()
    measured, positions = ["photo,mark,col,row"], ["photo,x,y,z,sigma_x,sigma_y,sigma_z"]
    for photo in tiny_block.block().photos:
        picture = tiny_block.photograph(photo.photo)[:, :, 0]
        Image.fromarray(picture).save(root / "plain" / f"{photo.photo}.tif")
        scan, marks = scanned(picture, rng)
        Image.fromarray(scan).save(root / "scans" / f"{photo.photo}.tif")
        measured += [f"{photo.photo},{name},{col:.3f},{row:.3f}" for name, (col, row) in marks.items()]
        positions.append(f"{photo.photo}," + ",".join(f"{v:.3f}" for v in photo.centre) + ",0.05,0.05,0.05")
    (root / "measured.csv").write_text("\n".join(measured) + "\n")
    (root / "positions.csv").write_text("\n".join(positions) + "\n")
    (root / "marks.csv").write_text("mark,x,y\n" + "".join(f"{name},{x},{y}\n" for name, (x, y) in MARKS.items()))
    lens = {name: getattr(tiny_block.camera().lens, name) for name in ("k1", "k2", "p1", "p2")}
    c, x0, y0 = tiny_block.camera().interior[:3]
    plain = oriented(root, "plain", {"kind": "given", "c": c, "x0": x0, "y0": y0, **lens}, "photos", "plain")
    coordinates = {
        "kind": "fiducial_marks",
        "marks_path": "marks.csv",
        "measured_path": "measured.csv",
        "pixel_um": 1000.0 * SCAN_MM,
        "picture_mm": list(PICTURE),
    }
    film = {"kind": "given", "c": FACTOR * c, "x0": FACTOR * x0, "y0": FACTOR * y0, **lens}
    return plain, oriented(root, "film", film, {"kind": "photos", "coordinates": coordinates}, "scans")


def test_scans_give_the_block_of_the_photographs(blocks):
    plain, film = blocks
    assert set(film.names) == set(plain.names) and len(film.names) == 6
    assert plain.sigma0_px < film.sigma0_px < 0.05, "an affine transformation of each photograph alone, resampled once more"
    for name in plain.names:
        away = np.subtract(film.of(name).centre, plain.of(name).centre)
        assert np.abs(away).max() < 0.15, "0.05 px of a mark are 0.03 m on the ground"
        turn = np.subtract(film.of(name).omega_phi_kappa, plain.of(name).omega_phi_kappa)
        assert np.abs(turn).max() < 0.05, "the datum alone leaves 0.011"
