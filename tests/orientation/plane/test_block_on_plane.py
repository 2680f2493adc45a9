"""The block in the system of a plane: the same pictures of the same points, and the precision that goes with them."""

from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError

from orthomill.schemas.camera import Camera
from orthomill.schemas.job import Export, Job
from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.orientation import BLOCK, Block, ExteriorOrientation, JointCovariance, in_area
from orthomill.schemas.project import NoControl, PlaneAcross, PlaneSurface
from orthomill.tasks.geometry.view import block_view, view_of
from orthomill.tasks.orientation.plane.block_on_plane import SURVEY_BLOCK, block_on_plane
from orthomill.tasks.orientation.stage import OrientationStage

CAMERA = Camera(name="cam", width=1200, height=800, c=1000.0, x0=2.0, y0=-3.0, k1=-0.05)
CHOICE = PlaneAcross(kind="normal", point=(10.0, 20.0, 0.0), normal=(-0.6, -0.8, 0.1))
GROUND = PlaneSurface(kind="plane", plane=CHOICE)


def facade_block():
    """Two photographs of a wall, with covariances."""
    generator = np.random.default_rng(3)
    root = generator.normal(0, 0.01, (12, 12))
    joint, interior = root @ root.T, generator.normal(0, 1e-3, (6, 8))
    photos = tuple(
        ExteriorOrientation(
            photo=name,
            centre=centre,
            omega_phi_kappa=(88.0 + k, -35.0, 4.0),
            covariance=tuple(map(tuple, joint[6 * k : 6 * k + 6, 6 * k : 6 * k + 6].tolist())),
            with_interior={"cam": tuple(map(tuple, interior.tolist()))},
        )
        for k, (name, centre) in enumerate((("a", (3.0, 9.0, 2.0)), ("b", (5.5, 7.0, 2.2))))
    )
    both = JointCovariance(first="a", second="b", covariance=tuple(map(tuple, joint[:6, 6:].tolist())))
    block = Block(
        crs="EPSG:2100",
        cameras={"cam": CAMERA},
        of_photo={"a": "cam", "b": "cam"},
        photos=photos,
        datum="",
        sigma0_px=0.3,
        redundancy=10,
        iterations=3,
        ground_low=0,
        ground_high=5,
        joint=(both,),
    )
    xyz = np.array([10.0, 20.0, 3.0]) + generator.normal(0, 1, (30, 3))
    sigma = np.full(30, 0.02, np.float32)
    points = GroundPoints(
        np.arange(30, dtype=np.int32), *xyz.T, sigma, 2 * sigma, sigma, np.full(30, 2, np.int16), np.full(30, 0.2, np.float32)
    )
    return block, points, xyz, joint


def test_photographs_show_the_same_points_in_the_same_places():
    block, points, xyz, _ = facade_block()
    turned = block_on_plane(block, points, GROUND)
    moved = np.column_stack([turned.points.x, turned.points.y, turned.points.z])
    for name in ("a", "b"):
        assert block_view(turned.block, name).project(moved) == pytest.approx(block_view(block, name).project(xyz), abs=1e-6)
    axes = np.array([turned.plane.right, turned.plane.up, turned.plane.normal])
    assert np.array(turned.plane.origin) + moved @ axes == pytest.approx(xyz), "plane.json leads back"
    assert turned.plane.crs == "EPSG:2100" and turned.block.crs.startswith("ENGCRS")
    low = np.percentile(moved[in_area(turned.block.area, *moved[:, :2].T), 2], 0.5)
    assert turned.block.ground_low == pytest.approx(low) and turned.plane.area == turned.block.area


def test_standard_errors_of_points_follow_the_axes():
    block, points, _, _ = facade_block()
    turned = block_on_plane(block, points, GROUND)
    axes = np.array([turned.plane.right, turned.plane.up, turned.plane.normal])
    expected = np.sqrt(np.diag(axes @ np.diag([0.02**2, 0.04**2, 0.02**2]) @ axes.T))
    assert [turned.points.sigma_x[0], turned.points.sigma_y[0], turned.points.sigma_z[0]] == pytest.approx(expected, rel=1e-5)


