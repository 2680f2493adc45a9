"""Joint registration of any number of scans: one least squares adjustment of all their control and tie points.

Strategy. (1) Scans are joined one after the other (scan_start). (2) A robust solution (Huber), so that blunders do not spread.
(3) Plain least squares; every scanned point and every control point is tested by the quadratic form of its misfit, the worst one
rejected alone, until none is left. A tie point that two scans show differently goes in both: nothing tells which one is wrong.
(4) The standard errors of scanned points are estimated from their residuals and redundancy; those of control stay as stated unless
contradicted.

Source: Baarda 1968 for the tests; Foerstner 1979 for variance components; M18 of sources/blending.md.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.registration.scan_network import ScannedPoints, ScanNetwork, ScanState
from orthomill.tasks.adjustment.registration.scan_solution import ScanPrecision, precision_of, solve
from orthomill.tasks.adjustment.registration.scan_start import start_state
from orthomill.tasks.adjustment.testing.surveyed_blunders import largest_square, misfit_square, usual_misfit
from orthomill.tasks.adjustment.testing.variance_components import enlarged

HUBER = 2.5
"""Limit of the robust solution, standard errors."""
# Exact coordinates of a test or of a design have residuals of rounding, and any of them would look large beside the others.
LEAST_FACTOR = 1e-4
"""Least ratio of estimated to stated standard errors."""
ROUNDS = 6
"""Most rounds of estimating standard errors; two are usual."""


@dataclass(frozen=True)
class ScanBlunder:
    """A point that contradicts the others: its number, the `scans` in which it was rejected (none: its control coordinates), how
    large the contradiction is, m, and in standard errors."""

    point: int
    scans: tuple[int, ...]
    size: float
    misfit: float


@dataclass(frozen=True, eq=False)
class Registration:
    """The registered scans.

    `used` (M,) marks the scanned points that took part; `residual` (M, 3) m, adjusted minus scanned, along the axes of each scan,
    of all of them; `standardised` (M,) the root of the quadratic form, NaN for those that took no part or cannot be tested, and
    `redundancy_number` (M,) of the three coordinates together. `factor` and `control_factor`: estimated over stated standard errors
    of scanned points and control, which the covariances include.
    """

    network: ScanNetwork
    state: ScanState
    points: ScannedPoints
    used: np.ndarray
    residual: np.ndarray
    standardised: np.ndarray
    redundancy_number: np.ndarray
    precision: ScanPrecision
    redundancy: int
    factor: float
    control_factor: float
    blunders: tuple[ScanBlunder, ...]
    iterations: int

    @property
    def sigma0(self) -> float:
        """Standard error of a coordinate of a typical scanned point, estimated from the residuals, m."""
        return float(self.factor * np.sqrt(np.mean(self.points.sigma[self.used] ** 2)))

    def scan_covariance(self, scan: int) -> np.ndarray:
        """(6, 6) of the translation, m, and the rotation vector, radians, of one scan."""
        own = slice(6 * scan, 6 * scan + 6)
        x, y, z = self.state.translation[scan] - self.precision.about[scan]
        # The translation is the place of the scan's origin, far from the points about which it was adjusted.
        J = np.eye(6)
        J[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
        return J @ self.precision.scans[own, own] @ J.T

    @property
    def point_covariance(self) -> np.ndarray:
        """(P, 3, 3) m^2 of the registered points."""
        return self.precision.points


def register(network: ScanNetwork, points: ScannedPoints, names: tuple[str, ...], limit: float = 4.0) -> Registration:
    """All scans in the system of the control; `names` (S,) of the scans for error messages, `limit` of the tests, standard errors.

    Raises GeometryError where scans cannot be joined, are not determined, or nothing checks them.
    """
    state, iterations = solve(network, start_state(network, points, names), points, HUBER)
    used, blunders = np.ones(len(points), bool), list[ScanBlunder]()
    factors = (1.0, 1.0)
    for _ in range(ROUNDS):
        while True:
            now = _adjusted(network, state, points, used, factors)
            state, iterations = now.state, iterations + now.iterations
            found = _worst(now, limit)
            if found is None:
                break
            blunders.append(found)
            network, used = _without(network, points, used, found)
        estimated = _factors(now, factors)
        settled = all(abs(new / old - 1.0) <= 0.01 for new, old in zip(estimated, factors, strict=True))
        factors = estimated
        if settled:
            break
    now = _adjusted(network, state, points, used, factors)
    return replace(now, blunders=tuple(blunders), iterations=iterations, points=points)


def _adjusted(
    network: ScanNetwork, start: ScanState, points: ScannedPoints, used: np.ndarray, factors: tuple[float, float]
) -> Registration:
    """The plain solution with standard errors enlarged by `factors` of scanned points and control, and its tests."""
    stated, network = points, replace(network, weight=network.weight / factors[1] ** 2)
    points = replace(points, sigma=points.sigma * factors[0])
    taken = points.take(used)
    state, iterations = solve(network, start, taken)
    precision = precision_of(network, state, taken)
    redundancy = _redundancy(network, taken)
    if redundancy <= 0:
        raise GeometryError(
            "Nothing checks the registration: the scans have just the points in common that place them; measure at least one more "
            "target in each, four or five are usual."
        )
    standardised, numbers = np.full(len(points), np.nan), np.full(len(points), np.nan)
    misfit = state.misfits(taken)
    tests = [misfit_square(np.full(3, s**-2.0), v, Q) for s, v, Q in zip(taken.sigma, misfit, precision.adjusted, strict=True)]
    standardised[used] = [np.sqrt(square) if dof else np.nan for square, dof in tests]
    numbers[used] = 3.0 - np.trace(precision.adjusted, axis1=1, axis2=2) / taken.sigma**2
    residual = state.residuals(points)
    return Registration(
        network, state, stated, used, residual, standardised, numbers, precision, redundancy, *factors, (), iterations
    )


def _redundancy(network: ScanNetwork, taken: ScannedPoints) -> int:
    # Coordinates of points that no scan shows take part on neither side.
    shown = np.bincount(taken.point, minlength=network.points) > 0
    observed = 3 * len(taken) + int((network.weight[shown] > 0).sum())
    return observed - 3 * int(shown.sum()) - int(network.moving.sum())


def _worst(now: Registration, limit: float) -> ScanBlunder | None:
    """The point that contradicts the rest most, beyond `limit` standard errors of a single number."""
    beyond = float(np.sqrt(largest_square(limit, 3)))
    # In units of the usual misfit of each group, or standard errors stated too small would make blunders of good points.
    square = np.nan_to_num(now.standardised) / usual_misfit(now.standardised[np.isfinite(now.standardised)])
    surveyed = _control_tests(now)
    surveyed /= usual_misfit(surveyed[surveyed > 0])
    control = int(surveyed.argmax()) if len(surveyed) else -1
    row = int(square.argmax())
    # What rests on the same two observations has the same misfit in both: control is the more trustworthy.
    if control >= 0 and surveyed[control] > max(beyond, square[row] * (1.0 + 1e-6)):
        away = float(np.linalg.norm(now.network.control[control] - now.state.point[control]))
        return ScanBlunder(control, (), away, float(surveyed[control]))
    if square[row] <= beyond:
        return None
    point = int(now.points.point[row])
    rows = np.flatnonzero(now.used & (now.points.point == point))
    alone = len(rows) == 2 and not now.network.weight[point].any()
    scans = tuple(int(now.points.scan[r]) for r in (rows if alone else [row]))
    # Of the blunder itself, of which the residual shows only what the redundancy leaves.
    size = float(np.linalg.norm(now.residual[row])) * 3.0 / max(float(now.redundancy_number[row]), 0.1)
    return ScanBlunder(point, scans, size, float(square[row]))


def _control_tests(now: Registration) -> np.ndarray:
    """(P,) the root of the quadratic form of each control point's misfit; 0 where there is nothing to test."""
    out = np.zeros(now.network.points)
    shown = np.bincount(now.points.point[now.used], minlength=now.network.points) > 0
    for i in np.flatnonzero(now.network.weight.any(axis=1) & shown):
        away = now.network.control[i] - now.state.point[i]
        square, dof = misfit_square(now.network.weight[i], away, now.precision.points[i])
        out[i] = np.sqrt(square) if dof else 0.0
    return out


def _without(network: ScanNetwork, points: ScannedPoints, used: np.ndarray, blunder: ScanBlunder) -> tuple[ScanNetwork, np.ndarray]:
    if not blunder.scans:
        return network.without_control(blunder.point), used
    return network, used & ~((points.point == blunder.point) & np.isin(points.scan, blunder.scans))


def _factors(now: Registration, old: tuple[float, float]) -> tuple[float, float]:
    """Ratios of estimated to stated standard errors of scanned points and of control."""
    taken = now.points.take(now.used)
    square = float((now.state.misfits(taken) ** 2 / (taken.sigma[:, None] * old[0]) ** 2).sum())
    redundancy = float(np.nansum(now.redundancy_number))
    scanned = old[0] * float(np.sqrt(square / redundancy)) if redundancy > 0 else old[0]
    weight = now.network.weight
    away = float((weight * (now.network.control - now.state.point) ** 2).sum())
    numbers = 1.0 - weight * np.diagonal(now.precision.points, axis1=1, axis2=2)
    return max(scanned, LEAST_FACTOR), enlarged(old[1], away, float(numbers[weight > 0].sum()))
