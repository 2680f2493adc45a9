"""Interior parameters that a camera known from tags keeps, in the standard errors of its block.

The principal point and k3 of such a camera keep their values unless its block demands them (`demanded_parameters`). They are not
known for that: what the block leaves of their uncertainty bends the ground. They are considered (Schmidt 1966) with the second
moment about the value that is held of what they may be, by what lenses are and by what the residuals say: covariance, and square
of the step that the block would take. Residuals count as in the decision itself, as one independent measurement in each of von
Gruber's areas of a photograph, for neighbours err alike.
"""

from dataclasses import replace

import numpy as np

from orthomill.schemas.camera import INTERIOR, Camera, lens_parameters
from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.interior import UNKNOWN_SIGMA, camera_covariance
from orthomill.tasks.adjustment.model.interior_settings import InteriorChoice
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import Interior
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment, Covariances
from orthomill.tasks.adjustment.testing.covariances import covariance_of, points_alone, with_considered
from orthomill.tasks.adjustment.testing.error_fields import weighted_rays
from orthomill.tasks.orientation.block.assembly import BlockResults
from orthomill.tasks.orientation.block.camera_constant import step_in
from orthomill.tasks.orientation.block.self_calibration import AREAS, rays_per_photograph

CONSTANT = INTERIOR.index("c")
"""A camera constant scales the block, and hardly bends it: it stays considered as it was given."""


def considering_held(results: BlockResults, choice: InteriorChoice) -> BlockResults:
    """The results whose standard errors include the interior parameters that its cameras keep without being known; a workflow that
    fixes the interior orientation has decided that they are."""
    if choice.kind == "fixed":
        return results
    sigma = np.array([held_sigmas(camera) for camera in results.problem.cameras])
    try:
        return replace(results, result=with_held(results.result, sigma))
    except GeometryError:
        # Where a block determines nothing of its camera, its covariance stays as it is, and is large enough.
        return results


def held_sigmas(camera: Camera) -> np.ndarray:
    """(17,) the standard errors of the interior parameters before the block; 0 for c, and for cameras that are not nominal."""
    if camera.source != "exif":
        return np.zeros(len(INTERIOR))
    own, stated = lens_parameters(camera.lens.kind), np.sqrt(np.diag(camera_covariance(camera)))
    unknown = np.array([UNKNOWN_SIGMA.get(name, 0.0) if name in own else 0.0 for name in INTERIOR])
    sigma = np.where(stated > 0, stated, unknown)
    sigma[CONSTANT] = 0.0
    return sigma


def with_held(result: Adjustment, sigma: np.ndarray) -> Adjustment:
    """The result with the parameters of `sigma` (C, 17) > 0 that it keeps as considered ones. Raises GeometryError where it says
    nothing of them."""
    network, interior = result.network, result.network.interior
    present = np.isin(np.arange(len(sigma)), network.camera_of[result.rays.photo[result.used]])
    held = (~interior.free | interior.considered) & (sigma > 0) & present[:, None]
    if not held.any():
        return result
    known = replace(network, interior=_considered(interior, held, _moments(result, held, sigma)))
    linear = linearised(known, result.state, weighted_rays(result))
    cofactor = with_considered(known, linear, covariance_of(known, result.state, linear))
    points = points_alone(known, linear, cofactor)
    computed = result.computed or Covariances(network, result.cofactor, result.point_covariance)
    return replace(result, network=known, cofactor=cofactor, point_covariance=points, computed=computed)


def _moments(result: Adjustment, held: np.ndarray, sigma: np.ndarray) -> list[np.ndarray]:
    """The second moments of the `held` (C, 17) parameters of each camera about their values."""
    network = result.network
    weight = network.interior.weight.copy()
    weight[held[:, :, None] | held[:, None, :]] = 0.0
    for k, i in np.argwhere(held):
        weight[k, i, i] = 1.0 / sigma[k, i] ** 2
    # All of them are unknowns here, a considered constant too: what trades against it is not known without it.
    none = np.zeros_like(held)
    free = replace(network.interior, free=network.interior.free | held, considered=none, weight=weight)
    network = replace(network, interior=free)
    step, cofactor = step_in(network, result)
    enlarged = np.maximum(rays_per_photograph(result) / AREAS, 1.0)
    columns = network.interior_columns
    return [
        moment(cofactor.joint(own[of]), step[own[of]], prior[of], by) if of.any() else np.zeros((0, 0))
        for own, of, prior, by in zip(columns, held, sigma, enlarged, strict=True)
    ]


def moment(covariance: np.ndarray, step: np.ndarray, prior: np.ndarray, enlarged: float) -> np.ndarray:
    """The second moment (k, k) about the held values of parameters that an adjustment with the standard errors `prior` (k,) would
    move by `step` (k,) with the `covariance` (k, k), after the weights of its observations are divided by `enlarged`."""
    # In units of the prior: pixels and coefficients differ by powers of ten.
    inverse = np.linalg.inv(covariance / np.outer(prior, prior))
    values, vectors = np.linalg.eigh(inverse - np.eye(len(prior)))
    observed = (vectors * np.maximum(values, 0.0)) @ vectors.T / enlarged
    found = np.linalg.inv(np.eye(len(prior)) + observed)
    mean = found @ inverse @ (step / prior) / enlarged
    return (found + np.outer(mean, mean)) * np.outer(prior, prior)


def _considered(interior: Interior, held: np.ndarray, moments: list[np.ndarray]) -> Interior:
    weight = interior.weight.copy()
    for own, of, found in zip(weight, held, moments, strict=True):
        own[of], own[:, of] = 0.0, 0.0
        if of.any():
            scale = np.sqrt(np.diag(found))
            own[np.ix_(of, of)] = np.linalg.inv(found / np.outer(scale, scale)) / np.outer(scale, scale)
    return replace(interior, free=interior.free | held, considered=interior.considered | held, weight=weight)
