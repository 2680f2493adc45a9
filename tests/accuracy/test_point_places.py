"""Heights and places of surveyed points in products with known errors."""

from functools import cache

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from orthomill.schemas.accuracy.point_tests import PointTest, PointTests
from orthomill.schemas.camera import Camera
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Provenance
from orthomill.tasks.accuracy.points.orthoimage_place import (
    GroundPlane,
    MarkedPatch,
    OrthoPixels,
    level_for,
    patch_window,
    pixels_around,
    place_in_orthoimage,
)
from orthomill.tasks.accuracy.points.surface_height import CellsAround, cells_around, height_at
from orthomill.tasks.accuracy.statement.point_statement import statement_of
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View

GRID = MapGrid(west=100.0, north=220.0, cell=0.5, rows=240, cols=240)
X, Y = 160.13, 159.87


def cells(height, code=Provenance.AGREED, sigma=0.02):
    window = cells_around(GRID, X, Y).clipped(GRID.shape)
    east, north = np.meshgrid(*GRID.centres(window))
    z = np.broadcast_to(np.asarray(height(east, north), np.float32), east.shape).copy()
    return CellsAround(GRID, window, z, np.full(z.shape, sigma, np.float32), np.full(z.shape, code, np.uint8))


def test_the_height_is_that_of_the_surface_at_the_very_place():
    found = height_at(cells(lambda x, y: 20 + 0.05 * (x - X) - 0.04 * (y - Y)), X, Y, 0.1)
    assert found.tested and found.height == pytest.approx(20, abs=1e-4)
    assert found.slope == pytest.approx(np.hypot(0.05, 0.04), rel=1e-3) and found.sigma == pytest.approx(0.02)


def test_a_surface_that_states_no_precision_is_tested_and_promises_nothing():
    found = height_at(cells(lambda x, y: 0 * x, sigma=np.nan), X, Y, 0.1)
    assert found.counted == 0.0 and found.sigma is None
    point = PointTest(name="p", surveyed=(X, Y, 0.2), sigma=(0.01, 0.01, 0.01), height=found)
    assert point.height_difference == pytest.approx(-0.2) and point.height_predicted is None
    (figure,) = statement_of(PointTests(points=(point,) * 30)).figures
    assert figure.kind == "nva" and figure.promised is None


@pytest.mark.parametrize(
    ("surface", "code", "reason"),
    [
        (lambda x, y: np.where(x > X + 0.9, 26.0, 20.0), Provenance.AGREED, "beside an edge"),
        (lambda x, y: 20 + 0.3 * x, Provenance.AGREED, "slope of 30 %"),
        (lambda x, y: 20 + 0 * x, Provenance.INTERPOLATED, "are estimated"),
        (lambda x, y: np.where(x > X, np.nan, 20.0), Provenance.AGREED, "no height"),
        (lambda x, y: np.where(x > X + 0.4, np.nan, 20.0), Provenance.AGREED, "beside a hole"),
    ],
)
def test_where_a_height_says_nothing_the_reason_is_told(surface, code, reason):
    found = height_at(cells(surface, code), X, Y, 0.1)
    assert not found.tested and reason in found.reason
    assert found.uneven == ("slope" not in reason), "a slope is one plane: a place on it can be tested"


def test_points_beyond_the_surface_are_told_apart():
    window = cells_around(GRID, 100.1, 219.9).clipped(GRID.shape)
    flat = CellsAround(GRID, window, np.zeros(window.shape), np.zeros(window.shape))
    assert "border" in height_at(flat, 100.1, 219.9, 0.1).reason
    nothing = CellsAround(GRID, Window(0, 0, 0, 0), np.zeros((0, 0)), np.zeros((0, 0)))
    assert "outside" in height_at(nothing, 0, 0, 0.1).reason


CAMERA = Camera(name="c", width=1200, height=1200, c=1000.0)


@cache
def texture():
    table = gaussian_filter(np.random.default_rng(5).normal(0, 1, (900, 900)), 3)
    return (128 + 55 * table / table.std()).clip(1, 255)


def ground(x, y):
    """A texture that is the same for whoever asks."""
    table = texture()
    col, row = ((np.asarray(x) - 100) * 6).astype(int) % 900, ((220 - np.asarray(y)) * 6).astype(int) % 900
    return table[row, col]


