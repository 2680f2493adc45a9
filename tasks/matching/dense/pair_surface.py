"""The surface of a rectified pair that has nothing but itself: a parallax at every node, and what it is worth.

Strategy
- Start from the volume of the pair (pair_start.py), its residual y-parallax removed; least squares near it, as for every block of a
  pair of a project (epipolar_least_squares.py).
- Where least squares gives nothing, the start itself is the answer; so it is beside a break where least squares ends nearer to
  another plane of the volume: windows pull nodes to the wrong side, and the volume, which weighs single pixels, knows it better.
- Three codes say what a parallax is: measured by least squares; by the volume alone, whose neighbours go along; estimated, where
  they do not or where something stands in front of the place.
- Beside a break of the surface the place of the edge is uncertain: what is assigned to the wrong side is wrong by the whole jump.
  The variance of that is the jump squared times how often it happens at this distance, which differs little between scenes.
- Where parallaxes are uneven, windows are drawn to other surfaces than their own.

Source: our own; benchmarks/results/matching.md, real pairs.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.dense.blocks import consistent, limits_of, moved_rows, residual_y_parallax
from orthomill.tasks.matching.dense.dense_settings import DenseMatching
from orthomill.tasks.matching.dense.epipolar_least_squares import NodeParallaxes, match_nodes
from orthomill.tasks.matching.dense.node_surfaces import StartSurface
from orthomill.tasks.matching.dense.pair_start import PAIR_VOLUME, PairStart, pair_start
from orthomill.tasks.matching.dense.unevenness import unevenness
from orthomill.tasks.matching.smoothing import smoothed, with_gaps
from orthomill.tasks.matching.volume.volume_settings import HeightVolume

_MISPLACED = ((2, 0.3), (4, 0.05))
"""share of parallaxes that belong to the other side of a break that is at most so many px away (four scenes of Middlebury)"""
_BREAK = 1.5
"""px: differences within a few px that are a break, beside a slope"""
_SLOPE = 0.3
"""px per px: slope that is no break"""
_IN_FRONT = np.float32(1.5)
"""px: parallaxes that are larger by this belong to something that stands in front"""
_HALF_PLANE = 0.5
"""px: half the distance of the volume's planes; who ends farther from its winner says that another plane is right"""
_USUAL = 3.0 * 1.4826
"""medians of the distance to the start that are three of its standard deviations"""
_COHERENT = 0.7
"""share of the 9 x 9 pixels around that must go along with a parallax of the volume alone"""
_UNEVEN = 7.5
"""times the unevenness of the parallaxes around, a standard error (Cones, and Motorcycle in view)"""
_VOLUME_SIGMA, _ESTIMATED_SIGMA = 0.5, 2.0
"""px: standard errors of parallaxes of the volume alone, coherent or not, far from any break"""


class ParallaxCode(IntEnum):
    """What a parallax is; uint8 in arrays."""

    EMPTY = 0
    MEASURED = 1
    VOLUME = 2
    ESTIMATED = 3

    @property
    def sentence(self) -> str:
        """The code in words."""
        return _SENTENCES[self]


_SENTENCES = {
    ParallaxCode.EMPTY: "no parallax: the images cannot show the place",
    ParallaxCode.MEASURED: "measured by least squares near the volume",
    ParallaxCode.VOLUME: "measured by the volume alone, its neighbours go along",
    ParallaxCode.ESTIMATED: "estimated: hidden in the right image, or its neighbours contradict it",
}


class PairSurface(NamedTuple):
    """A pair's nodes, each (rows, cols): `parallax`, column left - column right, and `sigma`, its standard error (float32 px, NaN
    without a parallax); `correlation` float32 of the matched windows; `code` uint8 `ParallaxCode`; `outcome` uint8 `Outcome` of the
    least squares, which says why a node is not measured."""

    parallax: np.ndarray
    sigma: np.ndarray
    correlation: np.ndarray
    code: np.ndarray
    outcome: np.ndarray


def match_pair(
    left: np.ndarray,
    right: np.ndarray,
    low: float,
    high: float,
    matching: DenseMatching | None = None,
    volume: HeightVolume = PAIR_VOLUME,
) -> PairSurface:
    """Parallaxes between `low` and `high` px of the nodes of a left image, `matching.step` px apart from its first pixel on.

    left (H, W), right (H, W'): grey values of two images whose rows are homologous; 0 and NaN are no data. Raises ValueError when
    the images differ in rows or the range is empty.
    """
    _check_pair(left, right, low, high)
    matching = DenseMatching() if matching is None else matching
    plain = with_gaps(left), with_gaps(right)
    # The volume compares signs of differences: smoothing would only widen its edges.
    start = pair_start(*plain, low, high, volume)
    return _completed(nodes_near(*plain, start, matching), start, right.shape[1], matching)


