"""The portal as a triangle mesh, from patches: walls, barrels, rings, columns, steps, a door and a niche.

Axes: x to the right along the facade, y into the wall, z upwards, m; (0, 0, 0) is on the ground before the middle of the door. A
patch is a grid of points with coordinates of its surface in metres, from which its material is painted; its front is towards the
viewer. Patches that share an edge of one length divide it alike, so that their vertices are the same.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from functools import cache

import numpy as np

Corner = tuple[float, float, float]
Shape = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, ...]]
_DOOR_ARCH, _NICHE, _SPRING = 1.3, 0.6, 3.1
_PORCH_IN, _PORCH_OUT, _PORCH_SPRING, _PORCH_FRONT = 1.45, 2.0, 3.6, -1.05
_BACK, _DOOR = 0.9, 1.1
"""y of the wall behind the arch, and of the door in it"""
COLUMN = (1.725, -0.75, 0.15)
"""x (on either side), y and lower radius of a column"""
SHAFT = (0.65, 3.0)
"""z of the foot and the head of its shaft"""
_STEP, _TREADS = 0.15, 3


class PortalMaterial(IntEnum):
    """What a triangle is made of; counted from 1, 0 is the sky."""

    MASONRY = 1
    MARBLE = 2
    STEPS = 3
    FRESCO = 4
    WOOD = 5
    VOUSSOIRS = 6
    TILES = 7
    PAVING = 8
    PLASTER = 9
    CLOTH = 10
    SKIN = 11
    LEAF = 12


@dataclass(frozen=True, eq=False)
class PortalMesh:
    """`vertices` (V, 3) m along the portal's axes, `triangles` (T, 3) int32, `place` (V, 2) m on the surface of the patch, and the
    `material` (T,) uint8."""

    vertices: np.ndarray
    triangles: np.ndarray
    place: np.ndarray
    material: np.ndarray


@dataclass(frozen=True, eq=False)
class Patch:
    """Points (rows + 1, cols + 1, 3) and their places (rows + 1, cols + 1, 2); the cross product of the directions in which columns
    and rows are counted is towards the viewer."""

    points: np.ndarray
    place: np.ndarray
    material: PortalMaterial


def joined(patches: list[Patch]) -> PortalMesh:
    """One mesh of all patches; triangles without area, at the poles of domes, are left out."""
    vertices, triangles, place, material, count = [], [], [], [], 0
    for patch in patches:
        rows, cols = patch.points.shape[:2]
        number = count + np.arange(rows * cols, dtype=np.int32).reshape(rows, cols)
        a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
        triangles.append(np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])]))
        vertices.append(patch.points.reshape(-1, 3))
        place.append(patch.place.reshape(-1, 2))
        material.append(np.full(len(triangles[-1]), patch.material, np.uint8))
        count += rows * cols
    points, corners = np.concatenate(vertices), np.concatenate(triangles)
    A, B, C = (points[corners[:, k]] for k in range(3))
    good = np.linalg.norm(np.cross(B - A, C - A), axis=1) > 1e-9
    return PortalMesh(points, corners[good], np.concatenate(place), np.concatenate(material)[good])


@cache
def portal_mesh(cell: float) -> PortalMesh:
    """The whole portal, triangles with sides of about `cell` m (coarser far from the door)."""
    return joined(list(_patches(cell)))


def _patches(cell: float) -> Iterator[Patch]:
    yield from _facade(cell)
    yield from _arch_and_niche(cell)
    yield from _steps(cell)
    yield from _porch(cell)
    for side in (-1, 1):
        yield from _column(side * COLUMN[0], cell)


def _flat(corner: Corner, right: Corner, up: Corner, material: PortalMaterial, cell: float) -> Patch:
    """A rectangle from its lower left corner, with the two sides that begin there; its place is that along the sides."""
    along, above = np.array(right), np.array(up)
    wide, high = float(np.linalg.norm(along)), float(np.linalg.norm(above))
    u, v = (np.linspace(0.0, 1.0, max(round(side / cell), 1) + 1) for side in (wide, high))
    points = np.array(corner) + u[None, :, None] * along + v[:, None, None] * above
    # Counted from the axes of the portal, so that courses of masonry run on from patch to patch.
    begin = np.array([np.dot(corner, along) / wide, np.dot(corner, above) / high])
    place = begin + np.stack(np.broadcast_arrays(u[None, :] * wide, v[:, None] * high), axis=2)
    return Patch(points, place, material)


def _curved(
    shape: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, ...]],
    sides: tuple[float, float],
    material: PortalMaterial,
    cell: float,
) -> Patch:
    """A patch x, y, z = shape(u, v) of u and v in [0, 1], whose sides are about so long, m."""
    u, v = (np.linspace(0.0, 1.0, max(round(side / cell), 1) + 1) for side in sides)
    u, v = np.broadcast_arrays(u[None, :], v[:, None])
    points = np.stack(np.broadcast_arrays(*shape(u, v)), axis=2)
    return Patch(points, np.stack([u * sides[0], v * sides[1]], axis=2), material)


def _arc(u: np.ndarray, radius: np.ndarray | float, spring: float) -> tuple[np.ndarray, np.ndarray]:
    """x and z along a semicircle, from the left over the top to the right."""
    angle = np.pi * (1.0 - u)
    return radius * np.cos(angle), spring + radius * np.sin(angle)


def _facade(cell: float) -> Iterator[Patch]:
    wall, edge = PortalMaterial.MASONRY, _DOOR_ARCH
    for left, right, scale in ((-9.0, -3.3, 3.0), (-3.3, -edge, 1.0), (edge, 3.3, 1.0), (3.3, 9.0, 3.0)):
        yield _flat((left, 0.0, 0.0), (right - left, 0, 0), (0, 0, 8.5), wall, scale * cell)
    yield _flat((-edge, 0.0, 4.6), (2 * edge, 0, 0), (0, 0, 3.9), wall, cell)

    def spandrel(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
        x, z = _arc(u, edge, _SPRING)
        return x + v * ((2 * u - 1) * edge - x), np.zeros(()), z + v * (4.6 - z)

    patch = _curved(spandrel, (np.pi * edge, 0.9), wall, cell)
    yield Patch(patch.points, patch.points[:, :, [0, 2]], wall)
    yield _flat((-9.0, -5.2, 0.0), (18.0, 0, 0), (0, 5.2, 0), PortalMaterial.PAVING, 2.0 * cell)


def _arch_and_niche(cell: float) -> Iterator[Patch]:
    edge, plaster, half = _DOOR_ARCH, PortalMaterial.PLASTER, 0.7
    low, lintel = _STEP * _TREADS, 2.6
    yield _flat((-edge, 0.0, low), (0, _BACK, 0), (0, 0, _SPRING - low), PortalMaterial.VOUSSOIRS, cell)
    yield _flat((edge, _BACK, low), (0, -_BACK, 0), (0, 0, _SPRING - low), PortalMaterial.VOUSSOIRS, cell)
    yield _barrel(edge, _SPRING, (_BACK, 0.0), PortalMaterial.VOUSSOIRS, cell)
    for left, right, bottom in ((-edge, -half, low), (half, edge, low), (-half, half, lintel)):
        yield _flat((left, _BACK, bottom), (right - left, 0, 0), (0, 0, _SPRING - bottom), plaster, cell)
    yield _ring((_NICHE, edge), _SPRING, _BACK, PortalMaterial.FRESCO, cell)

    def conch(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
        x, z = _arc(u, _NICHE * np.cos(0.5 * np.pi * (1.0 - v)), _SPRING)
        return x, _BACK + _NICHE * np.sin(0.5 * np.pi * (1.0 - v)), z

    # From the pole to the rim, so that its front is the hollow side.
    yield _curved(lambda u, v: conch(1.0 - u, 1.0 - v), (np.pi * _NICHE, 0.5 * np.pi * _NICHE), PortalMaterial.FRESCO, cell)
    yield _curved(
        lambda u, v: (-v * _NICHE * np.cos(np.pi * u), _BACK + v * _NICHE * np.sin(np.pi * u), np.full((), _SPRING)),
        (np.pi * _NICHE, _NICHE),
        PortalMaterial.MARBLE,
        cell,
    )
    yield _flat((-half, _DOOR, low), (2 * half, 0, 0), (0, 0, lintel - low), PortalMaterial.WOOD, cell)
    yield _flat((-half, _BACK, low), (0, _DOOR - _BACK, 0), (0, 0, lintel - low), PortalMaterial.MARBLE, cell)
    yield _flat((half, _DOOR, low), (0, _BACK - _DOOR, 0), (0, 0, lintel - low), PortalMaterial.MARBLE, cell)
    yield _flat((-half, _DOOR, lintel), (2 * half, 0, 0), (0, _BACK - _DOOR, 0), PortalMaterial.MARBLE, cell)


def _barrel(radius: float, spring: float, depth: tuple[float, float], material: PortalMaterial, cell: float) -> Patch:
    """The half cylinder between two y: seen from below where the first is the deeper one, from above otherwise."""

    def shape(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
        x, z = _arc(u, radius, spring)
        return x, depth[0] + v * (depth[1] - depth[0]), z

    return _curved(shape, (np.pi * radius, abs(depth[1] - depth[0])), material, cell)


def _ring(radii: tuple[float, float], spring: float, y: float, material: PortalMaterial, cell: float) -> Patch:
    """The half ring between two radii, seen from the front."""

    def shape(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
        x, z = _arc(u, radii[0] + v * (radii[1] - radii[0]), spring)
        return x, np.full((), y), z

    return _curved(shape, (np.pi * radii[1], radii[1] - radii[0]), material, cell)


def _steps(cell: float) -> Iterator[Patch]:
    stone = PortalMaterial.STEPS
    for k in range(_TREADS):
        front, half, low, top = -1.9 + 0.3 * k, 2.9 - 0.3 * k, _STEP * k, _STEP * (k + 1)
        yield _flat((-half, front, low), (2 * half, 0, 0), (0, 0, _STEP), stone, 0.5 * cell)
        yield _flat((-half, 0.0, low), (0, front, 0), (0, 0, _STEP), stone, 0.5 * cell)
        yield _flat((half, front, low), (0, -front, 0), (0, 0, _STEP), stone, 0.5 * cell)
        deep = 0.3 if k < _TREADS - 1 else -front
        yield _flat((-half, front, top), (2 * half, 0, 0), (0, deep, 0), stone, cell)
        if k < _TREADS - 1:
            for left in (-half, half - 0.3):
                yield _flat((left, front + 0.3, top), (0.3, 0, 0), (0, -front - 0.3, 0), stone, cell)
    yield _flat((-_DOOR_ARCH, 0.0, _STEP * _TREADS), (2 * _DOOR_ARCH, 0, 0), (0, _DOOR, 0), stone, cell)


def _porch(cell: float) -> Iterator[Patch]:
    yield _ring((_PORCH_IN, _PORCH_OUT), _PORCH_SPRING, _PORCH_FRONT, PortalMaterial.VOUSSOIRS, cell)
    yield _barrel(_PORCH_IN, _PORCH_SPRING, (0.0, _PORCH_FRONT), PortalMaterial.PLASTER, cell)
    yield _barrel(_PORCH_OUT, _PORCH_SPRING, (_PORCH_FRONT, 0.0), PortalMaterial.TILES, cell)


def _column(x: float, cell: float) -> Iterator[Patch]:
    y, radius, marble = COLUMN[1], COLUMN[2], PortalMaterial.MARBLE
    ground = _STEP * _TREADS
    yield from _box((x - 0.24, y - 0.24, ground), (0.48, 0.48, SHAFT[0] - ground), marble, cell)
    profile = ((SHAFT[0], radius + 0.05), (SHAFT[0] + 0.1, radius), (SHAFT[1], radius - 0.012), (SHAFT[1] + 0.05, radius + 0.02))
    yield _turned((x, y), (*profile, (SHAFT[1] + 0.3, 0.27)), marble, 0.3 * cell)
    yield from _box((x - 0.29, y - 0.29, 3.3), (0.58, 0.58, 0.1), marble, 0.5 * cell)
    # The beam from the column back to the wall carries the porch.
    yield from _box((x - 0.29, _PORCH_FRONT, 3.4), (0.58, -_PORCH_FRONT, 0.2), marble, 0.5 * cell)


def _box(corner: Corner, size: Corner, material: PortalMaterial, cell: float) -> Iterator[Patch]:
    """All sides of a box but its back, from the corner with the least coordinates."""
    (x, y, z), (a, b, c) = corner, size
    yield _flat((x, y, z), (a, 0, 0), (0, 0, c), material, cell)
    yield _flat((x, y + b, z), (0, -b, 0), (0, 0, c), material, cell)
    yield _flat((x + a, y, z), (0, b, 0), (0, 0, c), material, cell)
    yield _flat((x, y, z + c), (a, 0, 0), (0, b, 0), material, cell)
    yield _flat((x, y + b, z), (a, 0, 0), (0, -b, 0), material, cell)


def _turned(axis: tuple[float, float], profile: tuple[tuple[float, float], ...], material: PortalMaterial, cell: float) -> Patch:
    """A body of revolution about an upright axis from (z, radius) upwards."""
    z, radius = np.array(profile).T

    def shape(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
        at = z[0] + v * (z[-1] - z[0])
        r, angle = np.interp(at, z, radius), 2.0 * np.pi * u
        return axis[0] + r * np.sin(angle), axis[1] - r * np.cos(angle), at

    return _curved(shape, (2.0 * np.pi * float(radius.mean()), float(z[-1] - z[0])), material, cell)


def person(x: float, y: float) -> PortalMesh:
    """Somebody who stands at (x, y), 1.74 m tall, on what is there."""
    ground = max((_STEP * (k + 1) for k in range(_TREADS) if y > -1.9 + 0.3 * k and abs(x) < 2.9 - 0.3 * k), default=0.0)
    legs, coat = ((0.0, 0.1), (0.5, 0.13), (0.88, 0.17)), ((0.75, 0.24), (1.1, 0.2), (1.38, 0.23), (1.5, 0.07))
    head = tuple((1.6 - 0.14 * np.cos(a), 0.02 + 0.095 * np.sin(a)) for a in np.linspace(0.15, np.pi - 0.05, 7))
    parts = ((legs, PortalMaterial.WOOD), (coat, PortalMaterial.CLOTH), (head, PortalMaterial.SKIN))
    return joined([_turned((x, y), tuple((ground + z, r) for z, r in part), material, 0.06) for part, material in parts])


def leaves(middle: np.ndarray, size: float, count: int, seed: int) -> PortalMesh:
    """A twig with `count` leaves of 5 to 9 cm in a cloud of `size` m about the point `middle` (3,)."""
    generator = np.random.default_rng([seed, 71])
    corners = []
    for _ in range(count):
        place = middle + generator.normal(0.0, size, 3) * (1.0, 0.5, 0.6)
        along, across = np.linalg.qr(generator.normal(size=(3, 2)))[0].T * generator.uniform(0.025, 0.045)
        corners.append([place - along, place - 0.5 * across, place + along, place + 0.5 * across])
    vertices = np.array(corners).reshape(-1, 3)
    first = 4 * np.arange(count, dtype=np.int32)
    triangles = np.concatenate([np.column_stack([first, first + 1, first + 2]), np.column_stack([first, first + 2, first + 3])])
    place = np.tile([[0.0, 0.0], [0.05, 0.0], [0.1, 0.05], [0.05, 0.05]], (count, 1)) + np.repeat(np.arange(count), 4)[:, None]
    return PortalMesh(vertices, triangles, place, np.full(len(triangles), PortalMaterial.LEAF, np.uint8))


def with_objects(mesh: PortalMesh, objects: list[PortalMesh]) -> PortalMesh:
    """The mesh with others added to it."""
    parts = [mesh, *objects]
    first = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return PortalMesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.triangles + np.int32(start) for part, start in zip(parts, first, strict=True)]),
        np.concatenate([part.place for part in parts]),
        np.concatenate([part.material for part in parts]),
    )
