"""Camera constants that the block contradicts: a zoom lens, a wrong tag, photographs of another size than their camera.

A given camera constant is an observation like any other, and it is tested like one: where the adjusted value differs from the given
one by many standard errors, or where a fixed one would move far if it were free, the block is adjusted again with no prior on it.
The value that then fits decides, if it is well determined. Otherwise a prior that is wrong by a factor of two would deform the
block, and positions and control would be blamed for it. A start made with a wrong constant has lost tie points to it, or is too far
off to converge: it is made again with the value that fits (`Tested.restart`).
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.findings.block_findings import BlockFinding
from orthomill.schemas.findings.camera_findings import ConstantContradicted
from orthomill.tasks.adjustment.bundle import BlunderTest, adjust
from orthomill.tasks.adjustment.model.datum import add_prior
from orthomill.tasks.adjustment.model.interior import NOMINAL_SIGMA, given_sigmas
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.solve.minimise import UNDETERMINED, NotConverged
from orthomill.tasks.adjustment.solve.normal_equations import reduced_normals
from orthomill.tasks.adjustment.sparse.block_matrix import BlockMatrix
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.adjustment.testing.covariances import Covariance, covariance_of
from orthomill.tasks.orientation.block.self_calibration import AREAS, all_fixed, rays_per_photograph

DETERMINED = 3.0
"""A free camera constant replaces the given one from this many of its own standard errors on: the usual three-sigma test."""
MOVED = 5.0
"""An adjusted camera constant contradicts the given one beyond this many standard errors of the given one. Wider than the test of
the free constant, because systematic image errors move an adjusted constant by some of its formal standard errors."""
ELSEWHERE = NOMINAL_SIGMA["c"]
"""An adjusted constant that the block wants elsewhere by more, in units of it, is that of another zoom or size: even EXIF is
better. Systematic image errors move free constants by tenths of a percent."""
OF_ERRORS = 1.5
"""Factor up to which errors that neighbouring rays share may take a constant, as seen in blocks of real photographs (1.3); wrong
tags are mostly wrong by more."""
FARTHEST = 2.0
"""Largest factor, up or down, of a camera constant with which the start is made again: one linearised step from a wrong constant
overshoots."""


@dataclass(frozen=True, eq=False)
class Tested:
    """An adjustment, what it found out about the interior orientation, and `restart` (C,) px: camera constants with which the start
    of the block is to be made again (NaN: as given)."""

    result: Adjustment
    findings: tuple[BlockFinding, ...]
    restart: np.ndarray


def adjust_tested(network: Network, state: State, rays: Rays, test: BlunderTest, names: tuple[str, ...], fixed: bool) -> Tested:
    """The adjustment without the given camera constants that it contradicts (unless they are `fixed`: then they are only reported).
    A `state` whose constants differ from the given ones means that the tie points fitted these better at the start.

    Raises GeometryError as `adjust`.
    """
    # The start may have replaced constants (`start_blocks`), and says so by its state only.
    given = network.interior.value[:, 0]
    replaced = state.interior[:, 0] != given
    # Constants that the start replaced are tested first: the prior at the given value would only pull the block away again.
    freed, wrong = _freed(network, state, rays, test, replaced)
    if freed is not None and not fixed:
        return Tested(freed, _contradicted(freed, wrong, given, names, fixed), _constants(wrong, freed.state.interior[:, 0]))
    interior = np.where(replaced[:, None], network.interior.value, state.interior)
    result, findings = _determined(network, replace(state, interior=interior), rays, test, names)
    if freed is not None:
        return Tested(result, (*findings, *_contradicted(freed, wrong, given, names, fixed)), np.full(len(given), np.nan))
    doubtful, toward = doubtful_constants(result)
    freed, wrong = _freed(network, result.state, rays, test, doubtful)
    if freed is None:
        # Free constants do not converge from here, but a start with them may: one linearised step says where to begin.
        return Tested(result, findings, _constants(doubtful & wrong, toward))
    findings = (*findings, *_contradicted(freed, wrong, given, names, fixed))
    return Tested(result if fixed else freed, findings, _constants(wrong, freed.state.interior[:, 0]))


def _constants(cameras: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.where(cameras, values, np.nan)


def _determined(
    network: Network, state: State, rays: Rays, test: BlunderTest, names: tuple[str, ...]
) -> tuple[Adjustment, tuple[BlockFinding, ...]]:
    """The adjustment; with all interior orientations fixed where they are not determined, or keep a free block from converging."""
    try:
        return adjust(network, state, rays, test), ()
    except GeometryError as error:
        # Of a free block nothing else can be given up; one with a datum is tried without it (`adjusted_block`).
        loose = str(error) == UNDETERMINED or (network.free and isinstance(error, NotConverged))
        if not loose or not network.interior.free.any():
            raise
        network, finding = all_fixed(network, names)
        return adjust(network, state, rays, test), (finding,)


def _freed(
    network: Network, state: State, rays: Rays, test: BlunderTest, doubtful: np.ndarray
) -> tuple[Adjustment | None, np.ndarray]:
    """The adjustment without priors on those `doubtful` (C,) constants that it contradicts, and which these are. None where it
    contradicts none of them; None and the doubtful ones where it fails."""
    given, sigma_given = network.interior.value[:, 0], given_sigmas(network.interior)[:, 0]
    while doubtful.any():
        try:
            freed = adjust(with_free_constants(network, doubtful), state, rays, test)
        except GeometryError:
            return None, doubtful
        fits, sigma = freed.state.interior[:, 0], _constant_sigmas(freed)
        sigma = np.where(np.maximum(fits / given, given / fits) < OF_ERRORS, sigma * _alike(freed), sigma)
        wrong = doubtful & (np.abs(fits - given) > np.maximum(MOVED * sigma_given, DETERMINED * sigma))
        if (wrong == doubtful).all():
            return freed, wrong
        # The others take their given values back and their priors again, which may change which ones are contradicted.
        interior = state.interior.copy()
        interior[:, 0] = np.where(wrong, fits, given)
        state, doubtful = replace(state, interior=interior), wrong
    return None, doubtful


def _alike(result: Adjustment) -> np.ndarray:
    """(C,) by how much standard errors grow where a photograph counts as one measurement in each of its areas: over flat ground
    errors that neighbours share take a constant as far as a wrong tag does."""
    return np.sqrt(np.maximum(rays_per_photograph(result) / AREAS, 1.0))


def _constant_sigmas(freed: Adjustment) -> np.ndarray:
    """(C,) standard errors of the constants, px; 0 for those that were fixed."""
    column = freed.network.interior_columns[:, 0]
    return np.where(column >= 0, np.sqrt(np.maximum(freed.cofactor.variances[column], 0.0)), 0.0)


def _contradicted(
    freed: Adjustment, wrong: np.ndarray, given: np.ndarray, names: tuple[str, ...], fixed: bool
) -> tuple[ConstantContradicted, ...]:
    fits, sigma = freed.state.interior[:, 0], _constant_sigmas(freed)
    return tuple(
        ConstantContradicted(
            camera=names[k], given_px=float(given[k]), adjusted_px=float(fits[k]), sigma_px=float(sigma[k]), fixed=fixed
        )
        for k in np.flatnonzero(wrong)
    )


def doubtful_constants(result: Adjustment) -> tuple[np.ndarray, np.ndarray]:
    """(C,) bool: cameras whose constant moved far from its given value, or would move far if it were free; and (C,) px where they
    are, or where one step would take them (at most to half or twice the given value)."""
    interior, given = result.network.interior, result.network.interior.value[:, 0]
    moved = np.abs(result.state.interior[:, 0] - given)
    present = np.isin(np.arange(len(interior.value)), result.network.camera_of)
    adjusted = interior.free[:, 0] & ~interior.considered[:, 0]
    # A constant without a prior has no given value that could be contradicted.
    known = np.diagonal(interior.weight, axis1=1, axis2=2)[:, 0] > 0
    found, toward = present & adjusted & known & (moved > MOVED * given_sigmas(interior)[:, 0]), result.state.interior[:, 0]
    held = present & (~adjusted | (known & _pulled(result, moved)))
    if held.any():
        step, sigma = _step_if_free(result, held)
        # Significant against its own noise, and large against what was stated: a fixed constant may be a little off, and systematic
        # errors pull at one that was calibrated.
        stated = np.where(adjusted, np.maximum(given_sigmas(interior)[:, 0], ELSEWHERE * given), given_sigmas(interior)[:, 0])
        found |= held & (np.abs(step) > MOVED * sigma) & (np.abs(step) > stated)
        toward = toward + step
    return found, np.clip(toward, given / FARTHEST, given * FARTHEST)


def _pulled(result: Adjustment, moved: np.ndarray) -> np.ndarray:
    """(C,) bool: adjusted constants that moved by more than chance lets them, against priors that may hold them where they are.

    A constant moves from its given value with the difference of the variances before and after: a tight prior shows by little that
    the block pulls hard.
    """
    column = result.network.interior_columns[:, 0]
    after = np.where(column >= 0, result.cofactor.variances[column], 0.0)
    spread = np.sqrt(np.maximum(given_sigmas(result.network.interior)[:, 0] ** 2 - after, 0.0))
    return np.asarray((column >= 0) & (spread > 0) & (moved > MOVED * spread))


def with_free_constants(network: Network, cameras: np.ndarray) -> Network:
    """The network with the constants of `cameras` (C,) bool free and without priors."""
    interior = network.interior
    free, weight, considered = interior.free.copy(), interior.weight.copy(), interior.considered.copy()
    free[cameras, 0], considered[cameras, 0] = True, False
    weight[cameras, 0], weight[cameras, :, 0] = 0.0, 0.0
    return replace(network, interior=replace(interior, free=free, weight=weight, considered=considered))


def _step_if_free(result: Adjustment, cameras: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(C,) how far the constants would move in one Gauss-Newton step if they were free, and the standard errors of these steps, px;
    0 and inf where they are not determined."""
    network = with_free_constants(result.network, cameras)
    try:
        step, cofactor = step_in(network, result)
    except GeometryError:
        return np.zeros(len(cameras)), np.full(len(cameras), np.inf)
    column, sigma = network.interior_columns[:, 0], np.sqrt(np.maximum(cofactor.variances, 0.0))
    return np.where(cameras, step[column], 0.0), np.where(cameras, sigma[column], np.inf)


def step_in(network: Network, result: Adjustment) -> tuple[np.ndarray, Covariance]:
    """The Gauss-Newton step (n,) from a result in a network with more unknowns than its own, and their covariance. Raises
    GeometryError where these are not determined."""
    state = result.state
    linear = linearised(network, state, replace(result.rays, sigma=result.ray_sigma).take(result.used))
    cofactor = covariance_of(network, state, linear)
    pattern = cofactor.blocks.pattern
    # The given values pull with their own weights, as in the adjustment that would follow.
    right = reduced_normals(linear, pattern).right + add_prior(network, state, BlockMatrix.zero(pattern))
    return cofactor.times(right[:, None])[:, 0], cofactor
