"""Interior parameters that the block does not determine are not left free: over flat ground and without control a camera constant
only trades against the flying height, and would drift with the noise.

Before the adjustment the covariance at the starting values shows which parameters the geometry determines; the others keep their
value, which is reported. A nominal camera constant without control is no unknown unless the shape of the block determines it
(photographs that converge, or look in all directions), even if the measurements within a region of the frame all err alike.
"""

from dataclasses import replace

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.findings.camera_findings import InteriorFixed, InteriorUndetermined, InteriorUnweighted
from orthomill.tasks.adjustment.model.interior import camera_covariance, given_sigmas
from orthomill.tasks.adjustment.model.interior_settings import InteriorChoice
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.solve.ray_intersection import sufficiently_observed
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.adjustment.testing.covariances import covariance_of

AREAS = 9
"""Neighbouring measurements have correlated errors (distortion that the model lacks, a rolling shutter): before a nominal value is
replaced, a photograph counts as one independent measurement in each of von Gruber's areas."""
LARGEST = 0.03
"""A free c, x0 or y0 with a larger predicted standard error, in units of c, is not determined: a value from EXIF is as good
(`NOMINAL_SIGMA`)."""
SHAPE = slice(0, 3)
"""c, x0, y0 in the order of INTERIOR: the parameters that flying height and tilts can imitate. Distortion is determined by the
redundancy of any block."""


def determined(
    network: Network, state: State, rays: Rays, names: tuple[str, ...]
) -> tuple[Network, tuple[InteriorUndetermined, ...]]:
    """The network in which the free c, x0 and y0 that its geometry does not determine are fixed, and for which cameras."""
    without_prior = np.diagonal(network.interior.weight, axis1=1, axis2=2)[:, SHAPE] == 0
    unknown = network.interior.free[:, SHAPE] & without_prior
    # Points with a single ray make the normal equations singular, and say nothing of the camera.
    rays = sufficiently_observed(network, rays)
    findings: list[InteriorUndetermined] = []
    while unknown.any():
        share = _shares(network, state, rays)
        worst = np.where(unknown, share, 0.0).max(axis=1)
        camera = int(worst.argmax())
        if worst[camera] <= LARGEST:
            break
        # One camera at a time: fixing the worst one may determine the others, with which it shares points.
        network = _with_fixed_shape(network, camera)
        known_to = float(worst[camera])
        findings.append(InteriorUndetermined(camera=names[camera], share=known_to if np.isfinite(known_to) else None))
        unknown[camera] = False
    return network, tuple(findings)


def determinable_without_control(network: Network, state: State, rays: Rays) -> Network:
    """The network whose nominal c, x0 and y0, so far only considered, are unknowns where the shape of the block determines c better
    than it was given, with no more than AREAS independent measurements per photograph."""
    interior = network.interior
    doubtful = interior.considered[:, 0]
    if not doubtful.any():
        return network
    weight = interior.weight.copy()
    weight[doubtful, SHAPE], weight[doubtful, :, SHAPE] = 0.0, 0.0
    unknown = replace(interior, weight=weight, considered=interior.considered & ~doubtful[:, None])
    share = _shares(replace(network, interior=unknown), state, sufficiently_observed(network, rays))[:, 0]
    of_camera = np.bincount(network.camera_of[rays.photo], minlength=len(doubtful))
    photos = np.bincount(network.camera_of, minlength=len(doubtful))
    # Variances scale with the number of observations: fewer independent ones enlarge the standard error by its root.
    per_area = np.maximum(of_camera / np.maximum(photos, 1) / AREAS, 1.0)
    better = doubtful & (share * np.sqrt(per_area) * state.interior[:, 0] < given_sigmas(interior)[:, 0])
    return replace(network, interior=replace(interior, considered=interior.considered & ~better[:, None]))


def unweighted(cameras: list[Camera], choice: InteriorChoice) -> tuple[InteriorUnweighted, ...]:
    """That cameras shall be weighted of which no standard error is known, and which these are."""
    if choice.kind != "weighted":
        return ()
    names = tuple(camera.name for camera in cameras if not camera_covariance(camera).any())
    return (InteriorUnweighted(cameras=names),) if names else ()


def all_fixed(network: Network, names: tuple[str, ...]) -> tuple[Network, InteriorFixed]:
    """The network with all interior orientations as given, and that this was done."""
    none = np.zeros_like(network.interior.free)
    fixed = replace(network.interior, free=none, considered=none, weight=np.zeros_like(network.interior.weight))
    return replace(network, interior=fixed), InteriorFixed(cameras=names)


def _shares(network: Network, state: State, rays: Rays) -> np.ndarray:
    """(C, 3) predicted standard errors of c, x0 and y0 in units of c; inf where the normal equations are singular."""
    try:
        variance = covariance_of(network, state, linearised(network, state, rays)).variances
    except GeometryError:
        # Singular: nothing is determined to any precision.
        return np.full((len(network.interior.free), 3), np.inf)
    columns = network.interior_columns[:, SHAPE]
    return np.where(columns >= 0, np.sqrt(np.maximum(variance[columns], 0.0)), 0.0) / state.interior[:, :1]


def _with_fixed_shape(network: Network, camera: int) -> Network:
    interior = network.interior
    free, weight = interior.free.copy(), interior.weight.copy()
    free[camera, SHAPE] = False
    weight[camera, SHAPE], weight[camera, :, SHAPE] = 0.0, 0.0
    return replace(network, interior=replace(interior, free=free, weight=weight, considered=interior.considered & free))


def rays_per_photograph(result: Adjustment) -> np.ndarray:
    """(C,) the mean number of measurements in a photograph of each camera."""
    camera_of, cameras = result.network.camera_of, len(result.network.interior.value)
    rays = np.bincount(camera_of[result.rays.photo[result.used]], minlength=cameras)
    return np.maximum(rays, 1) / np.maximum(np.bincount(camera_of, minlength=cameras), 1)
