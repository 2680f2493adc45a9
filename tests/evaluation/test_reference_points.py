"""Points of known height: read from tables and clouds, compared tile by tile, judged by their own standard errors too."""

import numpy as np
import pytest

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.raster import MapGrid, Window, tiles_of
from orthomill.schemas.solid.cloud_points import CloudPoints
from orthomill.schemas.solid.mesh import TriangleMesh
from orthomill.schemas.surface import Provenance
from orthomill.tasks.evaluation.point_accuracy import HALO, PointDifferences, PointTile, points_in_tile, summarise_points
from orthomill.tasks.evaluation.reference_points import ReferencePoints, points_of_cloud, points_of_mesh, points_of_table
from orthomill.tasks.evaluation.report.points_section import points_section

GRID = MapGrid(west=100.0, north=200.0, cell=2.0, rows=30, cols=40)


@pytest.mark.parametrize(
    ("text", "sigma"),
    [
        ("name,x,y,z,sigma_z\na,101.5,180,12.25,0.04\nb,120,170,13,0.05\n", (0.04, 0.05)),
        ("Point;Easting;Northing;Height;StdDev_Z [mm]\na;101,5;180,0;12,25;40\nb;120,0;170,0;13,0;50\n", (0.04, 0.05)),
        ("# surveyed in May\n101.5 180 12.25\n120 170 13\n", (0.1, 0.1)),
        ("1 101.5 180 12.25 0.04\n2 120 170 13 0.05\n", (0.04, 0.05)),
        ("x y z\n101.5 180 12.25\n120 170 13\n", (0.1, 0.1)),
    ],
    ids=["columns", "semicolons", "three numbers", "with a name", "no error"],
)
def test_tables_of_points_are_read(text, sigma):
    found = points_of_table(text, "points.csv", 0.1)
    assert found.x.tolist() == [101.5, 120.0] and found.y.tolist() == [180.0, 170.0] and found.z.tolist() == [12.25, 13.0]
    assert found.sigma == pytest.approx(sigma)


@pytest.mark.parametrize("text", ["", "these are\nno points\n", "x,y\n1,2\n"])
def test_a_text_without_points_is_refused(text):
    with pytest.raises(WorkflowError, match=r"points\.csv holds no points"):
        points_of_table(text, "points.csv", 0.1)
    with pytest.raises(WorkflowError, match="below zero"):
        points_of_table("x,y,z,sigma_z\n1,2,3,-0.1\n", "points.csv", 0.1)


def test_vertices_have_one_standard_error():
    cloud = TriangleMesh(np.array([[1.0, 2.0, 3.0]], np.float32), np.empty((0, 3), np.int32), origin=(100.0, 100.0, 0.0))
    found = points_of_mesh(cloud, 0.15)
    assert (found.x[0], found.y[0], found.z[0], found.sigma[0]) == (101.0, 102.0, 3.0, 0.15)


def test_points_of_clouds_have_the_standard_errors_that_their_file_states():
    one = np.array([1.0, 2.0])
    assert points_of_cloud(CloudPoints(one, one, one, np.array([0.04, np.nan])), 0.15).sigma.tolist() == [0.04, 0.15]


def plane(x, y):
    return 5.0 + 0.1 * (x - 100.0) - 0.2 * (y - 150.0)


def compared(points: ReferencePoints, height: np.ndarray, tile: int) -> tuple[PointDifferences, ...]:
    precision = np.full(GRID.shape, 0.3, np.float32)
    code = np.full(GRID.shape, Provenance.AGREED, np.uint8)
    code[:, 20:] = Provenance.INTERPOLATED
    parts = []
    for t in tiles_of(GRID.shape, tile):
        window = t.window.grown(HALO).clipped(GRID.shape)
        own = (array[window.slices] for array in (height, precision, code))
        parts.append(points_in_tile(*own, points, PointTile(GRID, t.window, window)))
    return tuple(parts)


@pytest.fixture(scope="module")
def scattered():
    random = np.random.default_rng(1)
    x, y = random.uniform(90.0, 190.0, 800), random.uniform(130.0, 210.0, 800)
    z = plane(x, y) + random.normal(0.0, 0.4, 800)
    x_cells, y_cells = np.meshgrid(*GRID.centres(Window(0, 0, *GRID.shape)))
    return ReferencePoints(x, y, z, np.full(800, 0.4)), plane(x_cells, y_cells).astype(np.float32)


def test_differences_have_the_errors_of_surface_and_point(scattered):
    points, height = scattered
    summary = summarise_points(compared(points, height, 64), points, GRID)
    inside = (points.x > 100) & (points.x < 180) & (points.y > 140) & (points.y < 200)
    whole, measured, estimated = summary.groups
    assert (summary.given, summary.inside) == (800, inside.sum()) and measured.points + estimated.points == whole.points
    assert whole.points > 0.9 * inside.sum() and abs(whole.bias) < 0.05 and whole.rmse == pytest.approx(0.4, rel=0.1)
    # 0.4 m of noise against a standard error of 0.5 m.
    assert whole.within[:2] == pytest.approx((78.9, 98.8), abs=4.0)
    exact = ReferencePoints(points.x, points.y, plane(points.x, points.y), np.zeros(800))
    assert np.abs(np.concatenate([part.dh for part in compared(exact, height, 64)])).max() < 1e-4


@pytest.mark.parametrize("tile", [8, 13])
def test_tiles_compare_every_point_once(scattered, tile):
    points, height = scattered
    height = height.copy()
    height[10:14, 5:9] = np.nan
    one, many = compared(points, height, 64), compared(points, height, tile)
    joined = [np.sort(np.concatenate([part.dh for part in parts])) for parts in (one, many)]
    assert len(one) < len(many) and np.array_equal(*joined)
    assert summarise_points(one, points, GRID).groups[0].points == summarise_points(many, points, GRID).groups[0].points


def test_points_elsewhere_and_errors_that_are_too_small_are_named(scattered):
    points, height = scattered
    away = ReferencePoints(points.x + 5000.0, points.y, points.z, points.sigma)
    (warning,) = points_section(summarise_points(compared(away, height, 64), away, GRID)).warnings
    assert "None of the 800 reference points" in warning and "0 lie on" in warning
    wrong = ReferencePoints(points.x, points.y, points.z + 1.5, points.sigma)
    section = points_section(summarise_points(compared(wrong, height, 64), wrong, GRID))
    assert "lie within two standard errors" in section.warnings[0]
    figures = {figure.name: figure.value for figure in section.figures}
    assert figures["points_bias"] == pytest.approx(-1.5, abs=0.05) and figures["points_estimated_compared"] > 50
    assert section.grids[0].rows[0][1] == figures["points_compared"]
