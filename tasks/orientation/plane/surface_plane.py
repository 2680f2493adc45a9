"""The plane on which a surface stands: given, or found from the tie points.

A facade is upright: of all upright planes to whole degrees that one is taken between whose parallels, half of the points lie
closest together. Wrong points and everything before and behind the wall have no vote as long as they are fewer than half. A plane
that need not be upright is found the same way among planes through three points, and refined with the points near it.

Source: Rousseeuw 1984 for the least median of squares.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.project import FacadeFound, FittedPlane, PlaneChoice, PlaneOfPoints
from orthomill.tasks.orientation.plane.wall_area import LEAST_POINTS, shortest_halves

DIRECTIONS = 180
"""Upright planes that are compared: one for each degree"""
TRIPLES = 500
MOST_POINTS = 5000
"""Of more tie points an even selection finds the same plane."""
_LEVEL = 0.9
"""Cosine of the angle with the vertical beyond which a plane is a floor, on which no direction is upwards."""
_OVERHEAD = 0.3
"""Minus the mean cosine between what is up in the photographs and in the project from which the project is upside down"""


@dataclass(frozen=True, eq=False)
class SurfacePlane:
    """A system on a plane: `rotation` (3, 3) has the axes to the right, upwards and towards the photographs as rows; `origin` (3,)
    m."""

    rotation: np.ndarray
    origin: np.ndarray

    def of(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the project's system: along the plane, up it, and their distance before it, m."""
        return (points - self.origin) @ self.rotation.T


def surface_plane(choice: PlaneChoice, points: np.ndarray, centres: np.ndarray, upwards: np.ndarray) -> SurfacePlane:
    """The plane that a workflow chooses, with its front towards the projection centres (P, 3); `points` (N, 3) are tie points, and
    `upwards` (P, 3) the directions that are up in the photographs.

    Raises GeometryError where there are too few of them to find a plane, or the photographs stand on both sides of it.
    """
    if isinstance(choice, FacadeFound | FittedPlane) and len(points) < LEAST_POINTS:
        raise GeometryError(
            f"Only {len(points)} tie points show the surface, too few to find its plane; give a point and a normal in `grid`."
        )
    thinned = points[:: max(len(points) // MOST_POINTS, 1)]
    if isinstance(choice, FacadeFound):
        place, normal = _upright(thinned)
    elif isinstance(choice, FittedPlane):
        place, normal = _fitted(thinned)
    elif isinstance(choice, PlaneOfPoints):
        a, b, c = np.array(choice.points)
        place, normal = a, np.cross(b - a, c - a)
    else:
        place, normal = np.array(choice.point), np.array(choice.normal)
    return _system(place, normal / np.linalg.norm(normal), points, centres, upwards)


def _upright(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A point and the normal of the upright plane near which most points lie."""
    angle = np.radians(np.arange(DIRECTIONS) * 180.0 / DIRECTIONS)
    normals = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(DIRECTIONS)])
    middle = points.mean(axis=0)
    widths, offsets = shortest_halves((points - middle) @ normals.T)
    best = int(np.argmin(widths))
    return middle + offsets[best] * normals[best], normals[best]


def _fitted(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A point and the normal of the plane near which most points lie."""
    # The same triples in every run, whatever the number of workers.
    chosen = np.random.default_rng(len(points)).integers(0, len(points), (TRIPLES, 3))
    a, b, c = (points[chosen[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    normals = normals[length > 1e-9 * length.max()] / length[length > 1e-9 * length.max(), None]
    middle = points.mean(axis=0)
    widths, offsets = shortest_halves((points - middle) @ normals.T)
    best = int(np.argmin(widths))
    normal, place = normals[best], middle + offsets[best] * normals[best]
    near = points[np.abs((points - place) @ normal) <= 1.5 * widths[best]]
    return near.mean(axis=0), np.linalg.svd(near - near.mean(axis=0), full_matrices=False)[2][2]


def _system(place: np.ndarray, normal: np.ndarray, points: np.ndarray, centres: np.ndarray, upwards: np.ndarray) -> SurfacePlane:
    """The system on a plane; where it stands, its second coordinate is the height of the project (or depth, where that is up)."""
    before = (centres - place) @ normal
    # Most decide: one photograph from behind, through a window, must not refuse the block.
    if np.sum(before > 0) * 2 < len(before):
        normal, before = -normal, -before
    if np.mean(before > 0) < 0.75:
        raise GeometryError(
            f"Photographs stand on both sides of the surface's plane ({int((before > 0).sum())} of {len(before)} before it); one "
            "surface has one front: give another plane in `grid`, or photographs of one side only."
        )
    floor = abs(normal[2]) > _LEVEL
    up = np.array([0.0, 1.0, 0.0]) if floor else np.array([0.0, 0.0, 1.0])
    # Systems of scanners and of computer vision may have a Z that points downwards, and a facade must not stand on its head.
    if not floor and np.mean(upwards @ up) < -_OVERHEAD:
        up = -up
    up = up - (up @ normal) * normal
    up /= np.linalg.norm(up)
    right = np.cross(up, normal)
    # The foot of the middle of the points, carried down to height 0: coordinates along the wall stay small.
    middle = points.mean(axis=0) if len(points) else place
    foot = middle - ((middle - place) @ normal) * normal
    return SurfacePlane(np.array([right, up, normal]), foot - (foot[2] / up[2]) * up if not floor else foot)
