"""A column photographed from all sides, traced without a mesh, and unrolled: place, depth and colour of every pixel are known."""

import numpy as np
import pytest

from orthomill.schemas.camera import Camera
from orthomill.schemas.orientation import ExteriorOrientation
from orthomill.schemas.solid.mesh import TriangleMesh
from orthomill.tasks.geometry.rotation import angles
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.projection.frames.projection_frames import looking_at
from orthomill.tasks.projection.stage import ProjectionStage
from tests.support.engine.memory_runner import MemoryProject
from tests.support.solid import wall_and_box as scene

RADIUS, HEIGHT = 0.5, 2.0
CAMERA = Camera(name="cam", width=200, height=160, c=180.0)


def mesh(side: int, outwards: bool) -> TriangleMesh:
    """A column of `side` faces about the vertical axis."""
    turn = np.linspace(0, 2 * np.pi, side, endpoint=False)
    ring = RADIUS * np.column_stack([np.cos(turn), np.sin(turn)])
    vertices = np.vstack([np.column_stack([ring, np.full(side, z)]) for z in (0.0, HEIGHT)])
    k, n = np.arange(side), (np.arange(side) + 1) % side
    faces = np.vstack([np.column_stack([k, n, n + side]), np.column_stack([k, n + side, k + side])])
    return TriangleMesh(vertices, (faces if outwards else faces[:, ::-1]).astype(np.int32))


def colour(points: np.ndarray) -> np.ndarray:
    return 120 + 40 * np.stack(
        [np.sin(5 * points[:, 0] + k) * np.cos(4 * points[:, 2]) + np.sin(4 * points[:, 1]) for k in range(3)], 1
    )


def photograph(view: View, inside: bool) -> np.ndarray:
    """The column from outside, or the shaft from inside; black beside it."""
    row, col = np.indices((160, 200))
    rays, c = view.rays(np.column_stack([col.ravel(), row.ravel()])), view.centre
    a, b = (rays[:, :2] ** 2).sum(axis=1), rays[:, :2] @ c[:2]
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b**2 - a * (c[:2] @ c[:2] - RADIUS**2))
    points = c + ((-b + (root if inside else -root)) / a)[:, None] * rays
    known = np.isfinite(points).all(axis=1) & (points[:, 2] >= 0) & (points[:, 2] <= HEIGHT)
    values = np.where(known[:, None], colour(np.nan_to_num(points)), 0.0)
    return np.clip(np.rint(values), 0, 255).astype(np.uint8).reshape(160, 200, 3)


@pytest.mark.parametrize("seen_from", ["outside", "axis"])
def test_an_unrolled_column_and_shaft(seen_from, record_property):
    inside = seen_from == "axis"
    turns = np.linspace(0, 2 * np.pi, 6, endpoint=False)
    reach = 0.1 if inside else 2.5
    poses = []
    for name, turn in zip("abcdef", turns, strict=True):
        place = np.array([reach * np.cos(turn), reach * np.sin(turn), 1.0])
        target = -place + [0, 0, 2.0] if inside else np.array([0.0, 0.0, 1.0])
        pose = tuple(map(float, np.degrees(angles(looking_at(place, target)))))
        poses.append(ExteriorOrientation(photo=name, centre=tuple(place), omega_phi_kappa=pose))
    block = scene.block(camera=CAMERA).model_copy(update={"photos": tuple(poses), "of_photo": dict.fromkeys("abcdef", "cam")})
    pictures = {name: photograph(block_view(block, name), inside) for name in "abcdef"}
    project = scene.project_of(MemoryProject, tuple("abcdef"), block, pictures, surface=mesh(90, not inside))
    output = {"kind": "cylinder", "foot": (0, 0, 0.8), "head": (0, 0, 1.2), "radius": RADIUS, "reach": 0.3, "pixel": 0.02}
    given = {"surface": {"kind": "mesh", "path": "mesh.ply"}, "outputs": [{**output, "seen_from": seen_from}]}
    project.run(ProjectionStage.model_validate({**given, "balance": {"kind": "none"}, "leave_one_out": {"kind": "none"}}))
    ortho = project.rasters["projection/unrolled/ortho"]
    assert ortho.shape == (20, 157, 4)
    assert (ortho[..., 3] > 0).mean() > 0.99
    np.testing.assert_allclose(np.abs(project.rasters["projection/unrolled/nearness"]), RADIUS, atol=0.002)
    # The middle column faces south; from outside columns run to the east, from the axis, looking south, to the west.
    turn = (np.arange(157) + 0.5 - 78.5) * 0.02 / RADIUS * (-1 if inside else 1) - np.pi / 2
    x, z = np.meshgrid(turn, 1.2 - (np.arange(20) + 0.5) * 0.02)
    truth = colour(np.column_stack([RADIUS * np.cos(x.ravel()), RADIUS * np.sin(x.ravel()), z.ravel()])).reshape(20, 157, 3)
    error = np.abs(ortho[..., :3] - truth).mean(axis=2)[ortho[..., 3] > 0]
    record_property(
        "found",
        f"from the {seen_from}: {(ortho[..., 3] > 0).mean():.1%} coloured, within {np.percentile(error, 95):.1f} grey levels",
    )
    assert np.percentile(error, 95) < 3.0