def test_covariances_give_the_same_precision_of_what_is_seen():
    """Errors of the exterior orientation drawn in either system move image points alike."""
    block, points, xyz, _ = facade_block()
    turned = block_on_plane(block, points, GROUND)
    moved = np.column_stack([turned.points.x, turned.points.y, turned.points.z])
    here, there = (_image_covariance(b, p) for b, p in ((block, xyz), (turned.block, moved)))
    assert there == pytest.approx(here, rel=1e-4, abs=1e-4 * np.abs(here).max())


def _derivatives(photo, point, step=1e-5):
    columns = []
    for k in range(6):
        values = np.array([*photo.centre, *np.radians(photo.omega_phi_kappa)])
        pair = []
        for sign in (1, -1):
            v = values.copy()
            v[k] += sign * step
            other = photo.model_copy(update={"centre": tuple(v[:3]), "omega_phi_kappa": tuple(np.degrees(v[3:]))})
            pair.append(view_of(other, CAMERA).project(point[None])[0])
        columns.append((pair[0] - pair[1]) / (2 * step))
    return np.array(columns).T


def _image_covariance(block, points):
    """(4, 4) of the image coordinates of one point in both photographs, with the covariance between these."""
    a, b = (_derivatives(photo, points[0]) for photo in block.photos)
    between = np.array(block.joint[0].covariance)
    return np.block(
        [
            [a @ np.array(block.photos[0].covariance) @ a.T, a @ between @ b.T],
            [b @ between.T @ a.T, b @ np.array(block.photos[1].covariance) @ b.T],
        ]
    )


def test_the_covariance_with_the_camera_is_turned_alike():
    block, points, _, _ = facade_block()
    turned = block_on_plane(block, points, GROUND).block
    for before, after in zip(block.photos, turned.photos, strict=True):
        plan = np.array(after.with_interior["cam"])[:3]
        axes = np.array(block_on_plane(block, points, GROUND).plane.right)
        assert plan[0] == pytest.approx(axes @ np.array(before.with_interior["cam"])[:3])


def test_a_project_on_a_plane_keeps_its_cameras_in_its_own_system():
    project = SimpleNamespace(crs="EPSG:2100", grid=GROUND, control=NoControl(kind="none"))
    items = list(
        OrientationStage().plan(
            SimpleNamespace(project=project, has_stage=lambda kind: True, table=lambda table: SimpleNamespace(rays=100))
        )
    )
    jobs = {item.item: item for item in items if isinstance(item, Job)}
    assert jobs["block"].writes["block"] is SURVEY_BLOCK and jobs["report"].reads["block"] is SURVEY_BLOCK
    assert jobs["report"].reads["on_plane"] is BLOCK and jobs["overlap"].reads["block"] is BLOCK
    assert jobs["plane"].writes["block"] is BLOCK and jobs["plane"].params == {"ground": GROUND}
    exports = {item.path: item.tables for item in items if isinstance(item, Export)}
    assert exports["products/cameras.json"] == (SURVEY_BLOCK,) and "products/plane.json" in exports


def test_an_area_bounds_the_heights_and_needs_no_points():
    block, points, _, _ = facade_block()
    x, z = (getattr(block_on_plane(block, points, GROUND).points, axis) for axis in "xz")
    middle = float(np.median(x))
    given = GROUND.model_copy(update={"area": (middle, -100.0, middle + 50.0, 100.0)})
    turned = block_on_plane(block, points, given).block
    assert turned.area == given.area
    assert (turned.ground_low, turned.ground_high) == pytest.approx(np.percentile(z[x >= middle], [0.5, 99.5]))
    few = points.__class__(*(getattr(points, name)[:5] for name in points.__dataclass_fields__))
    assert block_on_plane(block, few, GROUND).block.area is None


def test_an_area_without_inside_is_a_mistake_of_the_workflow():
    with pytest.raises(ValidationError, match="no inside"):
        PlaneSurface(kind="plane", area=(0.0, 0.0, -1.0, 5.0))
