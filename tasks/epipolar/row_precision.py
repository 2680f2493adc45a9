"""Standard error of the y-parallax of a pair, as the precision of its orientation predicts it.

Strategy. The errors of both exterior orientations and of the interior orientation are propagated to the row coordinate of ground
points of the common ground: rotations by Karfis' row partials, shifts of the centre by their projection, the interior
orientation by the collinearity equations. The joint covariance removes what a poorly determined datum does to both photographs
alike, and what an uncertain camera constant does to orientation and camera together. Where it is not known the errors count as
independent, and the result is an upper bound. An interior orientation that was not adjusted in the block contributes nothing.

Source: Karfis 2009, section 6.5 (sources/epipolar.md#row-band).
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from orthomill.schemas.camera import INTERIOR
from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.orientation import Block, ExteriorOrientation, JointCovariance
from orthomill.tasks.geometry.normal_case import Side, common_polygon, epipolar_view, frame_polygon, row_partials
from orthomill.tasks.geometry.rotation import rotation_derivatives, rotation_matrix
from orthomill.tasks.geometry.view import View, block_view, view_of

_GRID = 9
"""points across the common ground; the standard errors vary smoothly"""


def row_sigma(pair: EpipolarPair, block: Block) -> float:
    """Standard error (px) of the y-parallax, root mean square over the common ground of a pair; the block's sigma0 where the
    orientation has no covariance."""
    if any(block.of(name).covariance is None for name in (pair.left, pair.right)):
        return block.sigma0_px / 2**pair.level
    return float(np.sqrt((row_sigmas(pair, block, common_points(pair, block)) ** 2).mean()))


def common_points(pair: EpipolarPair, block: Block) -> np.ndarray:
    """(N, 2): corners of the common ground and a regular grid on it, epipolar x and y of the left image, px. Raises GeometryError
    for a pair that shares none at the mean parallax."""
    # The whole area, not the corners alone: there lens and attitude are extrapolated beyond the tie points, and one corner would
    # speak for a pair that is ten times better everywhere else.
    corners = common_corners(pair, block)
    if not len(corners):
        raise GeometryError("they show no common ground at its mean height")
    columns = np.linspace(corners.min(axis=0), corners.max(axis=0), _GRID)
    grid = np.stack(np.meshgrid(*columns.T), axis=-1).reshape(-1, 2)
    edges, spokes = np.roll(corners, -1, axis=0) - corners, grid[:, None] - corners
    turns = edges[:, 0] * spokes[..., 1] - edges[:, 1] * spokes[..., 0]
    inside = (turns > 0).all(axis=1) | (turns < 0).all(axis=1)
    return np.vstack([corners, grid[inside]])


def common_corners(pair: EpipolarPair, block: Block) -> np.ndarray:
    """(N, 2): corners of the common ground at the mean parallax, epipolar x and y of the left image, px."""
    # Not the corners of the epipolar images: with frames askew to the base these lie outside both photographs, where the
    # distortion polynomial is extrapolated beyond all measurements and its errors explode.
    rotation, parallax = np.array(pair.rotation), (pair.parallax_low + pair.parallax_high) / 2
    left, right = (frame_polygon(block_view(block, name), rotation, pair.c) for name in (pair.left, pair.right))
    return common_polygon(left, right + np.array([parallax, 0.0]))


def border_points(pair: EpipolarPair) -> np.ndarray:
    """(9, 2): corners, edge midpoints and centre of the left image, epipolar x and y, px."""
    x = np.array([0.0, pair.left_cols / 2, pair.left_cols - 1.0]) - pair.left_col0
    y = pair.row0 - np.array([0.0, pair.rows / 2, pair.rows - 1.0])
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def row_sigmas(pair: EpipolarPair, block: Block, left: np.ndarray) -> np.ndarray:
    """(N,) px: standard error of the y-parallax of left image points (N, 2) at the mean parallax of the pair."""
    photos, parallax = (block.of(pair.left), block.of(pair.right)), (pair.parallax_low + pair.parallax_high) / 2
    right = left - (parallax, 0.0)
    cameras = tuple(dict.fromkeys(block.of_photo[photo.photo] for photo in photos))
    size = len(INTERIOR)
    partials = np.zeros((len(left), 12 + size * len(cameras)))
    sides: tuple[tuple[Side, ExteriorOrientation, np.ndarray, int, float], ...] = (
        ("left", photos[0], left, 0, -1.0),
        ("right", photos[1], right, 6, 1.0),
    )
    for side, photo, xy, first, sign in sides:
        partials[:, first : first + 6] = sign * row_change(pair, photo, xy, parallax)
        # added, not assigned: with one camera for both photographs its errors largely cancel in the y-parallax
        own = 12 + size * cameras.index(block.of_photo[photo.photo])
        view = view_of(photo, block.camera_of(photo.photo))
        partials[:, own : own + size] += sign * interior_row_change(pair, side, view, xy)
    variance = np.einsum("ni,ij,nj->n", partials, joint_covariance(block, photos, cameras), partials)
    return np.sqrt(np.maximum(variance, 0.0))


def row_change(pair: EpipolarPair, photo: ExteriorOrientation, xy: np.ndarray, parallax: float) -> np.ndarray:
    """(N, 6): change (px) of the epipolar y of image points xy (N, 2) by X, Y, Z, omega, phi and kappa of one photograph."""
    return np.hstack([_by_centre(pair, xy, parallax), row_partials(xy, pair.c) @ _small_rotations(pair, photo)])


def interior_row_change(pair: EpipolarPair, side: Side, view: View, xy: np.ndarray) -> np.ndarray:
    """(N, 17): change of the epipolar y of image points xy (N, 2) by the interior parameters (order of INTERIOR): the same ray is
    imaged by the camera with and without the change."""
    epipolar = epipolar_view(pair, side, view)
    along = np.column_stack([xy, np.full(len(xy), -pair.c)]) @ np.array(pair.rotation) + view.centre
    return -by_interior(view, lambda changed: epipolar.from_photo(changed.project(along))[:, 1])


def by_interior(view: View, measured: Callable[[View], np.ndarray]) -> np.ndarray:
    """(..., 17): central differences of what is `measured` (...) with a view by its interior parameters (order of INTERIOR)."""
    parts = []
    for k, name in enumerate(INTERIOR):
        # c, x0, y0 in px; the distortion coefficients are pure numbers a thousand times smaller
        if name not in view.camera.parameters:
            parts.append(np.zeros_like(measured(view)))
            continue
        step, value = (0.01 if k < 3 else 1e-6), view.camera.value(name)
        more, less = (replace(view, camera=view.camera.changed(**{name: value + move})) for move in (step, -step))
        parts.append((measured(more) - measured(less)) / (2 * step))
    return np.stack(parts, axis=-1)


def joint_covariance(block: Block, photos: tuple[ExteriorOrientation, ...], cameras: tuple[str, ...]) -> np.ndarray:
    """(M, M), M = 12 + 17 per camera: both exterior orientations, then the interior orientation of each different camera."""
    own = len(INTERIOR)
    size = 12 + own * len(cameras)
    total = np.zeros((size, size))
    for i, photo in enumerate(photos):
        total[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = photo.covariance
        for k, camera in enumerate(cameras):
            if camera in photo.with_interior:
                _put(total, 6 * i, 12 + own * k, np.array(photo.with_interior[camera]))
    _put(total, 0, 6, _joint(block.joint, photos[0].photo, photos[1].photo, 6))
    for k, camera in enumerate(cameras):
        known = block.cameras[camera]
        if known.source == "block" and known.covariance is not None:
            at = slice(12 + own * k, 12 + own * (k + 1))
            total[at, at] = known.covariance
    if len(cameras) == 2:
        _put(total, 12, 12 + own, _joint(block.joint_cameras, *cameras, own))
    return total


def _put(total: np.ndarray, row: int, column: int, part: np.ndarray) -> None:
    """Write a block of a symmetric matrix and its transpose."""
    total[row : row + part.shape[0], column : column + part.shape[1]] = part
    total[column : column + part.shape[1], row : row + part.shape[0]] = part.T


def _joint(known: tuple[JointCovariance, ...], first: str, second: str, size: int) -> np.ndarray:
    """The joint covariance of two names, in this order; zero where it is not known."""
    for entry in known:
        if (entry.first, entry.second) == (first, second):
            return np.array(entry.covariance)
        if (entry.second, entry.first) == (first, second):
            return np.array(entry.covariance).T
    return np.zeros((size, size))


def _by_centre(pair: EpipolarPair, xy: np.ndarray, parallax: float) -> np.ndarray:
    """(N, 3): change of y by X, Y, Z of the projection centre."""
    # dy = (-c dY_b - y dZ_b) / depth in the base system; a shift along the base moves no row
    depth = pair.base * pair.c / parallax
    in_base = np.column_stack([np.zeros(len(xy)), np.full(len(xy), -pair.c), -xy[:, 1]]) / depth
    return in_base @ np.array(pair.rotation)


def _small_rotations(pair: EpipolarPair, photo: ExteriorOrientation) -> np.ndarray:
    """(3, 3): columns are the small rotations about the axes of the base system that omega, phi and kappa cause."""
    # dR R' is skew-symmetric and holds the rotation vector; this is exact for any attitude, also for oblique photographs.
    angles = np.radians(photo.omega_phi_kappa)
    rotation = rotation_matrix(*angles)
    skew = rotation_derivatives(*angles) @ rotation.T
    turns = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]])
    return np.array(pair.rotation) @ rotation.T @ turns
