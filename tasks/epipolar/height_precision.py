"""Standard errors of the heights of a pair by its orientation: the part of their error that all nodes share.

Strategy. A point is intersected from its two pixels, which do not change with the orientation. Let A hold the derivatives of the
four pixel coordinates by the ground point, and B those by both exterior orientations and the interior orientation: an error e of
the latter moves the point by -(A'A)^-1 A'B e. The joint covariance of e (row_precision.py) gives the standard error of the height
at nine places of the pair, between which it is interpolated. It contains the datum, a poorly determined geometry and an uncertain
camera constant.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from orthomill.schemas.camera import INTERIOR
from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.orientation import Block, ExteriorOrientation
from orthomill.tasks.epipolar.row_precision import border_points, by_interior, joint_covariance
from orthomill.tasks.geometry.normal_case import intersect_pair
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View, block_view

_STEPS = (1e-3,) * 3 + (1e-7,) * 3
"""m and radians, for central differences by the exterior orientation"""


def height_sigmas(pair: EpipolarPair, block: Block) -> tuple[float, ...]:
    """(9,) m: standard errors of heights by the orientation, at the rows (top, middle, bottom) and columns (left, middle, right) of
    the left image, at the mean parallax; where a photograph shows no such place, the largest of the others. Empty where the
    orientation has no covariance. Raises GeometryError where no place is in front of both photographs."""
    photos = block.of(pair.left), block.of(pair.right)
    if any(photo.covariance is None for photo in photos):
        return ()
    # Nine places suffice: orientation errors bend a model smoothly, mostly by a tilt and by one quadratic term.
    xy = border_points(pair)
    pixels = np.column_stack([xy[:, 0] + pair.left_col0, pair.row0 - xy[:, 1]])
    parallax = np.full(len(xy), (pair.parallax_low + pair.parallax_high) / 2)
    ground = intersect_pair(pair, pixels, parallax)
    cameras = tuple(dict.fromkeys(block.of_photo[photo.photo] for photo in photos))
    by_point, by_orientation = _derivatives(block, photos, cameras, ground)
    # The epipolar images are wider than the photographs: where these are turned far, a corner lies behind one of them.
    shown = np.isfinite(by_point).all(axis=(1, 2)) & np.isfinite(by_orientation).all(axis=(1, 2))
    if not shown.any():
        raise GeometryError("nothing at the mean of its heights lies in front of both photographs")
    by_point, by_orientation = by_point[shown], by_orientation[shown]
    # Least squares and not an exact intersection: the two rays give four equations for three coordinates.
    influence = -np.linalg.pinv(by_point)[:, 2:3] @ by_orientation
    variance = np.einsum("nij,jk,nik->n", influence, joint_covariance(block, photos, cameras), influence)
    # Rounding in a nearly singular covariance (free datum) can leave a tiny negative variance.
    sigma = np.full(len(xy), np.sqrt(max(variance.max(), 0.0)))
    sigma[shown] = np.sqrt(np.maximum(variance, 0.0))
    return tuple(sigma.tolist())


def _derivatives(
    block: Block, photos: tuple[ExteriorOrientation, ...], cameras: tuple[str, ...], ground: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of 4 pixel coordinates by the ground point (N, 4, 3) and by the unknowns of joint_covariance (N, 4, 12 + 17
    k)."""
    by_point = np.zeros((len(ground), 4, 3))
    by_orientation = np.zeros((len(ground), 4, 12 + len(INTERIOR) * len(cameras)))
    for k, photo in enumerate(photos):
        rows, view = slice(2 * k, 2 * k + 2), block_view(block, photo.photo)
        by_point[:, rows] = _by_point(view, ground)
        # Moving the camera by +d images a point like moving the point by -d.
        by_orientation[:, rows, 6 * k : 6 * k + 3] = -by_point[:, rows]
        by_orientation[:, rows, 6 * k + 3 : 6 * k + 6] = _by_angles(view, photo, ground)
        own = 12 + len(INTERIOR) * cameras.index(block.of_photo[photo.photo])
        by_orientation[:, rows, own : own + len(INTERIOR)] = by_interior(view, partial(View.project, points=ground))
    return by_point, by_orientation


def _by_point(view: View, ground: np.ndarray) -> np.ndarray:
    """(N, 2, 3): derivatives of the pixel by X, Y and Z."""
    out = np.empty((len(ground), 2, 3))
    for k, step in enumerate(_STEPS[:3]):
        move = np.eye(3)[k] * step
        out[:, :, k] = (view.project(ground + move) - view.project(ground - move)) / (2 * step)
    return out


def _by_angles(view: View, photo: ExteriorOrientation, ground: np.ndarray) -> np.ndarray:
    """(N, 2, 3): derivatives of the pixel by omega, phi and kappa in radians."""
    out, angles = np.empty((len(ground), 2, 3)), np.radians(photo.omega_phi_kappa)
    for k, step in enumerate(_STEPS[3:]):
        moves = step * np.eye(3)[k], -step * np.eye(3)[k]
        turned = [replace(view, rotation=rotation_matrix(*(angles + move))) for move in moves]
        out[:, :, k] = (turned[0].project(ground) - turned[1].project(ground)) / (2 * step)
    return out
