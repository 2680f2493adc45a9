"""The library: what a notebook calls. Photographs are small; what is tested is that the answers are those of the methods."""

import tomllib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import xarray as xr
from pyproj import CRS
from scipy.interpolate import griddata
from small_site import make_site

import orthomill
from benchmarks.calibration.board_setups import SIX_BOARDS, places_of, views_of
from orthomill.schemas.errors import OrthomillError, PhotoError, StoreError, WorkflowError
from orthomill.schemas.raster import Window
from orthomill.tasks.simulation.boards.board_rendering import BoardFilm, photograph_floor

BOARD_CAMERA = SIX_BOARDS.camera.model_copy(update={"width": 720, "height": 480}).changed(
    c=610.0, x0=3.0, y0=-2.0, k1=-0.1, k2=0.03
)
BOARDS = replace(SIX_BOARDS, camera=BOARD_CAMERA, boards=3, photos=5, share=0.7, seed=3)


@pytest.fixture(scope="module")
def photographs(tmp_path_factory) -> Path:
    return make_site(tmp_path_factory.mktemp("site")) / "photos"


@pytest.fixture(scope="module")
def oriented(photographs) -> orthomill.OrientedBlock:
    return orthomill.orient(photographs)


@pytest.fixture(scope="module")
def surface(oriented) -> xr.DataArray:
    """Heights between the tie points, on cells of about their distance."""
    points = oriented.points
    west, east = np.percentile(points.x, [10, 90])
    south, north = np.percentile(points.y, [10, 90])
    x, y = np.arange(west, east, (east - west) / 100), np.arange(north, south, -(east - west) / 100)
    heights = griddata((points.x, points.y), points.z, tuple(np.meshgrid(x, y))).astype(np.float32)
    return xr.DataArray(heights, dims=("y", "x"), coords={"x": x, "y": y})


