"""Errors that all differences at check points share, named for what they are: shift, tilt, dome, scale, turn.

Heights follow 1, x, y and the square of the distance from the middle, without their means, so that a dome is no shift, and the
heights of the ground, where its relief shows what no plane or bowl does; plan follows a similarity. A part is named where it is
beyond chance (t-test, 99.9 %) by the noise that all parts together leave.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from orthomill.schemas.accuracy.accuracy_statement import NamedError
from orthomill.tasks.geometry.coordinate_ranges import FOOT, in_feet

_SURE = 0.9995
"""two-sided 99.9 %"""
_LEAST_RELIEF = 20.0
"""times the scatter of the differences: an error of a surveyed height is in the difference as well, and looks like a scale"""
_LEAST_IN_FEET = 3
"""points at which feet are no chance: a shift explains one, and two by luck"""
_COMPASS = ("east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east")


@dataclass(frozen=True)
class _ErrorFit:
    """Parameters with their covariance, and the value of Student's t beyond which one is no chance."""

    design: np.ndarray
    points: int
    value: np.ndarray
    covariance: np.ndarray
    limit: float

    def sigma(self, parts: list[int]) -> float:
        return math.sqrt(max(float(np.trace(self.covariance[np.ix_(parts, parts)])), 0.0))

    def displaced(self, parts: list[int]) -> float:
        """Root mean square, m, over the points of what these parameters do there, in all coordinates."""
        return math.sqrt(float(((self.design[:, parts] @ self.value[parts]) ** 2).sum()) / self.points)

    def sure(self, parts: list[int]) -> bool:
        value, covariance = self.value[parts], self.covariance[np.ix_(parts, parts)]
        # For two parameters Hotelling's statistic against twice the square of t: a little strict, never lax.
        distance = value @ np.linalg.pinv(covariance) @ value
        return bool(distance > len(parts) * self.limit**2)


def named_errors(
    places: np.ndarray,
    height: np.ndarray,
    plan: np.ndarray,
    survey: tuple[float, float] = (0.0, 0.0),
    promised: tuple[float | None, float | None] = (None, None),
    ground: np.ndarray | None = None,
) -> tuple[NamedError, ...]:
    """What the differences share, the largest first.

    places (N, 2) X, Y m; height (N,) and plan (N, 2) differences m, NaN where they were not tested; survey: standard errors of the
    survey in a plan coordinate and in height, m: the differences scatter by chance no less than that; promised: standard errors, m,
    of the place of the block at the points, in plan (radial) and in height, with which each error is compared; ground (N,): the
    surveyed heights, m, without which no scale of heights is looked for.
    """
    in_plan, in_height = promised
    found = [_compared(error, in_height) for error in _of_heights(places, height, survey[1], ground)]
    found += [_compared(error, in_plan) for error in _of_plan(places, plan, survey[0])]
    return tuple(sorted(found, key=lambda error: -error.size))


def heights_in_feet(surveyed: np.ndarray, height: np.ndarray, survey: float) -> NamedError | None:
    """Heights of the points, or of the product, that are feet where metres are expected; None where metres explain them.

    surveyed (N,), height (N,): m, NaN where they were not tested; survey: standard error of the surveyed heights, m. International
    and US survey feet differ by two millionths, which heights do not tell.
    """
    known = np.isfinite(height)
    if known.sum() < _LEAST_IN_FEET:
        return None
    points, product = surveyed[known], height[known]
    if in_feet(points, product):
        what, left = "The heights of the points are", product - FOOT * points
    elif in_feet(product, points):
        what, left = "The heights of the product are", FOOT * product - points
    else:
        return None
    difference = product - points
    size, rest = (float(np.sqrt((d**2).mean())) for d in (difference, left))
    # On level ground feet are a shift: they are named where they explain what a shift does, which may take any value.
    if rest > max(float(difference.std()), survey):
        return None
    words = f"{what} in feet, not in metres: multiplied with 0.3048 they differ by {rest:.3f} m instead of {size:.2f} m."
    return NamedError(kind="feet", size=size, sigma=max(rest, survey), displaced=size, sentence=words)


def _compared(error: NamedError, promised: float | None) -> NamedError:
    """With what the block promises of its place, and a sentence that says whether it may be so."""
    if promised is None:
        return error
    known = error.model_copy(update={"promised": promised})
    times = f"{error.displaced / max(promised, 1e-9):.2g} times the standard error of the block's place ({promised:.3f} m)"
    allowed = f"which the standard error of the block's place ({promised:.3f} m) allows"
    return known.model_copy(update={"sentence": f"{error.sentence[:-1]}, {allowed if known.is_promised else times}."})


