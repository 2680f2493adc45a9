"""Photographs of a wall with a box in front of it, traced ray by ray without any mesh: every colour and every shadow is known."""

from types import SimpleNamespace

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.schemas.orientation import Block, ExteriorOrientation
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.solid.mesh import TriangleMesh
from orthomill.tasks.geometry.rotation import angles
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.projection.frames.projection_frames import looking_at

LOW, HIGH = np.array([-0.3, -1.0, 0.0]), np.array([0.3, -0.6, 2.0])
"""corners of the box, m; the wall is y = 0, x from -2 to 2, z from 0 to 3, seen from negative y"""
WALL = (-2.0, 2.0, 0.0, 3.0)
CAMERA = Camera(name="cam", width=240, height=180, c=200.0, x0=2.0, y0=-1.5, k1=-0.05, k2=0.01)
POSITIONS = ((-2.4, -4.6, 1.4), (-0.9, -5.0, 1.8), (0.9, -5.0, 1.3), (2.4, -4.6, 1.6))
NAMES = ("a", "b", "c", "d")


def block(positions=POSITIONS, camera: Camera = CAMERA) -> Block:
    """The photographs, all looking at the middle of the scene."""
    poses = []
    for name, position in zip("abcdefghij", positions, strict=False):
        turn = np.degrees(angles(looking_at(np.array(position), np.array([0.0, -0.3, 1.4]))))
        poses.append(ExteriorOrientation(photo=name, centre=position, omega_phi_kappa=tuple(map(float, turn))))
    return Block(
        crs="EPSG:2100",
        cameras={"cam": camera},
        of_photo={pose.photo: "cam" for pose in poses},
        photos=tuple(poses),
        datum="free",
        sigma0_px=0.3,
        redundancy=10,
        iterations=1,
        ground_low=0.0,
        ground_high=3.0,
    )


def photos(names=NAMES, camera: Camera = CAMERA) -> Photos:
    return Photos(
        photos=tuple(
            Photo(name=n, path=f"{n}.png", width=camera.width, height=camera.height, bands=3, dtype="uint8", camera="cam")
            for n in names
        )
    )


def colour(points: np.ndarray, box: np.ndarray) -> np.ndarray:
    """(N, 3) grey levels of the surface at points (N, 3); the box (N,) bool is painted otherwise than the wall."""
    x, y, z = points.T
    waves = [np.sin(7 * x + 3 * z + k) + np.sin(5 * z - 4 * x + 2 * k) + np.sin(6 * y + 9 * x - k) for k in range(3)]
    wall = 120 + 18 * np.stack(waves, axis=1)
    return np.where(box[:, None], wall[:, ::-1] + [60, -30, -60], wall)


def traced(start: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First points (N, 3) of rays, NaN without; bool (N,) on the box; distance (N,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        wall = -start[:, 1] / along[:, 1]
        place = start + wall[:, None] * along
        inside = (place[:, 0] >= WALL[0]) & (place[:, 0] <= WALL[1]) & (place[:, 2] >= WALL[2]) & (place[:, 2] <= WALL[3])
        wall = np.where(inside & (wall > 1e-9), wall, np.inf)
        near, far = (LOW - start) / along, (HIGH - start) / along
    first, last = np.minimum(near, far).max(axis=1), np.maximum(near, far).min(axis=1)
    box = np.where((first < last) & (first > 1e-9), first, np.inf)
    distance = np.minimum(wall, box)
    points = start + np.where(np.isfinite(distance), distance, np.nan)[:, None] * along
    return points, box < wall, distance


def photograph(view: View) -> np.ndarray:
    """(rows, cols, 3) uint8; black where there is nothing."""
    row, col = np.indices((view.camera.height, view.camera.width))
    rays = view.rays(np.column_stack([col.ravel(), row.ravel()]))
    points, box, _ = traced(np.broadcast_to(view.centre, rays.shape), rays)
    values = np.where(np.isfinite(points[:, :1]), colour(np.nan_to_num(points), box), 0.0)
    return np.clip(np.rint(values), 0, 255).astype(np.uint8).reshape(*row.shape, 3)


def sees(view: View, points: np.ndarray) -> np.ndarray:
    """bool (N,): nothing lies between the camera and points (N, 3) of the surface, and they are in its frame."""
    along = points - view.centre
    distance = np.linalg.norm(along, axis=1)
    _, _, met = traced(np.broadcast_to(view.centre, points.shape), along / distance[:, None])
    return (met > distance - 1e-6) & view.contains(view.project(points))


def mesh(side: int = 24) -> TriangleMesh:
    """The wall in `side` x `side` squares and the box, with fronts outwards."""
    x, z = np.meshgrid(np.linspace(*WALL[:2], side + 1), np.linspace(*WALL[2:], side + 1))
    i = np.arange((side + 1) ** 2).reshape(side + 1, side + 1)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel()
    wall = np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()])
    corners = np.array([[xx, yy, zz] for xx in (0, 1) for yy in (0, 1) for zz in (0, 1)]) * (HIGH - LOW) + LOW
    faces = [(0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (1, 5, 7), (1, 7, 3)]
    faces += [(0, 2, 6), (0, 6, 4)]
    box = np.array(faces) + len(wall)
    triangles = np.vstack([np.column_stack([a, b, d]), np.column_stack([a, d, c]), box]).astype(np.int32)
    return TriangleMesh(np.vstack([wall, corners]), triangles)


def project_of(
    memory_project, names=NAMES, blocked: Block | None = None, pictures: dict | None = None, tile: int = 128, surface=None
):
    """A project in memory with the photographs, their levels and the mesh "mesh.ply"."""
    from orthomill.schemas.orientation import BLOCK
    from orthomill.schemas.photo import PHOTOS, photo_raster
    from orthomill.tasks.imagery.pyramid import halved

    oriented = blocked or block()
    project = memory_project(tile)
    listed = photos(names, oriented.camera_of(names[0]))
    project.tables = {BLOCK.path: oriented}
    project.files["mesh.ply"] = surface or mesh()
    leveled = []
    for photo in listed.photos:
        pixels = (pictures or {}).get(photo.name)
        pixels = photograph(block_view(oriented, photo.name)) if pixels is None else pixels
        for level in range(2):
            project.put(photo_raster(photo.name, level), pixels)
            project.specs[photo_raster(photo.name, level)] = SimpleNamespace(shape=pixels.shape, dtype="uint8")
            pixels = halved(pixels)
        leveled.append(photo.model_copy(update={"levels": 2}))
    project.tables[PHOTOS.path] = Photos(photos=tuple(leveled))
    return project