def photograph(angles, centre):
    view = View("p", CAMERA, rotation_matrix(*np.radians(angles)), np.array(centre, float))
    cols, rows = np.meshgrid(np.arange(1200), np.arange(1200))
    places = view.at_height(np.column_stack([cols.ravel(), rows.ravel()]).astype(float), 10.0)
    return view, ground(places[:, 0], places[:, 1]).reshape(1200, 1200).astype(np.uint8)


@pytest.mark.parametrize("moved", [(0.0, 0.0), (0.37, -0.62), (4.2, 3.1)])
def test_a_point_is_found_where_the_orthoimage_shows_it(moved):
    """The orthoimage is displaced by `moved`, and the block's orientation by some metres, which must not matter."""
    grid = GRID.model_copy(update={"cell": 0.25, "rows": 480, "cols": 480})
    window = pixels_around(grid, X, Y).clipped(grid.shape)
    east, north = np.meshgrid(*grid.centres(window))
    image = ground(east - moved[0], north - moved[1]).astype(np.uint8)
    colours = np.dstack([image, image, image, np.full(image.shape, 255, np.uint8)])
    patches = []
    for angles, centre in (((3.0, -4.0, 20.0), (150, 160, 260)), ((-2.0, 5.0, 100.0), (175, 150, 255))):
        view, pixels = photograph(angles, centre)
        mark = (*view.project(np.array([[X, Y, 10.0]]))[0], 0.3)
        wrong = View("p", CAMERA, view.rotation, view.centre + np.array([1.5, -2.0, 1.0]))
        level = level_for(wrong, (X, Y, 10.0), grid.cell, 3)
        part = patch_window(wrong, mark, (X, Y, 10.0), grid.cell, level).clipped(pixels.shape)
        patches.append(MarkedPatch(wrong, mark, level, part, pixels[part.slices]))
    found = place_in_orthoimage(OrthoPixels(grid, window, colours), tuple(patches), GroundPlane((X, Y, 10.0)))
    assert found.tested and found.photos == 2
    assert np.hypot(found.place[0] - X - moved[0], found.place[1] - Y - moved[1]) < 0.08
    assert 0.03 < found.sigma[0] < 0.15, "the marks' 0.3 px are 7 cm on the ground"


def test_ground_that_resembles_the_point_little_is_not_taken_for_it():
    """The patch lies in half of the window; the other half shows something else, as beside a wall."""
    grid = GRID.model_copy(update={"cell": 0.25, "rows": 480, "cols": 480})
    window = pixels_around(grid, X, Y).clipped(grid.shape)
    image = ground(*np.meshgrid(*grid.centres(window)))
    other = np.random.default_rng(2).integers(1, 255, image.shape)
    image[:, image.shape[1] // 2 :] = other[:, image.shape[1] // 2 :]
    view, pixels = photograph((0.0, 0.0, 0.0), (160, 160, 260))
    mark = (*view.project(np.array([[X, Y, 10.0]]))[0], 0.3)
    patch = MarkedPatch(view, mark, 0, Window(0, 0, 1200, 1200), pixels)
    colours = np.dstack([image.astype(np.uint8)] * 3)
    assert "not found" in place_in_orthoimage(OrthoPixels(grid, window, colours), (patch,), GroundPlane((X, Y, 10.0))).reason


def test_another_picture_is_not_taken_for_the_point():
    grid = GRID.model_copy(update={"cell": 0.25, "rows": 480, "cols": 480})
    window = pixels_around(grid, X, Y).clipped(grid.shape)
    noise = np.random.default_rng(1).integers(1, 255, (*window.shape, 3)).astype(np.uint8)
    view, pixels = photograph((0.0, 0.0, 0.0), (160, 160, 260))
    mark = (*view.project(np.array([[X, Y, 10.0]]))[0], 0.3)
    patch = MarkedPatch(view, mark, 0, Window(0, 0, 1200, 1200), pixels)
    found = place_in_orthoimage(OrthoPixels(grid, window, noise), (patch,), GroundPlane((X, Y, 10.0)))
    assert "not found" in found.reason
    assert "marked in no photograph" in place_in_orthoimage(OrthoPixels(grid, window, noise), (), GroundPlane((X, Y, 10.0))).reason
