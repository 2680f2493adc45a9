"""How far homologous points may leave their common row, as the orientation's precision lets expect.

Strategy. The covariance of each photograph's exterior orientation is carried to the row coordinate of ground points at the border
of the common images: turns by Karfis' row partials, shifts of the centre by their projection. The joint covariance of the two
takes out what a weak datum does to both alike; where it is not known they count as independent, and the figure is an upper bound.

Source: Karfis 2009, section 6.5 (methods/relative_orientation_and_epipolar.md, 1.14).
"""

import numpy as np

from schemas.epipolar import EpipolarPair
from schemas.orientation import Block, ExteriorOrientation
from tasks.geometry.normal_case import row_partials
from tasks.geometry.rotation import rotation_derivatives, rotation_matrix


def row_sigma(pair: EpipolarPair, block: Block) -> float:
    """Greatest standard error (px) of the y-parallax in a pair; the block's sigma0 where the orientation has no covariance."""
    photos = block.of(pair.left), block.of(pair.right)
    if any(photo.covariance is None for photo in photos):
        return block.sigma0_px
    parallax = (pair.parallax_low + pair.parallax_high) / 2
    x = np.array([0.0, pair.left_cols / 2, pair.left_cols - 1.0]) - pair.left_col0
    y = pair.row0 - np.array([0.0, pair.rows / 2, pair.rows - 1.0])
    left = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    right = left - (parallax, 0.0)
    partials = np.hstack([-row_change(pair, photos[0], left, parallax), row_change(pair, photos[1], right, parallax)])
    variance = np.einsum("ni,ij,nj->n", partials, _covariance(block, *photos), partials)
    return float(np.sqrt(variance.max()))


def row_change(pair: EpipolarPair, photo: ExteriorOrientation, xy: np.ndarray, parallax: float) -> np.ndarray:
    """(N, 6): change (px) of the epipolar y of image points xy (N, 2) by X, Y, Z, omega, phi and kappa of one photograph."""
    return np.hstack([_by_centre(pair, xy, parallax), row_partials(xy, pair.c) @ _turns(pair, photo)])


def _covariance(block: Block, left: ExteriorOrientation, right: ExteriorOrientation) -> np.ndarray:
    """(12, 12) of both photographs."""
    joint = np.zeros((6, 6))
    for known in block.joint:
        if (known.first, known.second) == (left.photo, right.photo):
            joint = np.array(known.covariance)
        elif (known.second, known.first) == (left.photo, right.photo):
            joint = np.array(known.covariance).T
    return np.block([[np.array(left.covariance), joint], [joint.T, np.array(right.covariance)]])


def _by_centre(pair: EpipolarPair, xy: np.ndarray, parallax: float) -> np.ndarray:
    """(N, 3): change of y by X, Y, Z of the projection centre."""
    depth = pair.base * pair.c / parallax
    in_base = np.column_stack([np.zeros(len(xy)), np.full(len(xy), -pair.c), -xy[:, 1]]) / depth
    return in_base @ np.array(pair.rotation)


def _turns(pair: EpipolarPair, photo: ExteriorOrientation) -> np.ndarray:
    """(3, 3): columns are the small turns about the axes of the base system that omega, phi and kappa cause."""
    angles = np.radians(photo.omega_phi_kappa)
    rotation = rotation_matrix(*angles)
    skew = rotation_derivatives(*angles) @ rotation.T
    turns = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]])
    return np.array(pair.rotation) @ rotation.T @ turns