def _fitted(design: np.ndarray, observed: np.ndarray, survey: float, coordinates: int = 1) -> _ErrorFit | None:
    freedom = len(observed) - design.shape[1]
    if freedom < 2 or np.linalg.matrix_rank(design) < design.shape[1]:
        return None
    value = np.linalg.lstsq(design, observed, rcond=None)[0]
    noise = float(((observed - design @ value) ** 2).sum()) / freedom
    # A noise of nothing would make every rounding error sure.
    covariance = max(noise, survey**2, 1e-12) * np.linalg.inv(design.T @ design)
    return _ErrorFit(design, len(design) // coordinates, value, covariance, float(stdtrit(freedom, _SURE)))


def _about_middle(places: np.ndarray) -> tuple[np.ndarray, float]:
    """Places from their middle in units of the farthest one's distance, and that distance, m."""
    away = places - places.mean(axis=0)
    reach = float(np.linalg.norm(away, axis=1).max()) or 1.0
    return away / reach, reach


def _of_heights(places: np.ndarray, height: np.ndarray, survey: float, ground: np.ndarray | None) -> list[NamedError]:
    known = np.isfinite(height)
    if known.sum() < 4:
        return []
    (unit, reach), dh = _about_middle(places[known]), height[known]
    square = (unit**2).sum(axis=1)
    parts = [np.ones(len(dh)), unit[:, 0], unit[:, 1]]
    bent = _fitted(np.column_stack([*parts, square - square.mean()]), dh, survey)
    fit = bent or _fitted(np.column_stack(parts), dh, survey) or _fitted(np.ones((len(dh), 1)), dh, survey)
    if fit is None:
        return []
    found = []
    if ground is not None and (scaled := _scaled_heights(fit.design, ground[known], dh, survey)):
        fit, error = scaled
        bent = bent and fit
        found.append(error)
    if fit.sure([0]):
        side = "high" if fit.value[0] > 0 else "low"
        found.append(_error("shift_up", fit, [0], f"The surface as a whole lies {{size}} too {side}"))
    if fit.design.shape[1] > 2 and fit.sure([1, 2]):
        size = 2 * math.hypot(fit.value[1], fit.value[2])
        way = _COMPASS[round(math.atan2(fit.value[2], fit.value[1]) / (math.pi / 4)) % 8]
        words = (
            f"The surface is tilted: it rises by {{size}} towards the {way} across the points ({500 * size / reach:.2g} m per km)"
        )
        found.append(_error("tilt", fit, [1, 2], words))
    if bent and bent.sure([3]):
        shape = "bowl-shaped: its middle lies {size} too low" if bent.value[3] > 0 else "domed: its middle lies {size} too high"
        found.append(_error("dome", bent, [3], f"The surface is {shape} against its edges"))
    return found


def _scaled_heights(
    design: np.ndarray, ground: np.ndarray, difference: np.ndarray, survey: float
) -> tuple[_ErrorFit, NamedError] | None:
    """A scale of heights, and the fit of all parts beside it; None where there is none, or too little relief to tell."""
    relief = ground - design @ np.linalg.lstsq(design, ground, rcond=None)[0]
    away = ground - ground.mean()
    reach = float(np.abs(away).max()) or 1.0
    fit = _fitted(np.column_stack([design, away / reach]), difference, survey)
    if fit is None:
        return None
    last = design.shape[1]
    scatter = max(float((difference - fit.design @ fit.value).std()), survey)
    if not fit.sure([last]) or relief.std() < _LEAST_RELIEF * scatter:
        return None
    large = "large" if fit.value[last] > 0 else "small"
    percent = 100 * abs(fit.value[last]) / reach
    words = f"Heights are scaled: their differences are {percent:.2g} % too {large}, {{size}} at the point farthest from their mean"
    return fit, _error("scale_up", fit, [last], words)


def _of_plan(places: np.ndarray, plan: np.ndarray, survey: float) -> list[NamedError]:
    known = np.isfinite(plan).all(axis=1)
    if known.sum() < 3:
        return []
    (unit, reach), d = _about_middle(places[known]), plan[known]
    one, none = np.ones(len(d)), np.zeros(len(d))
    east = np.column_stack([one, none, unit[:, 0], -unit[:, 1]])
    north = np.column_stack([none, one, unit[:, 1], unit[:, 0]])
    fit = _fitted(np.concatenate([east, north]), np.concatenate([d[:, 0], d[:, 1]]), survey, 2)
    if fit is None:
        return []
    found = []
    if fit.sure([0, 1]):
        way = _COMPASS[round(math.atan2(fit.value[1], fit.value[0]) / (math.pi / 4)) % 8]
        found.append(_error("shift_plan", fit, [0, 1], f"The whole is shifted {{size}} towards the {way}"))
    if fit.sure([2]):
        large = "large" if fit.value[2] > 0 else "small"
        ppm = 1e6 * abs(fit.value[2]) / reach
        words = f"The scale is wrong: everything is {ppm:.0f} millionths too {large}, {{size}} at the farthest point"
        found.append(_error("scale", fit, [2], words))
    if fit.sure([3]):
        turn = "counter-clockwise" if fit.value[3] > 0 else "clockwise"
        degrees = math.degrees(abs(fit.value[3]) / reach)
        words = f"The whole is turned {turn} by {degrees:.2g} degrees, {{size}} at the farthest point"
        found.append(_error("turn", fit, [3], words))
    return found


def _error(kind: str, fit: _ErrorFit, parts: list[int], words: str) -> NamedError:
    # A tilt is told as the rise from one side of the points to the other, both ends together.
    ends = 2 if kind == "tilt" else 1
    size, sigma = ends * float(np.linalg.norm(fit.value[parts])), ends * fit.sigma(parts)
    value = f"{size:.3f} m (standard error {sigma:.3f} m)" if size < 1 else f"{size:.2f} m (standard error {sigma:.2f} m)"
    told = {
        "kind": kind,
        "size": size,
        "sigma": sigma,
        "displaced": fit.displaced(parts),
        "sentence": words.format(size=value) + ".",
    }
    return NamedError.model_validate(told)
