"""Standard errors of a calibration whose corners err together within a photograph.

Blur and slant shift the corners of one image of a board alike, a rolling shutter shears them, a board bends differently in every
hand, and a lens model is never quite right: residuals of one photograph resemble each other, and the standard errors that follow
from as many independent corners are too small. Photographs are independent of each other: what the parameters change by when one of
them is left out tells how far they can be trusted, whatever the errors are like (the jackknife over groups). Left out by one
linear step, from the normal equations of the interior parameters and the places of boards alone, in which every photograph has
eliminated its exterior orientation.

With few photographs the jackknife of one parameter is itself uncertain, so that one factor for all parameters is used: the mean of
the jackknife's variances in units of the formal ones, not below 1.

Source: Quenouille 1956; Cameron, Gelbach and Miller 2008 (groups); Kuerschner 2004 and mrcal's documentation on correlated corners.
"""

import numpy as np

from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.adjustment.boards.board_projection import derivatives, residuals


def correlation_factor(result: BoardAdjustment) -> float:
    """By how much formal standard errors have to be enlarged, 1 or more."""
    shared, reduced, gradient = _by_photo(result)
    photos = len(reduced)
    photographed = reduced.sum(axis=0)
    normal = photographed + _flatness(result, shared)
    # In units in which the formal covariance is the unit matrix: scale-free, and well conditioned.
    values, vectors = np.linalg.eigh(normal)
    good = values > 1e-12 * values[-1]
    root = vectors[:, good] / np.sqrt(values[good])
    moved = []
    for own, pull in zip(root.T @ reduced @ root, gradient @ root, strict=True):
        rest = np.eye(good.sum()) - own
        # A photograph without which a parameter is not determined would move it without limit.
        share, axes = np.linalg.eigh(rest)
        moved.append(axes @ ((axes.T @ pull) / np.maximum(share, 0.1)))
    spread = (photos - 1) / photos * (np.array(moved) ** 2).sum(axis=0) / max(result.sigma0, 1e-12) ** 2
    # What is known of boards without photographs does not change when one of these is left out.
    determined = np.einsum("ij,ij->", root, photographed @ root)
    return float(np.sqrt(max(spread.sum() / determined, 1.0))) if shared else 1.0


def _flatness(result: BoardAdjustment, shared: int) -> np.ndarray:
    """(s, s): the weights of flat boards among the unknowns that photographs share."""
    network, weight = result.network, np.zeros(shared)
    if network.bends:
        weight[network.bend_columns.ravel() - 6 * network.photos] = (network.image_sigma / network.bend_sigma) ** 2
    return np.diag(weight)


def _by_photo(result: BoardAdjustment) -> tuple[int, np.ndarray, np.ndarray]:
    """The number s of unknowns that photographs share, and per photograph (P, s, s) and (P, s) the normal matrix and the right-hand
    side of these after elimination of its exterior orientation."""
    network, corners = result.network, result.corners.take(result.used)
    first, shared = 6 * network.photos, network.unknowns - 6 * network.photos
    by, _ = derivatives(result.state, corners)
    miss = residuals(result.state, corners)
    row, columns = network.columns_of(corners)
    reduced, gradient = np.zeros((network.photos, shared, shared)), np.zeros((network.photos, shared))
    for photo in range(network.photos):
        own = np.flatnonzero(corners.photo == photo)
        by_shared = np.zeros((len(own), 2, shared))
        for k, i in enumerate(own):
            place = columns[row[i]][6:]
            by_shared[k][:, place[place >= 0] - first] = by[i][:, 6:][:, place >= 0]
        v, q = miss[own].ravel(), np.linalg.qr(by[own][:, :, :6].reshape(-1, 6))[0]
        # Only what the exterior orientation cannot explain tells about the shared unknowns.
        B = by_shared.reshape(-1, shared)
        B = B - q @ (q.T @ B)
        reduced[photo], gradient[photo] = B.T @ B, B.T @ v
    return shared, reduced, gradient
