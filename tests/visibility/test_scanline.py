"""Depth and triangle of every pixel: against the published look-up in a grid of cells, ray casting, and planes known in advance."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.camera import Camera
from orthomill.schemas.raster import Window
from orthomill.schemas.solid.mesh import TriangleMesh
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View
from orthomill.tasks.visibility.scanline import NOTHING, Projection, add_triangles, central_projection, empty_raster
from tests.support.solid.whole_mesh import nearest_triangles

DOWN = Projection(np.array([[1.0, 0, 0, 0], [0, -1.0, 0, 0], [0, 0, 1.0, 0]]), central=False)
"""From above: columns are X, rows are -Y, the higher the nearer."""
CAMERA = Camera(name="camera", width=160, height=120, c=150.0, x0=3.0, y0=-2.0)


def looked_up(projected: np.ndarray, triangles: np.ndarray, shape: tuple[int, int], factor: int = 5) -> np.ndarray:
    """Triangle numbers by the older published way (M2a of sources/blending.md): bounding rectangles in a grid of cells, then a test
    of each candidate."""
    cells: dict[tuple[int, int], list[int]] = {}
    for number, (a, b, c) in enumerate(projected[triangles][..., :2]):
        low = np.floor(np.minimum(np.minimum(a, b), c) / factor).astype(int)
        high = np.floor(np.maximum(np.maximum(a, b), c) / factor).astype(int)
        for row in range(max(low[1], 0), min(high[1], shape[0] // factor) + 1):
            for col in range(max(low[0], 0), min(high[0], shape[1] // factor) + 1):
                cells.setdefault((row, col), []).append(number)
    found = np.full(shape, NOTHING)
    for row, col in np.ndindex(shape):
        best = -np.inf
        for number in cells.get((row // factor, col // factor), []):
            corner = projected[triangles[number]]
            edges = corner[1:, :2] - corner[0, :2]
            if abs(np.linalg.det(edges)) < 1e-12:
                continue
            share = np.linalg.solve(edges.T, (col, row) - corner[0, :2])
            near = corner[0, 2] + share @ (corner[1:, 2] - corner[0, 2])
            if share.min() >= 0 and share.sum() <= 1 and near > best:
                best, found[row, col] = near, number
    return found


def soup(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of any size in any place of a cube."""
    rng = np.random.default_rng(seed)
    centres = np.repeat(rng.uniform(-8, 48, (count, 3)), 3, axis=0)
    return centres + rng.normal(0, 6, centres.shape), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def facing(centre=(0.0, 0.0, 10.0), angles=(0.0, 0.0, 0.0), camera: Camera = CAMERA) -> View:
    return View("view", camera, rotation_matrix(*angles), np.array(centre))


