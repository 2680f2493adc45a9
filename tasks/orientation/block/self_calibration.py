"""Interior parameters that the block cannot tell are not left free: a camera constant over flat ground without control is flying
height in disguise, and would wander where noise pushes it.

Before the adjustment the covariance at the starting values says which parameters the geometry determines; those that it does not
keep their value, and a sentence says so. A nominal camera constant without control is no unknown unless the shape of the block
tells it (photographs that converge, or look in all directions), even if the measurements of a region of the frame are all wrong
alike.
"""

from dataclasses import replace

import numpy as np

from orthomill.schemas.camera import INTERIOR
from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.interior import given_sigmas
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.solve.ray_intersection import sufficiently_observed
from orthomill.tasks.adjustment.testing.covariances import covariance_of

AREAS = 9
"""Neighbouring measurements share their errors (distortion that the model lacks, a rolling shutter): as much as one independent
measurement in each of von Gruber's areas counts when a nominal value is to be replaced."""
LARGEST = 0.03
"""A free c, x0 or y0 with a larger predicted standard error, in units of c, is not determined."""


def determined(network: Network, state: State, rays: Rays, names: tuple[str, ...]) -> tuple[Network, tuple[str, ...]]:
    """The network with the free c, x0 and y0 held that its geometry does not determine, and sentences about them."""
    open_ = network.interior.free[:, :3] & (np.diagonal(network.interior.weight, axis1=1, axis2=2)[:, :3] == 0)
    rays = sufficiently_observed(network, rays)
    remarks: list[str] = []
    while open_.any():
        share = _shares(network, state, rays)
        weak = np.where(open_, share, 0.0).max(axis=1)
        camera = int(weak.argmax())
        if weak[camera] <= LARGEST:
            break
        network = _holding(network, camera)
        remarks.append(_sentence(names[camera], float(weak[camera])))
        open_[camera] = False
    return network, tuple(remarks)


def told_by_shape(network: Network, state: State, rays: Rays) -> Network:
    """The network whose nominal c, x0 and y0, so far only considered, are unknowns where the block tells c better than it was
    given, with no more than AREAS independent measurements per photograph."""
    interior = network.interior
    doubtful = interior.considered[:, 0]
    if not doubtful.any():
        return network
    weight = interior.weight.copy()
    weight[doubtful, :3], weight[doubtful, :, :3] = 0.0, 0.0
    unknown = replace(interior, weight=weight, considered=interior.considered & ~doubtful[:, None])
    share = _shares(replace(network, interior=unknown), state, sufficiently_observed(network, rays))[:, 0]
    of_camera = np.bincount(network.camera_of[rays.photo], minlength=len(doubtful))
    photos = np.bincount(network.camera_of, minlength=len(doubtful))
    per_area = np.maximum(of_camera / np.maximum(photos, 1) / AREAS, 1.0)
    told = doubtful & (share * np.sqrt(per_area) * state.interior[:, 0] < given_sigmas(interior)[:, 0])
    return replace(network, interior=replace(interior, considered=interior.considered & ~told[:, None]))


def held_fixed(network: Network, names: tuple[str, ...]) -> tuple[Network, tuple[str, ...]]:
    """The network with all interior orientations as they are, and a sentence about it."""
    none = np.zeros_like(network.interior.free)
    fixed = replace(network.interior, free=none, considered=none, weight=np.zeros_like(network.interior.weight))
    return replace(network, interior=fixed), (
        f"The interior orientation of {' and '.join(names)} could not be adjusted: the block does not determine it. It was held "
        "fixed; calibrate the camera, or add oblique photographs or control at different heights.",
    )


def _shares(network: Network, state: State, rays: Rays) -> np.ndarray:
    """(C, 3) predicted standard errors of c, x0 and y0 in units of c; inf where the normal equations are singular."""
    try:
        variance = covariance_of(network, state, linearised(network, state, rays)).variances
    except GeometryError:
        return np.full((len(network.interior.free), 3), np.inf)
    columns = network.interior_columns[:, :3]
    return np.where(columns >= 0, np.sqrt(np.maximum(variance[columns], 0.0)), 0.0) / state.interior[:, :1]


def _holding(network: Network, camera: int) -> Network:
    interior = network.interior
    free, weight = interior.free.copy(), interior.weight.copy()
    free[camera, :3] = False
    weight[camera, :3], weight[camera, :, :3] = 0.0, 0.0
    return replace(network, interior=replace(interior, free=free, weight=weight, considered=interior.considered & free))


def _sentence(name: str, share: float) -> str:
    how = f"only to {100 * share:.0f} %" if np.isfinite(share) else "not at all"
    return (
        f"Self-calibration: the block determines {', '.join(INTERIOR[:3])} of {name} {how} (flat ground seen from above, points on "
        "a line or in one plane, or one position), so they kept their values. Give control at different heights, oblique "
        "photographs or photographs turned by 90 degrees, or a calibration."
    )
