"""Camera constants that the block contradicts: a zoom lens, a wrong tag, photographs of another size than their camera.

A camera constant that was given is an observation like any other, and it is tested like one: where the adjusted value leaves the
given one by many of its standard errors, or where a held one pulls at its bonds, the block is adjusted once more with nothing known
of it. What then fits, and is well determined, decides. A prior that is wrong by a factor of two would otherwise bend the block
towards itself, and positions and control would be blamed for it. A block that was begun with a wrong constant has lost tie points
to it, or does not find its way from so far: its start is made once more with what fits (`Tested.anew`).
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.bundle import BlunderTest, adjust
from orthomill.tasks.adjustment.model.adjustment_result import Adjustment
from orthomill.tasks.adjustment.model.datum import add_prior
from orthomill.tasks.adjustment.model.interior import given_sigmas
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.solve.minimise import UNDETERMINED
from orthomill.tasks.adjustment.solve.normal_equations import reduced_normals
from orthomill.tasks.adjustment.sparse.block_matrix import BlockMatrix
from orthomill.tasks.adjustment.testing.covariances import covariance_of
from orthomill.tasks.orientation.block.self_calibration import held_fixed

DETERMINED = 3.0
"""A free camera constant decides where it is this many of its own standard errors from the given one."""
MOVED = 5.0
"""A camera constant that left its given value by more of its standard errors contradicts it."""
FARTHEST = 2.0
"""The block begins once more with a camera constant this many times as long or short at most."""


@dataclass(frozen=True, eq=False)
class Tested:
    """An adjustment, sentences about the interior orientation, and `anew` (C,) px: camera constants with which the start of the
    block is to be made once more (NaN: as they were given)."""

    result: Adjustment
    remarks: tuple[str, ...]
    anew: np.ndarray


def adjust_tested(network: Network, state: State, rays: Rays, test: BlunderTest, names: tuple[str, ...], held: bool) -> Tested:
    """The adjustment without the camera constants that it contradicts, unless they are to be `held`, and sentences about the
    interior orientation. A `state` with other constants than the given ones says that the tie points fitted these better.

    Raises GeometryError as `adjust`.
    """
    given = network.interior.value[:, 0]
    begun = state.interior[:, 0] != given
    freed, wrong = _freed(network, state, rays, test, begun)
    if freed is not None and not held:
        return Tested(freed, _told(freed, wrong, given, names, held), _constants(wrong, freed.state.interior[:, 0]))
    interior = np.where(begun[:, None], network.interior.value, state.interior)
    result, remarks = _determined(network, replace(state, interior=interior), rays, test, names)
    if freed is not None:
        return Tested(result, (*remarks, *_told(freed, wrong, given, names, held)), np.full(len(given), np.nan))
    doubtful, toward = doubtful_constants(result)
    freed, wrong = _freed(network, result.state, rays, test, doubtful)
    if freed is None:
        return Tested(result, remarks, _constants(doubtful & wrong, toward))
    told = (*remarks, *_told(freed, wrong, given, names, held))
    return Tested(result if held else freed, told, _constants(wrong, freed.state.interior[:, 0]))


def _constants(cameras: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.where(cameras, values, np.nan)


def _determined(
    network: Network, state: State, rays: Rays, test: BlunderTest, names: tuple[str, ...]
) -> tuple[Adjustment, tuple[str, ...]]:
    """The adjustment; with all interior orientations held where they are not determined."""
    try:
        return adjust(network, state, rays, test), ()
    except GeometryError as error:
        if str(error) != UNDETERMINED or not network.interior.free.any():
            raise
        network, remarks = held_fixed(network, names)
        return adjust(network, state, rays, test), remarks


def _freed(
    network: Network, state: State, rays: Rays, test: BlunderTest, doubtful: np.ndarray
) -> tuple[Adjustment | None, np.ndarray]:
    """The adjustment with nothing known of those of the `doubtful` (C,) constants that it contradicts, and which these are. None
    where it contradicts none of them; None and the doubtful ones where it fails."""
    given, sigma_given = network.interior.value[:, 0], given_sigmas(network.interior)[:, 0]
    while doubtful.any():
        try:
            freed = adjust(with_free_constants(network, doubtful), state, rays, test)
        except GeometryError:
            return None, doubtful
        fits, sigma = freed.state.interior[:, 0], _constant_sigmas(freed)
        wrong = doubtful & (np.abs(fits - given) > np.maximum(MOVED * sigma_given, DETERMINED * sigma))
        if (wrong == doubtful).all():
            return freed, wrong
        interior = state.interior.copy()
        interior[:, 0] = np.where(wrong, fits, given)
        state, doubtful = replace(state, interior=interior), wrong
    return None, doubtful


def _constant_sigmas(freed: Adjustment) -> np.ndarray:
    """(C,) standard errors of the constants, px; 0 for those that were held."""
    column = freed.network.interior_columns[:, 0]
    return np.where(column >= 0, np.sqrt(np.maximum(freed.cofactor.variances[column], 0.0)), 0.0)


def _told(freed: Adjustment, wrong: np.ndarray, given: np.ndarray, names: tuple[str, ...], held: bool) -> tuple[str, ...]:
    fits, sigma = freed.state.interior[:, 0], _constant_sigmas(freed)
    return tuple(_sentence(names[k], given[k], fits[k], sigma[k], held) for k in np.flatnonzero(wrong))


def doubtful_constants(result: Adjustment) -> tuple[np.ndarray, np.ndarray]:
    """(C,) bool: cameras whose constant was moved far from its given value, or would move far if it were let free; and (C,) px
    where they are, or where one step would take them (at most to half or twice the given value)."""
    interior, given = result.network.interior, result.network.interior.value[:, 0]
    moved = np.abs(result.state.interior[:, 0] - given)
    present = np.isin(np.arange(len(interior.value)), result.network.camera_of)
    adjusted = interior.free[:, 0] & ~interior.considered[:, 0]
    known = np.diagonal(interior.weight, axis1=1, axis2=2)[:, 0] > 0
    found, toward = present & adjusted & known & (moved > MOVED * given_sigmas(interior)[:, 0]), result.state.interior[:, 0]
    if (present & ~adjusted).any():
        step, sigma = _pull(result, present & ~adjusted)
        found |= present & ~adjusted & (np.abs(step) > MOVED * sigma) & (np.abs(step) > given_sigmas(interior)[:, 0])
        toward = toward + step
    return found, np.clip(toward, given / FARTHEST, given * FARTHEST)


def with_free_constants(network: Network, cameras: np.ndarray) -> Network:
    """The network with the constants of `cameras` (C,) bool free and nothing known of them."""
    interior = network.interior
    free, weight, considered = interior.free.copy(), interior.weight.copy(), interior.considered.copy()
    free[cameras, 0], considered[cameras, 0] = True, False
    weight[cameras, 0], weight[cameras, :, 0] = 0.0, 0.0
    return replace(network, interior=replace(interior, free=free, weight=weight, considered=considered))


def _sentence(name: str, given: float, fits: float, sigma: float, held: bool) -> str:
    end = "but the workflow holds it" if held else "which was used"
    return (
        f"The block contradicts the camera constant of {name}: {given:.0f} px were given, {fits:.0f} px (standard error "
        f"{_digits(sigma)} px) fit, {end}. Look for a wrong focal length, zoom or photograph size, or calibrate the camera."
    )


def _digits(sigma: float) -> str:
    return f"{sigma:.0f}" if sigma >= 1.0 else f"{sigma:.2g}"


def _pull(result: Adjustment, cameras: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(C,) how far the constants would move in one step if they were free, and the standard errors of these steps, px; 0 and inf
    where they are not determined."""
    network, state = with_free_constants(result.network, cameras), result.state
    linear = linearised(network, state, replace(result.rays, sigma=result.ray_sigma).take(result.used))
    try:
        cofactor = covariance_of(network, state, linear)
    except GeometryError:
        return np.zeros(len(cameras)), np.full(len(cameras), np.inf)
    pattern, column = cofactor.blocks.pattern, network.interior_columns[:, 0]
    right = reduced_normals(linear, pattern).right + add_prior(network, state, BlockMatrix.zero(pattern))
    step, sigma = cofactor.times(right[:, None])[:, 0], np.sqrt(np.maximum(cofactor.variances, 0.0))
    return np.where(cameras, step[column], 0.0), np.where(cameras, sigma[column], np.inf)