def sheet(count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A rough surface of (count - 1)^2 x 2 triangles over 8 x 8 m."""
    x, y = np.meshgrid(np.linspace(-4, 4, count), np.linspace(-4, 4, count))
    z = 0.6 * np.sin(2 * x) * np.cos(1.5 * y) + rng.normal(0, 0.004, x.shape)
    i = np.arange(count**2).reshape(count, count)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel()
    triangles = np.vstack([np.column_stack([a, b, c]), np.column_stack([b, d, c])])
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()]), triangles.astype(np.int32)


def test_scanline_and_grid_look_up_agree(record_property):
    vertices, triangles = soup(1, 150)
    raster = nearest_triangles(DOWN, vertices * [1, -1, 1], triangles, Window(0, 0, 40, 44))
    differing = np.mean(raster.triangle != looked_up(vertices, triangles, (40, 44)))
    record_property("found", f"{differing:.2%} of the pixels differ")
    assert differing < 1e-3
    assert 0.5 < np.mean(raster.triangle >= 0) < 1.0


def test_a_sloped_plane_has_the_depth_of_its_equation(record_property):
    vertices = np.array([[-3.0, -3, 1], [4, -3, 2], [0, 5, -1]])
    view = facing(angles=(0.1, -0.2, 0.4))
    raster = nearest_triangles(central_projection(view, (0.0, 0.0, 0.0)), vertices, np.array([[0, 1, 2]]), Window(0, 0, 120, 160))
    row, col = np.nonzero(raster.triangle == 0)
    normal = np.cross(vertices[1] - vertices[0], vertices[2] - vertices[0])
    rays = view.rays(np.column_stack([col, row]))
    along = (vertices[0] - view.centre) @ normal / (rays @ normal)
    depth = along * -(rays @ view.rotation[2])
    assert len(row) > 2000
    worst = np.abs(1.0 / raster.nearness[row, col] / depth - 1.0).max()
    record_property("found", f"{worst:.1e} of the depth at most")
    assert worst < 1e-6


def test_of_two_stacked_squares_the_nearer_one_is_kept_everywhere(record_property):
    square = np.array([[0.0, 0], [20, 0], [20, -20], [0, -20]])
    vertices = np.vstack([np.column_stack([square, np.full(4, z)]) for z in (1.0, 2.0)])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    raster = nearest_triangles(DOWN, vertices, triangles, Window(0, 0, 21, 21))
    record_property("found", f"the nearer one at {np.mean(raster.nearness == 2.0):.1%} of {raster.nearness.size} pixels")
    assert np.all(raster.nearness == 2.0)
    assert set(np.unique(raster.triangle)) == {2, 3}


def test_a_large_origin_costs_no_digits():
    vertices, triangles = sheet(20, np.random.default_rng(2))
    origin = (476000.0, 4204000.0, 120.0)
    near, far = facing(), facing(np.array([0.0, 0, 10]) + origin)
    window = Window(0, 0, 120, 160)
    first = nearest_triangles(central_projection(near, (0.0, 0.0, 0.0)), vertices, triangles, window)
    second = nearest_triangles(central_projection(far, origin), vertices, triangles, window)
    assert np.array_equal(first.triangle, second.triangle)


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 10**6), row=st.integers(-5, 30), col=st.integers(-5, 30), order=st.randoms(use_true_random=False))
def test_a_window_holds_what_the_whole_raster_holds_in_any_order_of_triangles(seed, row, col, order):
    vertices, triangles = soup(seed, 40)
    whole = nearest_triangles(DOWN, vertices * [1, -1, 1], triangles, Window(-8, -8, 60, 60))
    part, numbers = empty_raster(Window(row, col, 13, 9)), list(range(len(triangles)))
    order.shuffle(numbers)
    for half in (numbers[:17], numbers[17:]):
        add_triangles(part, DOWN, vertices * [1, -1, 1], triangles[half], np.array(half))
    inner = Window(row + 8, col + 8, 13, 9).slices
    assert np.array_equal(part.triangle, whole.triangle[inner])
    assert np.array_equal(part.nearness, whole.nearness[inner])


def test_no_gap_opens_between_neighbours_of_a_closed_sheet():
    vertices, triangles = sheet(60, np.random.default_rng(3))
    view = facing((0.2, -0.1, 4.0), (0.1, 0.05, 0.7))
    raster = nearest_triangles(central_projection(view, (0.0, 0.0, 0.0)), vertices, triangles, Window(0, 0, 120, 160))
    border = np.vstack(
        [vertices.reshape(60, 60, 3)[[0, -1]].reshape(-1, 3), vertices.reshape(60, 60, 3)[:, [0, -1]].reshape(-1, 3)]
    )
    # The frame lies within the sheet: every pixel shows it.
    assert not view.contains(view.project(border)).any()
    assert np.all(raster.triangle >= 0)


def test_ground_that_passes_below_the_camera_is_cut_and_not_lost():
    vertices = np.array([[-500.0, -500, 0], [500, -500, 0], [500, 500, 0], [-500, 500, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    # Looking to the horizon, 1.7 m above the ground: the lower half of the photograph shows it.
    view = facing((0.0, 0.0, 1.7), (np.pi / 2, 0.0, 0.0))
    raster = nearest_triangles(central_projection(view, (0.0, 0.0, 0.0)), vertices, triangles, Window(0, 0, 120, 160))
    horizon = view.numbers.row0
    shown = raster.triangle >= 0
    assert shown[int(np.ceil(horizon)) + 1 :].all() and not shown[: int(horizon)].any()
    np.testing.assert_allclose(1.0 / raster.nearness[100], 1.7 * CAMERA.c / (100 - horizon), rtol=1e-6)


def test_triangles_behind_the_camera_or_edge_on_or_not_finite_show_nothing():
    vertices = np.array([[-1.0, -1, 12], [1, -1, 12], [0, 1, 12], [0, 0, 0], [0, 1, 3], [0, 2, 5], [np.nan, 0, 0], [1, 1, 1]])
    triangles = np.array([[0, 1, 2], [3, 4, 5], [6, 7, 3]])
    view = facing((0.0, 0.0, 10.0))
    raster = nearest_triangles(central_projection(view, (0.0, 0.0, 0.0)), vertices, triangles, Window(0, 0, 120, 160))
    assert np.all(raster.triangle == NOTHING)


def test_ray_casting_meets_the_same_triangles():
    caster = pytest.importorskip("embreex", reason="embreex, the reference for ray casting, is not installed")
    trimesh = pytest.importorskip("trimesh")
    del caster
    vertices, triangles = sheet(150, np.random.default_rng(4))
    view = facing((1.0, -2.5, 5.0), (0.35, 0.2, 0.3))
    raster = nearest_triangles(central_projection(view, (0.0, 0.0, 0.0)), vertices, triangles, Window(0, 0, 120, 160))
    row, col = (values.ravel() for values in np.indices((120, 160)))
    rays = view.rays(np.column_stack([col, row]))
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    expected = mesh.ray.intersects_first(np.tile(view.centre, (len(rays), 1)), rays)
    assert np.mean(raster.triangle.ravel() == expected) >= 0.9999


@pytest.mark.parametrize(
    ("vertices", "triangles", "colours", "words"),
    [
        (np.zeros((3, 2)), np.zeros((1, 3), np.int32), None, "must both be"),
        (np.zeros((3, 3)), np.array([[0, 1, 3]]), None, "0 to 3 of 3"),
        (np.zeros((3, 3)), np.array([[0, 1, 2]]), np.zeros((2, 3), np.uint8), "2 colours for 3"),
    ],
)
def test_a_mesh_that_contradicts_itself_cannot_be_built(vertices, triangles, colours, words):
    with pytest.raises(ValueError, match=words):
        TriangleMesh(vertices, triangles, colours=colours)


def test_bounds_and_corners_of_a_mesh_with_an_origin():
    mesh = TriangleMesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 3]]), np.array([[0, 1, 2]]), (100.0, 200.0, 300.0))
    low, high = mesh.bounds
    assert low.tolist() == [100, 200, 300] and high.tolist() == [101, 202, 303]
    assert mesh.corners.shape == (1, 3, 3)
