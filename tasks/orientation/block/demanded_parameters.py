"""Interior parameters that a nominal camera keeps, and which its block demands: principal point and k3.

Without control c, x0 and y0 of a camera that is known from tags only are not adjusted, and its k3 is 0: over flat ground they
trade against flying height, tilts and each other, and systematic image errors would push them. Where the camera differs from that
by much, the block bends instead, by metres, and its residuals show it: one Gauss-Newton step with x0, y0 and k3 free moves them
by many standard errors, even if a photograph counts as one independent measurement in each of von Gruber's areas. Then, and only
then, they are unknowns. The camera constant stays: a wrong one scales heights, and hardly bends them.

No position and no attitude takes part in this decision, and no stated standard error of them.
"""

from dataclasses import replace

import numpy as np

from orthomill.schemas.camera import INTERIOR
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.findings.camera_findings import InteriorDemanded
from orthomill.tasks.adjustment.bundle import BlunderTest
from orthomill.tasks.adjustment.model.interior import UNKNOWN_SIGMA
from orthomill.tasks.adjustment.model.network import Interior, Network, Rays, State
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.geometry.distortion import BROWN
from orthomill.tasks.orientation.block.camera_constant import Tested, adjust_tested, step_in
from orthomill.tasks.orientation.block.self_calibration import AREAS, rays_per_photograph

HELD = np.array([INTERIOR.index(name) for name in ("x0", "y0", "k3")])
"""What the rule of nominal cameras keeps, besides c."""
DEMANDED = 25.0
"""Squared length of the step in its standard errors, with AREAS independent measurements per photograph: five of them, as for
contradicted camera constants and lenses."""


def adjust_with_demanded(
    network: Network, state: State, rays: Rays, test: BlunderTest, names: tuple[str, ...], held: np.ndarray, fixed: bool
) -> Tested:
    """The adjustment, in which those parameters are unknowns that the block demands; `held` (C, 17) bool: those that a rule keeps,
    and not the workflow. Raises GeometryError as `adjust_tested`."""
    tested = adjust_tested(network, state, rays, test, names, fixed)
    cameras = demanding(tested.result, held)
    if not cameras.any():
        return tested
    freed = replace(network, interior=_with_unknown(network.interior, held & cameras[:, None]))
    # Camera constants begin at their given values: others would be taken for values with which the start was made.
    interior = tested.result.state.interior.copy()
    interior[:, 0] = state.interior[:, 0]
    try:
        second = adjust_tested(freed, replace(tested.result.state, interior=interior), rays, test, names, fixed)
    except GeometryError:
        return tested
    if second.result.sigma0_px >= tested.result.sigma0_px:
        return tested
    findings = tuple(_finding(tested.result, second.result, int(k), names[k]) for k in np.flatnonzero(cameras))
    return replace(second, findings=(*second.findings, *findings))


def held_by_rule(interior: Interior, nominal: np.ndarray, named: np.ndarray) -> np.ndarray:
    """(C, 17) bool: the parameters of HELD that `nominal` (C,) bool cameras keep although the workflow lets the `named` (17,) take
    part."""
    held = np.zeros_like(interior.free)
    brown = np.ones(len(interior.value), bool) if interior.lens is None else interior.lens == BROWN
    held[:, HELD] = (~interior.free | interior.considered)[:, HELD]
    return held & (nominal & brown)[:, None] & named


def demanding(result: Adjustment, held: np.ndarray) -> np.ndarray:
    """(C,) bool: cameras whose `held` (C, 17) parameters the block wants elsewhere by far."""
    network, cameras = result.network, np.zeros(len(held), bool)
    # A camera that had to be kept as it is, as the block determines none, asks for nothing.
    asked = np.isin(np.arange(len(held)), network.camera_of[result.rays.photo[result.used]]) & network.interior.free.any(axis=1)
    held = held & asked[:, None]
    if not held.any():
        return cameras
    free = replace(network, interior=_without_prior(_with_unknown(network.interior, held), held))
    try:
        step, cofactor = step_in(free, result)
    except GeometryError:
        return cameras
    independent = AREAS / rays_per_photograph(result)
    for k in np.flatnonzero(held.any(axis=1)):
        own = free.interior_columns[k][held[k]]
        square = float(step[own] @ np.linalg.pinv(cofactor.joint(own), hermitian=True, rcond=1e-12) @ step[own])
        cameras[k] = square * min(independent[k], 1.0) > DEMANDED
    return cameras


def _with_unknown(interior: Interior, chosen: np.ndarray) -> Interior:
    """The interior orientation in which the `chosen` (C, 17) bool parameters are unknowns, with the standard errors that were
    given, or those of a lens that nobody has measured."""
    weight = interior.weight.copy()
    for k, i in np.argwhere(chosen & ~interior.free):
        weight[k, i, i] = 1.0 / UNKNOWN_SIGMA[INTERIOR[i]] ** 2
    return replace(interior, free=interior.free | chosen, considered=interior.considered & ~chosen, weight=weight)


def _without_prior(interior: Interior, chosen: np.ndarray) -> Interior:
    both = chosen[:, :, None] | chosen[:, None, :]
    return replace(interior, weight=np.where(both, 0.0, interior.weight))


def _finding(before: Adjustment, after: Adjustment, camera: int, name: str) -> InteriorDemanded:
    x0, y0, k3 = (float(after.state.interior[camera, i]) for i in HELD)
    return InteriorDemanded(camera=name, x0_px=x0, y0_px=y0, k3=k3, sigma0_px=(float(before.sigma0_px), float(after.sigma0_px)))
