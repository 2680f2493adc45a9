"""From tables to arrays: image measurements as rays, in the order that the adjustment needs."""

from typing import Any

import numpy as np

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.observations import ControlPoint, TiePoints
from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.model.network import Rays
from orthomill.tasks.geometry.distortion import pixel_to_image
from orthomill.tasks.imagery.photograph_rows import rows_of_photos


def centred(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """Pixels (N, 2) (col, row) to image coordinates (N, 2) from the image centre, y up, distortion included."""
    return np.column_stack(_from_centre(camera, pixels[:, 0], pixels[:, 1]))


def _from_centre(camera: Camera, col: Any, row: Any) -> tuple[Any, Any]:
    """Image coordinates of a pixel or of arrays of them, as `centred`."""
    return col - (camera.width - 1) / 2, (camera.height - 1) / 2 - row


def tie_rays(photos: Photos, cameras: Cameras, tie_points: TiePoints) -> tuple[Rays, np.ndarray]:
    """Rays of all tie points, with points numbered without gaps, and the track number (N,) of every point."""
    order = np.lexsort((tie_points.photo, tie_points.track))
    tracks, point = np.unique(tie_points.track[order], return_inverse=True)
    photo = tie_points.photo[order].astype(np.int32)
    pixels = np.column_stack([tie_points.col[order], tie_points.row[order]])
    xy = np.empty_like(pixels)
    for name, own in zip(photos.names, rows_of_photos(photo, len(photos.names)), strict=True):
        xy[own] = centred(cameras.of(name), pixels[own])
    # A standard error of zero would give a measurement infinite weight.
    return Rays(point.astype(np.int32), photo, xy, np.maximum(tie_points.sigma[order].astype(np.float64), 1e-3)), tracks


def ground_rays(points: list[ControlPoint], photos: dict[str, int], cameras: Cameras) -> Rays:
    """Rays of surveyed points to the photographs of the block, `photos`: name -> number. Points are numbered as given; rays are
    sorted by point, then photograph."""
    rows = sorted(
        (i, photos[name], *_from_centre(cameras.of(name), *measured[:2]), measured[2])
        for i, point in enumerate(points)
        for name, measured in point.measurements.items()
        if name in photos
    )
    if not rows:
        return Rays(np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros((0, 2)), np.zeros(0))
    point, photo, x, y, sigma = np.array(rows, np.float64).T
    return Rays(point.astype(np.int32), photo.astype(np.int32), np.column_stack([x, y]), sigma)


def with_interior(camera: Camera, values: np.ndarray) -> Camera:
    """The camera with other interior parameters (17,)."""
    # Lists of marks are tried in thousands of ways with the cameras as they are, and a copy takes longer than the comparison.
    return camera if tuple(values) == camera.interior else camera.with_interior(values)


def ideal(camera: Camera, xy: np.ndarray) -> np.ndarray:
    """Distorted coordinates from the image centre (N, 2) to ideal ones from the principal point, in units of c."""
    pixels = np.column_stack([xy[:, 0] + (camera.width - 1) / 2, (camera.height - 1) / 2 - xy[:, 1]])
    return pixel_to_image(camera, pixels) / camera.c


def on_a_line(xy: np.ndarray, width: float) -> bool:
    """Whether half of the points (n, 2) lie within `width` of the line that fits all of them best."""
    # Half of them: wrong matches lie off the line and must not make a line look like an area.
    offset = xy - np.median(xy, axis=0)
    across = np.linalg.svd(offset, full_matrices=False)[2][1]
    return bool(np.median(np.abs(offset @ across)) < width)
