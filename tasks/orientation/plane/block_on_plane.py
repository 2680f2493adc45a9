"""The block and its tie points in the system of a plane: what later stages take for heights are distances before it.

A rotation of the system leaves the rotation vectors of the photographs as they are, because these are in the image systems; the
angles omega, phi, kappa are others, and their covariance follows by the derivatives of both sets of angles.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Table
from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.orientation import Area, Block, ExteriorOrientation, JointCovariance, in_area
from orthomill.schemas.project import PlaneSurface
from orthomill.tasks.geometry.rotation import angles, rotation_matrix
from orthomill.tasks.geometry.rotation_vector import angles_from_vector
from orthomill.tasks.orientation.plane.surface_plane import SurfacePlane, surface_plane
from orthomill.tasks.orientation.plane.wall_area import wall_area

Rows = tuple[tuple[float, ...], ...]
_CRS = (
    'ENGCRS["plane",EDATUM["plane in the system of the project (products/plane.json)"],CS[Cartesian,2],'
    'AXIS["to the right (x)",east],AXIS["upwards (y)",north],LENGTHUNIT["metre",1]]'
)
"""The system of the rasters of such a surface: GIS programs take it for a local one in metres."""


class PlaneRecord(BaseModel):
    """A plane of the project's system. A place of the surface is origin + x right + y up + z normal, with x and y from its rasters
    and z their height; unit vectors, m."""

    model_config = ConfigDict(frozen=True)

    crs: str
    origin: tuple[float, float, float]
    right: tuple[float, float, float]
    up: tuple[float, float, float]
    normal: tuple[float, float, float]
    area: Area | None = None
    """of x and y, where the surface is made: (x, y, x, y) of its lower left and upper right corner; None: all that pairs see"""


class OnPlane(NamedTuple):
    """What later stages read, and where the plane is."""

    block: Block
    points: GroundPoints
    plane: PlaneRecord


SURVEY_BLOCK = Table("orientation/survey_block.json", Block)
"""The block in the project's system, where the surface stands on a plane and `BLOCK` is in the system of that"""
SURVEY_POINTS = Table("orientation/survey_points.parquet", GroundPoints)
PLANE = Table("orientation/plane.json", PlaneRecord)


def block_on_plane(block: Block, points: GroundPoints, ground: PlaneSurface) -> OnPlane:
    """Block and tie points in the system of the plane that the workflow chooses. Raises GeometryError."""
    places = np.column_stack([points.x, points.y, points.z])
    centres = np.array([photo.centre for photo in block.photos])
    upwards = np.array([rotation_matrix(*np.radians(photo.omega_phi_kappa))[1] for photo in block.photos])
    plane = surface_plane(ground.plane, places, centres, upwards)
    moved = plane.of(places)
    area = wall_area(moved, plane.of(centres)) if ground.area == "auto" else ground.area
    # What lies beside the area would widen the range of heights that is searched on it.
    heights = moved[in_area(area, moved[:, 0], moved[:, 1]), 2]
    low, high = np.percentile(heights, [0.5, 99.5]) if len(heights) else (-1.0, 1.0)
    by_photo = {photo.photo: _spread(photo, plane) for photo in block.photos}
    turned = block.model_copy(
        update={
            "crs": _CRS,
            "photos": tuple(_on_plane(photo, plane, by_photo[photo.photo]) for photo in block.photos),
            "joint": tuple(_joint(pair, by_photo) for pair in block.joint),
            "ground_low": float(low),
            "ground_high": float(high),
            "area": area,
        }
    )
    return OnPlane(turned, _points(points, moved, plane), _record(block.crs, plane, area))


def _record(crs: str, plane: SurfacePlane, area: Area | None) -> PlaneRecord:
    right, up, normal = (_triple(axis) for axis in plane.rotation)
    return PlaneRecord(crs=crs, origin=_triple(plane.origin), right=right, up=up, normal=normal, area=area)


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z


def _spread(photo: ExteriorOrientation, plane: SurfacePlane) -> np.ndarray:
    """(6, 6): the exterior orientation in the system of the plane by that in the project's."""
    R = rotation_matrix(*np.radians(photo.omega_phi_kappa))
    J = np.zeros((6, 6))
    J[:3, :3] = plane.rotation
    J[3:, 3:] = angles_from_vector(R @ plane.rotation.T) @ np.linalg.pinv(angles_from_vector(R))
    return J


def _on_plane(photo: ExteriorOrientation, plane: SurfacePlane, J: np.ndarray) -> ExteriorOrientation:
    R = rotation_matrix(*np.radians(photo.omega_phi_kappa)) @ plane.rotation.T
    return photo.model_copy(
        update={
            "centre": _triple(plane.of(np.array(photo.centre))),
            "omega_phi_kappa": _triple(np.degrees(angles(R))),
            "covariance": None if photo.covariance is None else _rows(photo.covariance, lambda C: J @ C @ J.T),
            "with_interior": {camera: _rows(C, lambda C: J @ C) for camera, C in photo.with_interior.items()},
        }
    )


def _joint(pair: JointCovariance, by_photo: dict[str, np.ndarray]) -> JointCovariance:
    first, second = by_photo[pair.first], by_photo[pair.second]
    return pair.model_copy(update={"covariance": _rows(pair.covariance, lambda C: first @ C @ second.T)})


def _rows(covariance: Rows, change: Callable[[np.ndarray], np.ndarray]) -> Rows:
    return tuple(map(tuple, change(np.array(covariance)).tolist()))


def _points(points: GroundPoints, moved: np.ndarray, plane: SurfacePlane) -> GroundPoints:
    # Of their covariance only the standard errors are kept: those of the axes of the plane follow as if the others were 0.
    variance = np.column_stack([points.sigma_x, points.sigma_y, points.sigma_z]).astype(np.float64) ** 2 @ (plane.rotation**2).T
    sigma = np.sqrt(variance).astype(np.float32)
    x, y, z = np.ascontiguousarray(moved.T)
    return replace(points, x=x, y=y, z=z, sigma_x=sigma[:, 0], sigma_y=sigma[:, 1], sigma_z=sigma[:, 2])