def test_the_version_is_that_of_the_package():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())
    assert "version" in project["project"]["dynamic"]
    assert project["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "orthomill.__version__"}


def test_the_changelog_knows_the_version():
    headings = [line for line in (Path(__file__).parents[2] / "CHANGELOG.md").read_text().splitlines() if line.startswith("## ")]
    assert headings[0] == "## Unreleased" and headings[1].split()[1] == orthomill.__version__


def test_what_the_library_has_can_be_listed_and_nothing_else_is_there():
    assert {"open", "calibrate", "orient", "match", "match_surface", "check"} <= set(dir(orthomill))
    with pytest.raises(AttributeError, match="orthomill has no 'reconstruct'; it has open"):
        _ = orthomill.reconstruct


def test_the_surface_of_a_rectified_pair_is_complete_and_says_what_it_is_worth(tmp_path):
    right = cv2.GaussianBlur(np.random.default_rng(2).integers(0, 255, (90, 130)).astype(np.float32), (0, 0), 1.2)
    right = np.clip(3.0 * (right - right.mean()) + 128.0, 1, 255).astype(np.uint8)
    noisy = np.roll(right, 7, axis=1) + np.random.default_rng(3).normal(0.0, 2.0, right.shape)
    cv2.imwrite(str(tmp_path / "left.png"), np.clip(np.rint(noisy), 1, 255).astype(np.uint8))
    found = orthomill.match_surface(tmp_path / "left.png", right, 0.0, 20.0)
    inside = found.parallax[:, 8:]
    assert np.isfinite(inside).all() and (np.abs(inside - 7.0) < 0.1).mean() > 0.95
    assert (np.abs(inside - 7.0) < 3.0 * found.sigma[:, 8:]).mean() > 0.95 and (found.code[:, 8:] > 0).all()


def test_photographs_become_a_block_with_covariances(oriented):
    assert len(oriented.block.photos) == 3 and oriented.block.crs == "EPSG:32615"
    assert 0.02 < oriented.block.sigma0_px < 0.6
    for photo in oriented.block.photos:
        assert np.linalg.eigvalsh(np.array(photo.covariance)).min() > 0
    assert len(oriented.points) > 50 and oriented.image_residuals.used.mean() > 0.8


def test_the_answer_of_a_temporary_run_is_the_same_again(photographs, oriented):
    assert orthomill.orient(photographs).block == oriented.block


def test_progress_is_told_stage_by_stage(photographs):
    told: list[tuple[str, int, int]] = []
    with pytest.raises(OrthomillError):
        orthomill.orient(sorted(photographs.iterdir())[:1], progress=lambda *words: told.append(words))
    assert told[0][0] == "photos" and all(done <= planned for _, done, planned in told)


def test_photographs_that_are_not_there_are_named():
    with pytest.raises(PhotoError, match=r"nowhere\.jpg"):
        orthomill.orient(["nowhere.jpg"])


def test_a_photograph_matches_itself_where_it_stands(photographs):
    path = sorted(photographs.iterdir())[0]
    points = np.array([[300.0, 200.0], [100.0, 120.0]])
    found = orthomill.match(path, orthomill.read_photograph(path), points, points + np.array([1.5, -1.0]))
    assert found.converged.all()
    assert np.abs(np.column_stack([found.col, found.row]) - points).max() < 1e-3


def test_an_array_that_was_shifted_is_found_at_its_place():
    image = cv2.GaussianBlur(np.random.default_rng(4).uniform(0, 255, (80, 90)).astype(np.float32), (0, 0), 2)
    found = orthomill.match(image, np.roll(image, (2, 3), axis=(0, 1)), np.array([[40.0, 40.0]]), np.array([[42.0, 41.0]]))
    assert abs(found.col[0] - 43.0) < 0.02 and abs(found.row[0] - 42.0) < 0.02


def test_boards_become_a_camera_within_its_standard_errors(tmp_path):
    for number, view in enumerate(views_of(BOARDS)):
        image = photograph_floor(view, places_of(BOARDS), BOARDS.board, BoardFilm(0.6, 2.0, seed=number), Window(0, 0, 480, 720))
        cv2.imwrite(str(tmp_path / f"{view.name}.png"), image)
    result = orthomill.calibrate(tmp_path, corners=(6, 5), square=0.0359, boards=3)
    sigma = result.camera.covariance[0][0] ** 0.5
    assert abs(result.camera.c - 610.0) < 4 * sigma < 3.0
    assert len(result.residuals) > 200 and result.report.figures


def test_a_surface_that_was_lifted_is_lowered_by_the_photographs(oriented, photographs, surface):
    """Two metres too high: the photographs ask for them back."""
    lifted = orthomill.check(surface + 2.0, photographs, oriented.block).result
    judged = np.isfinite(lifted.dh)
    assert float(judged.mean()) > 0.1
    assert abs(float(lifted.dh.median()) + 2.0) < 0.3
    assert lifted.dh.dims == ("y", "x") and np.allclose(lifted.x, surface.x)


def test_a_surface_in_another_system_or_upside_down_is_refused(oriented, photographs, surface):
    elsewhere = surface.assign_coords(spatial_ref=0)
    elsewhere.spatial_ref.attrs["crs_wkt"] = CRS(2100).to_wkt()
    with pytest.raises(WorkflowError, match="reproject"):
        orthomill.check(elsewhere, photographs, oriented.block)
    with pytest.raises(WorkflowError, match="y falling"):
        orthomill.check(surface[::-1], photographs, oriented.block)


def test_a_surface_is_checked_with_the_photographs_of_the_block_that_are_there(oriented, photographs, surface):
    files = sorted(photographs.iterdir())
    few = orthomill.check(surface, files[:2], oriented.block).result
    assert np.isfinite(few.dh).any()
    with pytest.raises(WorkflowError, match="1 of the two photographs that a check needs"):
        orthomill.check(surface, files[:1], oriented.block)


def test_a_folder_without_a_run_is_refused(tmp_path):
    with pytest.raises(StoreError, match="runs/volos"):
        orthomill.open(tmp_path)


def test_what_has_not_been_run_is_said_with_its_stage(tmp_path):
    (tmp_path / "tables").mkdir()
    project = orthomill.open(tmp_path)
    with pytest.raises(StoreError, match="run its stage 'orientation' first"):
        _ = project.block
    with pytest.raises(StoreError, match="run the project to its end"):
        _ = project.summary
    assert project.rasters == ()
