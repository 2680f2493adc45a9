"""Heights at points, and distances, slopes and profiles along lines, with standard errors."""

import math
from dataclasses import dataclass

import numpy as np

from orthomill.tasks.accuracy.answers.error_correlation import ErrorCorrelation
from orthomill.tasks.accuracy.answers.linear_answer import ErrorShares, SurfacePart, error_of


@dataclass(frozen=True)
class SpotHeight:
    """A height m, its standard error with its parts, and whether photographs measured it. NaN: no height."""

    height: float
    error: ErrorShares
    measured: bool


@dataclass(frozen=True)
class LineAnswer:
    """A line from its first to its last point: lengths and rise in m, slope as rise over run, each with its standard error."""

    plan: float
    plan_sigma: float
    space: float
    space_sigma: float
    rise: float
    rise_sigma: float
    slope: float
    slope_sigma: float


def bilinear_weights(shape: tuple[int, int], col: float, row: float) -> np.ndarray | None:
    """Weights (rows, cols) of the four cells around a place; None outside."""
    i, j = math.floor(row), math.floor(col)
    if i < 0 or j < 0 or i + 2 > shape[0] or j + 2 > shape[1]:
        return None
    out = np.zeros(shape)
    f, g = row - i, col - j
    out[i : i + 2, j : j + 2] = np.outer([1 - f, f], [1 - g, g])
    return out


def spot_height(part: SurfacePart, col: float, row: float, correlation: ErrorCorrelation) -> SpotHeight | None:
    """The height at a place of the part; None outside of it or without heights around."""
    # Of these four cells alone: a profile asks at thousands of places of a large part.
    i, j = max(math.floor(row), 0), max(math.floor(col), 0)
    part = part.cut(slice(i, i + 2), slice(j, j + 2))
    weights = bilinear_weights(part.height.shape, col - j, row - i)
    if weights is None or not np.isfinite(part.height[weights > 0]).all():
        return None
    height = float((weights * np.where(weights > 0, part.height, 0.0)).sum())
    return SpotHeight(height, error_of(weights, part, correlation), bool(part.measured[weights > 0].all()))


def line_answer(
    places: np.ndarray, pixels: np.ndarray, part: SurfacePart, correlation: ErrorCorrelation, sigma: float
) -> LineAnswer | None:
    """A line through places (N, 2) m, at pixels (N, 2) (col, row) of the part; None where an end has no height.

    The lengths follow the corners; sigma: standard error of a coordinate of a corner, m.
    """
    ends = [bilinear_weights(part.height.shape, *pixels[i]) for i in (0, -1)]
    if any(w is None or not np.isfinite(part.height[w > 0]).all() for w in ends):
        return None
    heights = np.array([_at(part.height, *pixel) for pixel in pixels])
    difference = ends[1] - ends[0]  # type: ignore[operator]
    rise, error = float(heights[-1] - heights[0]), error_of(difference, part, correlation).sigma
    steps = np.diff(places, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    plan, plan_sigma = float(lengths.sum()), _length_sigma(steps, lengths, sigma)
    space = float(np.hypot(lengths, np.diff(heights)).sum()) if np.isfinite(heights).all() else math.hypot(plan, rise)
    run = float(np.linalg.norm(places[-1] - places[0])) or math.nan
    slope = rise / run
    # At the ends of a straight line: what the plan gives along it, and the rise gives by its slope.
    steep = rise / space if space else 0.0
    return LineAnswer(
        plan=plan,
        plan_sigma=plan_sigma,
        space=space,
        space_sigma=math.hypot(plan_sigma * math.sqrt(max(1 - steep**2, 0.0)), error * steep),
        rise=rise,
        rise_sigma=error,
        slope=slope,
        slope_sigma=math.hypot(error / run, slope * math.sqrt(2) * sigma / run),
    )


def _length_sigma(steps: np.ndarray, lengths: np.ndarray, sigma: float) -> float:
    """Standard error of the length of a line whose corners (N) have independent errors."""
    way = steps / np.maximum(lengths, 1e-12)[:, None]
    pull = np.zeros((len(steps) + 1, 2))
    pull[:-1] -= way
    pull[1:] += way
    return sigma * float(np.sqrt((pull**2).sum()))


def _at(height: np.ndarray, col: float, row: float) -> float:
    weights = bilinear_weights(height.shape, col, row)
    return math.nan if weights is None else float((weights[weights > 0] * height[weights > 0]).sum())


def profile_places(places: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Distances (M,) along a line of corners (N, 2) m, every `step` m and at its end, and the places (M, 2) there."""
    lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    at = np.append(np.arange(0.0, along[-1], step), along[-1])
    return at, np.column_stack([np.interp(at, along, places[:, k]) for k in range(2)])