def nodes_near(left: np.ndarray, right: np.ndarray, start: PairStart, matching: DenseMatching) -> NodeParallaxes:
    """The nodes of the pair that least squares matches near a start, `matching.step` px apart; images (H, W), (H, W') float32, NaN
    without data."""
    smooth_left, smooth_right = (smoothed(image, matching.smoothing) for image in (left, right))
    surface = StartSurface(start.parallax, 1)
    y_parallax = residual_y_parallax(smooth_left, smooth_right, surface, 0)
    if np.isfinite(y_parallax):
        smooth_right = moved_rows(smooth_right, np.float32(y_parallax))
    rows, cols = (matching.step * np.arange(-1, -(-side // matching.step) + 1) for side in left.shape)
    return consistent(match_nodes(smooth_left, smooth_right, surface, rows, cols, 0, limits_of(matching)), matching)


def _check_pair(left: np.ndarray, right: np.ndarray, low: float, high: float) -> None:
    if left.ndim != 2 or right.ndim != 2 or len(left) != len(right):
        raise ValueError(f"A rectified pair has two images of the same rows, not shapes {left.shape} and {right.shape}.")
    if not low < high:
        raise ValueError(f"Parallaxes from {low:g} to {high:g} px are no range; the first must be lower.")


def _completed(nodes: NodeParallaxes, start: PairStart, right_cols: int, matching: DenseMatching) -> PairSurface:
    """The matched nodes, and the start where there is none, with code and standard error."""
    every = slice(None, None, matching.step), slice(None, None, matching.step)
    known = np.isfinite(start.parallax)[every]
    shown = ~hidden(start.parallax, right_cols)[every]
    parallax = np.where(np.isfinite(nodes.parallax), nodes.parallax, start.parallax[every])
    moved = np.abs(nodes.parallax - start.parallax[every])
    # A start that is itself noisy decides nothing.
    usual = _USUAL * float(np.median(moved[np.isfinite(moved)])) if np.isfinite(moved).any() else 0.0
    with np.errstate(invalid="ignore"):
        strayed = moved > max(_HALF_PLANE, usual)
    strayed &= break_variance(parallax, matching.step) > 0.0
    parallax = np.where(strayed, start.parallax[every], parallax)
    broken = break_variance(parallax, matching.step)
    with np.errstate(invalid="ignore"):
        variance = nodes.sigma**2 + broken
        measured = shown & ~strayed & (variance <= matching.max_sigma**2)
    sure = known & shown & (start.coherence[every] >= _COHERENT)
    code = np.select(
        [measured, sure, known], [ParallaxCode.MEASURED, ParallaxCode.VOLUME, ParallaxCode.ESTIMATED], ParallaxCode.EMPTY
    )
    alone = np.where(sure, _VOLUME_SIGMA, _ESTIMATED_SIGMA) ** 2 + broken
    variance = variance + (_UNEVEN * unevenness(parallax)) ** 2
    sigma = np.sqrt(np.where(measured, variance, np.where(np.isfinite(parallax), alone, np.nan)))
    outcome = np.where(strayed, Outcome.MOVED_TOO_FAR, nodes.outcome).astype(np.uint8)
    return PairSurface(parallax, sigma.astype(np.float32), nodes.correlation, code.astype(np.uint8), outcome)


def break_variance(parallax: np.ndarray, step: int) -> np.ndarray:
    """Variance (rows, cols) float32, px^2, of parallaxes that may belong to the other side of a break near by; 0 far from any.

    parallax (rows, cols): of nodes `step` px apart, NaN where unknown.
    """
    low, high = np.nan_to_num(parallax, nan=np.inf), np.nan_to_num(parallax, nan=-np.inf)
    variance = np.zeros(parallax.shape, np.float32)
    for distance, share in _MISPLACED:
        reach = max(1, distance // step)
        lowest, highest = (rank(values, 2 * reach + 1) for rank, values in ((minimum_filter, low), (maximum_filter, high)))
        jump = np.where(np.isfinite(highest) & np.isfinite(lowest), highest - np.where(np.isfinite(lowest), lowest, 0.0), 0.0)
        variance = np.maximum(variance, np.where(jump > _BREAK + _SLOPE * reach * step, share * jump * jump, 0.0))
    return variance.astype(np.float32)


@njit()
def hidden(parallax, right_cols):
    """Pixels (rows, cols) bool whose place in the right image shows something nearer, or lies outside of it."""
    rows, cols = parallax.shape
    out = np.zeros((rows, cols), np.bool_)
    nearest = np.empty(right_cols, np.float32)
    for r in range(rows):
        nearest[:] = -np.inf
        for c in range(cols):
            place = c - parallax[r, c]
            # Both pixels that a place lies between: a surface that the right image stretches has no gaps then.
            for x in range(int(np.floor(place)), int(np.floor(place)) + 2) if place == place else range(0):
                if 0 <= x < right_cols:
                    nearest[x] = max(nearest[x], parallax[r, c])
        for c in range(cols):
            place = c - parallax[r, c]
            x = int(np.floor(place + 0.5)) if place == place else -1
            out[r, c] = not 0 <= x < right_cols or nearest[x] > parallax[r, c] + _IN_FRONT
    return out
