"""A block of undistorted photographs with the points that they see, as dense matchers of other programs take it."""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.schemas.observations import GroundPoints, ImageResiduals
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.imagery.undistorted import ideal_camera, ideal_pixels
from orthomill.tasks.orientation.interchange.foreign_block import Y_DOWN


@dataclass(frozen=True, eq=False)
class PinholeModel:
    """P photographs by name, their ideal cameras (by number: `camera` (P,)), rotations (P, 3, 3) from the map to cameras that look
    along z with y down, centres (P, 3) and points (N, 3) m less the `origin`, residuals of points (N,) px, and M measurements: the
    number of their photograph and point, and their pixel (M, 2) in the undistorted photograph; sorted by point."""

    names: tuple[str, ...]
    cameras: tuple[Camera, ...]
    camera: np.ndarray
    rotations: np.ndarray
    centres: np.ndarray
    origin: np.ndarray
    points: np.ndarray
    errors: np.ndarray
    ray_photo: np.ndarray
    ray_point: np.ndarray
    ray_pixel: np.ndarray


def origin_of(block: Block) -> np.ndarray:
    """(3,) a round place in the middle, whose subtraction saves digits in single precision; heights stay as they are."""
    origin = np.round(np.mean([photo.centre for photo in block.photos], axis=0) / 100.0) * 100.0
    origin[2] = 0.0
    return origin


def pinhole_model(photos: Photos, block: Block, points: GroundPoints, rays: ImageResiduals) -> PinholeModel:
    """The block with all tie points that it used."""
    views, origin = [block_view(block, name) for name in block.names], origin_of(block)
    names = list(dict.fromkeys(block.of_photo[name] for name in block.names))
    order = np.argsort(points.track, kind="stable")
    track = np.asarray(points.track)[order]
    place = {name: k for k, name in enumerate(block.names)}
    number = np.array([place.get(name, -1) for name in photos.names])[rays.photo]
    at = np.clip(np.searchsorted(track, rays.track), 0, max(len(track) - 1, 0))
    known = rays.used & (number >= 0) & (track[at] == rays.track if len(track) else False)
    number, at, seen = number[known], at[known], np.column_stack([rays.col, rays.row])[known]
    pixels = np.empty_like(seen)
    for k, view in enumerate(views):
        pixels[number == k] = ideal_pixels(view.camera, seen[number == k])
    sorting = np.lexsort([number, at])
    return PinholeModel(
        names=block.names,
        cameras=tuple(ideal_camera(block.cameras[name]) for name in names),
        camera=np.array([names.index(block.of_photo[name]) for name in block.names]),
        rotations=np.array([Y_DOWN @ view.rotation for view in views]),
        centres=np.array([view.centre - origin for view in views]),
        origin=origin,
        points=np.column_stack([points.x, points.y, points.z])[order] - origin,
        errors=np.asarray(points.residual, np.float64)[order],
        ray_photo=number[sorting],
        ray_point=at[sorting],
        ray_pixel=pixels[sorting],
    )


def file_of(name: str, suffix: str) -> str:
    """The file of an undistorted photograph: names of photographs may hold folders."""
    return f"{name.replace('/', '_')}{suffix}"
