"""The first point of a surface on a ray, against closed forms, and its covariance against many drawn ones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.camera import Camera
from orthomill.schemas.errors import PhotoError
from orthomill.schemas.orientation import Block, ExteriorOrientation
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.inspections.image_points import points_on_surface
from orthomill.tasks.visibility.monoplotting import SurfaceHeights, first_points, point_covariance, surface_normals

CAMERA = Camera(name="a", width=1000, height=800, c=1200.0, x0=3.0, y0=-2.0)
GRID = MapGrid(west=-200.0, north=200.0, cell=2.0, rows=200, cols=200)
ANGLES = (0.03, -0.05, 0.4)


def view(centre=(5.0, -10.0, 300.0), angles=ANGLES) -> View:
    return View("a", CAMERA, rotation_matrix(*angles), np.array(centre))


def surface(height) -> SurfaceHeights:
    x, y = np.meshgrid(*GRID.centres(Window(0, 0, *GRID.shape)))
    return SurfaceHeights(np.broadcast_to(height(x, y), GRID.shape).astype(np.float32), GRID)


@given(st.floats(0, 999), st.floats(0, 799), st.floats(-0.4, 0.4), st.floats(-0.4, 0.4))
@settings(deadline=None, max_examples=40)
def test_a_plane_is_met_where_the_ray_meets_it(col, row, east, north):
    point = first_points(view(), np.array([[col, row]]), surface(lambda x, y: 20 + east * x + north * y))[0]
    assert point[2] == pytest.approx(20 + east * point[0] + north * point[1], abs=1e-3)
    assert np.allclose(view().project(point[None])[0], [col, row], atol=1e-5)


def test_a_curved_surface_is_met_as_well():
    pixels = np.random.default_rng(1).uniform((0, 0), (999, 799), (200, 2))
    waves = surface(lambda x, y: 15 * np.sin(x / 30) * np.cos(y / 40))
    points = first_points(view(), pixels, waves)
    assert np.abs(points[:, 2] - 15 * np.sin(points[:, 0] / 30) * np.cos(points[:, 1] / 40)).max() < 0.05
    assert np.abs(view().project(points) - pixels).max() < 1e-5


def test_a_ray_stops_at_the_roof_before_it_and_not_at_the_street_behind():
    house = surface(lambda x, y: np.where((np.abs(x - 80) < 10), 40.0, 0.0))
    level = view(centre=(0.0, 0.0, 100.0), angles=(0.0, 0.0, 0.0))
    through_roof = level.project(np.array([[80.0, 0.0, 40.0]]))
    assert first_points(level, through_roof, house)[0] == pytest.approx([80.0, 0.0, 40.0], abs=1e-3)
    behind = level.project(np.array([[95.0, 0.0, 0.0]]))
    assert first_points(level, behind, house)[0][0] < 91.0


def test_rays_that_hit_nothing_have_no_point():
    empty = SurfaceHeights(np.full(GRID.shape, np.nan, np.float32), GRID)
    pixels = np.array([[500.0, 400.0]])
    assert np.isnan(first_points(view(), pixels, empty)).all()
    upwards = view(angles=(np.pi / 2, 0.0, 0.0))
    assert np.isnan(first_points(upwards, np.array([[500.0, 100.0]]), surface(lambda x, y: 0 * x))).all()
    beside = view(centre=(2000.0, 0.0, 300.0), angles=(0.0, 0.0, 0.0))
    assert np.isnan(first_points(beside, pixels, surface(lambda x, y: 0 * x))).all()


def test_normals_are_those_of_the_slope():
    normal = surface_normals(np.array([[0.0, 0.0, 20.0]]), surface(lambda x, y: 20 + 0.3 * x - 0.2 * y))[0]
    assert normal == pytest.approx([-0.3, 0.2, 1.0], abs=1e-4)


def test_the_covariance_is_that_of_many_drawn_orientations_pixels_and_heights():
    rng, pixel, slope = np.random.default_rng(3), np.array([850.0, 120.0]), np.array([-0.2, 0.1, 1.0])
    sigmas = np.array([0.2, 0.3, 0.1, 1e-3, 8e-4, 5e-4])
    point = first_points(view(), pixel[None], surface(lambda x, y: 20 + 0.2 * x - 0.1 * y))[0]
    stated = point_covariance(view(), np.diag(sigmas**2), ANGLES, pixel, point, slope, (0.5, 0.4))
    drawn = []
    for _ in range(4000):
        shift = rng.normal(0, sigmas)
        moved = view(np.array([5.0, -10.0, 300.0]) + shift[:3], np.array(ANGLES) + shift[3:])
        ray, lift = moved.rays((pixel + rng.normal(0, 0.5, 2))[None])[0], np.array([0, 0, rng.normal(0, 0.4)])
        drawn.append(moved.centre + ray * ((point + lift - moved.centre) @ slope) / (ray @ slope))
    assert np.allclose(np.sqrt(np.diag(stated)), np.std(drawn, axis=0), rtol=0.06)
    assert np.corrcoef(np.array(drawn).T)[0, 2] == pytest.approx(stated[0, 2] / np.sqrt(stated[0, 0] * stated[2, 2]), abs=0.06)


def block_of_three() -> Block:
    places = {"a": (-60.0, 0.0, 300.0), "b": (60.0, 0.0, 300.0), "c": (900.0, 0.0, 300.0)}
    photos = tuple(ExteriorOrientation(photo=name, centre=at, omega_phi_kappa=(0.0, 0.0, 0.0)) for name, at in places.items())
    return Block(
        crs="EPSG:2100", cameras={"a": CAMERA}, of_photo=dict.fromkeys(places, "a"), photos=photos, datum="free", sigma0_px=0.3,
        redundancy=9, iterations=1, ground_low=0.0, ground_high=40.0,
    )  # fmt: skip


def test_photographs_that_see_a_point_are_named_and_those_behind_a_house_are_not():
    block, house = block_of_three(), surface(lambda x, y: np.where(np.abs(x) < 4, 40.0, 0.0))
    open_place, hidden = np.array([[-30.0, 20.0, 0.0], [-5.0, 0.0, 0.0]])
    pixels = block_view(block, "a").project(np.array([open_place, hidden]))
    pixels = np.vstack([pixels, [[5000.0, 10.0]]])
    sigma = np.full(GRID.shape, 0.1, np.float32)
    found = points_on_surface(block, "a", pixels, GRID, house.heights, sigma, 0.5)
    assert found[0].photos == ("b",) and found[1].photos == () and found[2] is None
    assert found[0].place == pytest.approx(open_place, abs=1e-3)
    # Without a covariance of the orientation: half a pixel on the ground, and the height where the surface is level.
    assert np.sqrt(found[0].covariance[2][2]) == pytest.approx(0.1, rel=1e-3)
    assert np.sqrt(found[0].covariance[1][1]) == pytest.approx(0.5 * 300 / 1200, rel=0.02)


def test_a_photograph_that_is_not_in_the_block_is_named():
    with pytest.raises(PhotoError, match="z is not in the block; it holds a, b, c"):
        points_on_surface(block_of_three(), "z", np.zeros((1, 2)), GRID, np.zeros(GRID.shape), np.zeros(GRID.shape), 0.5)
