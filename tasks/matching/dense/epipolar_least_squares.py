"""Least-squares matching along epipolar rows: the parallaxes of a grid of nodes near a start surface, with their precision.

Strategy
- Rows are homologous, so a node has a plane: its parallax and the slopes along and across the row (node_surfaces.py). The right
  image is seen along the planes of all nodes at once (surface_warp.py), and every node is corrected from the pixels of its window
  that lie on its plane (window_solution.py).
- One round on a lattice of coarser nodes, after which the planes are fitted anew to the corrected nodes, weighted by their
  precision. Windows then see the surface as it bends, and only what is left of it is taken as level.
- Last, every node is solved with its normal window. Where that shows a misfit, windows from small to large follow, one taking over
  while it agrees with all smaller ones and is more precise: they are large where the surface is smooth, small where it bends. The
  smallest serves where the surface breaks within the next, those above the normal one only where texture is weak.
- A node that ends far from its start is refused: the start knows which of several similar places is meant.
- Neighbours on one plane are joined (joined_nodes.py).

Source: Skarlatos (sources/matching.md#least-squares); Karfis 2009 (sources/epipolar.md#levels); Goldenshluger & Nemirovski 1997
(intersection of confidence intervals).
"""

from typing import NamedTuple

import numpy as np

from orthomill.tasks.matching.dense.joined_nodes import joined
from orthomill.tasks.matching.dense.kernel import kernel
from orthomill.tasks.matching.dense.node_runs import run_for, solve_windows
from orthomill.tasks.matching.dense.node_surfaces import (
    NodeLattice,
    StartSurface,
    finer_planes,
    smoothed_planes,
    start_planes,
    start_values,
)
from orthomill.tasks.matching.dense.shared_sums import RUN
from orthomill.tasks.matching.dense.surface_warp import WarpedPair, warp
from orthomill.tasks.matching.dense.window_solution import (
    CORRECTION,
    CORRELATION,
    KERNEL,
    SLOPE_X,
    SLOPE_Y,
    SPREAD,
    SUPPORT,
    VARIANCE,
)
from orthomill.tasks.matching.least_squares import result_columns as outcomes
from orthomill.tasks.matching.least_squares.shift_precision import residual_correlation

_EDGE, _SMALL, _NORMAL, _WIDER, _WIDE, _NONE = range(6)
"""windows of a node from small to large, and the end of them"""
_REACH = 16
"""px around the wanted nodes that are matched to smooth, and to fill windows; beyond it the start itself serves"""
_COARSE = 4
"""px: distance of the nodes of the first round"""
_MAX_STEP, _MAX_SLOPE_STEP = 1.5, 0.1
"""limits of the change in one round: of the parallax (px) and of its slopes"""
_VAGUE = 0.25
"""px^2: variance above which a correction is not used"""
_ALONE = 1e-2
"""weight of a node that only passes on its start; solved ones weigh the inverse of their variance, px^-2"""
_FLOOR = 4e-4
"""px^2 added to the variances in these weights, so that a few nodes of strong texture do not outvote all others"""
_WHOLE = 0.85
"""share of the window on the node's surface below which the smallest window is tried"""
_HOPELESS = 0.4
"""share of the wanted correlation below which a window shows two different things"""
_MISFIT = 2.0
"""ratio of the variances by scores and by noise up to which a window shows no sign of misfit"""
# These were set on Middlebury Cones and the synthetic pair; other real pairs were in view (benchmarks/results/matching.md).
_NOISE_ALONE, _MISFITS = 0.8, 50
"""median misfit of windows with mere noise, and the number of nodes that a median takes; twice as much is photographic"""
_MODEL = 1.25
"""added to the factor of the variance of grey values in photographs: what they leave unexplained is not noise alone"""
_SAMPLING = 0.06**2
"""px^2: in photographs aliasing, interpolation and what is left of distortion are common to neighbouring windows"""
_START_NOISE = 0.07**2
"""px^2: variance of the plane of a start, at least"""
_DISAGREED = 0.45**2
"""px^2: the most that a disagreement with the start adds; farther away it is more often the start that is wrong"""
_AGREE = 2.0
"""standard errors on both sides of a solution in which those of larger windows must lie"""


class EpipolarLimits(NamedTuple):
    """What the kernels need of the settings: see `DenseMatching` in blocks.py for meaning and units."""

    edge_half: int
    small_half: int
    half: int
    wide_half: int
    weak_sigma: float
    max_shift: float
    surface_tolerance: float
    min_support: float
    min_correlation: float
    min_gradient: float
    smoothing: float


class NodeParallaxes(NamedTuple):
    """Results at a grid of nodes, each (rows, cols)."""

    parallax: np.ndarray
    """float32, px, NaN where not matched"""
    sigma: np.ndarray
    """float32: standard error, px, NaN where not matched"""
    correlation: np.ndarray
    """float32, NaN where no window was solved"""
    outcome: np.ndarray
    """uint8 `Outcome`"""

    @classmethod
    def unmatched(cls, outcome: np.ndarray) -> "NodeParallaxes":
        """Nodes without any parallax, with their outcomes (rows, cols)."""
        parallax, sigma, correlation = (np.full(outcome.shape, np.nan, np.float32) for _ in range(3))
        return cls(parallax, sigma, correlation, outcome)


class NodeRules(NamedTuple):
    """Limits and what follows from them."""

    limits: EpipolarLimits
    correlation: tuple[float, float]
    """of residuals 1 and 2 px apart"""
    widest: int
    """half side of the widest of all windows, px"""


@kernel(inline="always")
def _half_of(window, limits):
    """Half side of a window, px."""
    if window == _EDGE:
        return limits.edge_half
    if window == _SMALL:
        return limits.small_half
    if window == _NORMAL:
        return limits.half
    return limits.wide_half if window == _WIDE else (limits.half + limits.wide_half) // 2


@kernel(forceinline=True)
def _shown(pair, centre, half):
    """Whether both images show the node or the middle of a side of its window."""
    field = pair.field
    return (
        field[centre] == field[centre]
        or field[centre - half] == field[centre - half]
        or field[centre + half] == field[centre + half]
    )


@kernel()
def _adjust_planes(pair, lattice, planes, shape, rules, halves, run, weights):
    """Correct the planes of all nodes once, in place; fills their weights. shape: of the left image. halves: half sides of the
    windows, one after the other. run: scratch."""
    limits, best = rules.limits, run.best
    for i in range(lattice.rows):
        row = lattice.row + i * lattice.step
        for first in range(0, lattice.cols, RUN):
            nodes = range(min(RUN, lattice.cols - first))
            run.wanted[:] = False
            for j in nodes:
                weights[i, first + j], best[j] = _ALONE, _VAGUE
                col = lattice.col + (first + j) * lattice.step
                if 0 <= row < shape[0] and 0 <= col < shape[1] and not np.isnan(planes[i, first + j, 0]):
                    run.centre[j] = (row + pair.margin) * pair.cols + col + pair.margin
                    for k in range(3):
                        run.plane[j, k] = planes[i, first + j, k]
                    run.wanted[j] = _shown(pair, run.centre[j], limits.half)
            for half in halves:
                solve_windows(pair, run, lattice.step, half, rules)
                for j in nodes:
                    if run.wanted[j]:
                        field = pair.field[run.centre[j]]
                        begin = field if half == limits.half and field == field else run.plane[j, 0]
                        best[j] = _correct(run, j, begin, best[j], planes[i, first + j])
                        if best[j] < _VAGUE:
                            weights[i, first + j] = 1.0 / (best[j] + _FLOOR)
                        run.wanted[j] = not best[j] < limits.weak_sigma**2


@kernel(forceinline=True)
def _correct(run, j, begin, best, plane):
    """Correct the plane of a node where its window is more precise than `best`, px^2; returns the variance that holds then.

    begin: what the correction counts from.
    """
    solution = run.solution[j]
    if not (run.found[j] == outcomes.CONVERGED and solution[VARIANCE] < best and abs(solution[CORRECTION]) < 2.0 * _MAX_STEP):
        return best
    plane[0] = begin + min(max(solution[CORRECTION], -_MAX_STEP), _MAX_STEP)
    plane[1] = run.plane[j, 1] + min(max(solution[SLOPE_X], -_MAX_SLOPE_STEP), _MAX_SLOPE_STEP)
    plane[2] = run.plane[j, 2] + min(max(solution[SLOPE_Y], -_MAX_SLOPE_STEP), _MAX_SLOPE_STEP)
    return solution[VARIANCE]


@kernel(forceinline=True)
def _take(solution, begin, kept):
    """Let a solution take over where it agrees with those of smaller windows; False where it does not.

    kept (7,): parallax, variance, correlation, the interval that all windows so far agree on, misfit of the normal window, variance
    of the interpolation. begin: what the correction counts from.
    """
    variance = max(solution[VARIANCE], solution[SPREAD])
    parallax, reach = begin + solution[CORRECTION], _AGREE * np.sqrt(variance)
    if parallax - reach > kept[4] or parallax + reach < kept[3]:
        return False
    kept[3], kept[4] = max(kept[3], parallax - reach), min(kept[4], parallax + reach)
    if variance < kept[1]:
        kept[0], kept[1], kept[2], kept[6] = parallax, variance, solution[CORRELATION], solution[KERNEL]
    return True


@kernel(forceinline=True)
def _solid(outcome, solution):
    """Whether a window was solved near its start."""
    return outcome == outcomes.CONVERGED and abs(solution[CORRECTION]) <= _MAX_STEP


class NodeLadder(NamedTuple):
    """What the windows so far say of the nodes of a run."""

    kept: np.ndarray
    """(RUN, 7), see `_take`"""
    normal: np.ndarray
    """(RUN, 10): solutions of the normal windows"""
    first: np.ndarray
    """(RUN,) int64: their outcomes"""
    smallest: np.ndarray
    """(RUN,) int64: the window that is tried first; above the widest where none is wanted any more"""
    outcome: np.ndarray
    """(RUN,) int64"""
    tried: np.ndarray
    """(RUN,) bool"""
    places: np.ndarray
    """0, 1, 2, ... in the sequence of windows; in memory, for the compiler would repeat the whole kernel for those it knows"""


def _ladder() -> NodeLadder:
    first, smallest, outcome = np.zeros((3, RUN), np.int64)
    return NodeLadder(
        kept=np.empty((RUN, 7)),
        normal=np.empty((RUN, 10)),
        first=first,
        smallest=smallest,
        outcome=outcome,
        tried=np.zeros(RUN, np.bool_),
        places=np.arange(_NONE + 1),
    )


@kernel(forceinline=True)
def _begin(run, j, limits, ladder):
    """Begin with the normal window of a node, which tells the smallest that is tried."""
    kept, found, solution = ladder.kept[j], run.found[j], run.solution[j]
    kept[0], kept[1], kept[2], kept[3], kept[4], kept[5] = np.nan, np.inf, np.nan, -np.inf, np.inf, np.nan
    ladder.outcome[j], ladder.first[j] = outcomes.NOT_TRIED, found
    for k in range(solution.size):
        ladder.normal[j, k] = solution[k]
    whole = solution[SUPPORT] > _WHOLE * (2 * limits.half + 1) ** 2
    if whole and _solid(found, solution):
        kept[5] = solution[SPREAD] / solution[VARIANCE]
    # Scores that scatter as noise does are no sign of a surface that bends or breaks: smaller windows would add nothing.
    ladder.smallest[j] = _NORMAL if kept[5] < _MISFIT else _SMALL if whole or limits.edge_half == limits.small_half else _EDGE


@kernel(forceinline=True)
def _climb(found, solution, begin, j, ladder):
    """Consider one more window of a node; begin: what its correction counts from."""
    if _solid(found, solution):
        if _take(solution, begin, ladder.kept[j]):
            ladder.outcome[j] = found
        else:
            ladder.smallest[j] = _NONE
    elif ladder.outcome[j] != outcomes.CONVERGED:
        ladder.outcome[j] = outcomes.MOVED_TOO_FAR if found == outcomes.CONVERGED else found


@kernel(inline="always")
def _solve_run(pair, run, step, rules, ladder):
    """The best of the windows of the wanted nodes of a run, in `ladder.kept`, and their outcomes."""
    limits = rules.limits
    # The normal window is solved first, and takes its place among the others when the smaller ones have had theirs.
    for place in ladder.places:
        window = _NORMAL if place == 0 else place - 1
        for j in range(RUN):
            if not ladder.tried[j] or place == 0:
                continue
            if window == _NORMAL and ladder.smallest[j] <= _NORMAL:
                _climb(ladder.first[j], ladder.normal[j], _near(pair, run, j, limits), j, ladder)
            # Texture that is weak becomes precise in a larger window; grey values that are not alike remain so.
            if window > _NORMAL and (
                ladder.kept[j, 1] < limits.weak_sigma**2 or ladder.normal[j, CORRELATION] < _HOPELESS * limits.min_correlation
            ):
                ladder.smallest[j] = _NONE
            run.wanted[j] = window != _NORMAL and ladder.smallest[j] <= window
        if window == _NORMAL and place > 0:
            continue
        solve_windows(pair, run, step, _half_of(window, limits), rules)
        for j in range(RUN):
            if run.wanted[j] and place == 0:
                _begin(run, j, limits, ladder)
            elif run.wanted[j]:
                begin = _near(pair, run, j, limits) if window < _NORMAL else run.plane[j, 0]
                _climb(run.found[j], run.solution[j], begin, j, ladder)


@kernel(forceinline=True)
def _near(pair, run, j, limits):
    """The parallax of the field at a node where it lies on the node's plane, else that of the plane."""
    field, plane = pair.field[run.centre[j]], run.plane[j, 0]
    return field if abs(field - plane) <= limits.surface_tolerance else plane


@kernel()
def _solve_nodes(pair, lattice, planes, start, shape, rules, scratch, nodes, variance, misfit):
    """Solve the inner nodes of a lattice, of which `nodes` are the results. start (rows, cols): parallaxes of the start planes.
    scratch: a run and a ladder."""
    limits = rules.limits
    parallax, _, likeness, outcome = nodes
    run, ladder = scratch
    ring = (lattice.rows - parallax.shape[0]) // 2
    for i in range(parallax.shape[0]):
        for first in range(0, parallax.shape[1], RUN):
            count = min(RUN, parallax.shape[1] - first)
            run.wanted[:] = False
            for j in range(count):
                row, col = lattice.row + (ring + i) * lattice.step, lattice.col + (ring + first + j) * lattice.step
                centre = (row + pair.margin) * pair.cols + col + pair.margin
                run.centre[j] = centre
                for k in range(3):
                    run.plane[j, k] = planes[ring + i, ring + first + j, k]
                if not (0 <= row < shape[0] and 0 <= col < shape[1]) or np.isnan(pair.left[centre]):
                    outcome[i, first + j] = outcomes.OUTSIDE
                elif np.isnan(run.plane[j, 0]):
                    outcome[i, first + j] = outcomes.NOT_TRIED
                elif not _shown(pair, centre, limits.half):
                    outcome[i, first + j] = outcomes.OUTSIDE
                else:
                    run.wanted[j] = True
            for j in range(RUN):
                ladder.tried[j] = run.wanted[j]
            _solve_run(pair, run, lattice.step, rules, ladder)
            for j in range(count):
                if not ladder.tried[j]:
                    continue
                found, kept, k = ladder.outcome[j], ladder.kept[j], first + j
                if found == outcomes.NOT_TRIED and np.isnan(pair.field[run.centre[j]]):
                    found = outcomes.OUTSIDE
                likeness[i, k], misfit[i, k] = kept[2], kept[5]
                if found == outcomes.CONVERGED and not kept[2] >= limits.min_correlation:
                    found = outcomes.LOW_CORRELATION
                elif found == outcomes.CONVERGED and not abs(kept[0] - start[ring + i, ring + k]) <= limits.max_shift:
                    found = outcomes.MOVED_TOO_FAR
                outcome[i, k] = found
                if found == outcomes.CONVERGED:
                    parallax[i, k], variance[i, k] = kept[0], kept[1] + kept[6]


def match_nodes(
    left: np.ndarray, right: np.ndarray, start: StartSurface, rows: np.ndarray, cols: np.ndarray, shift: int, limits: EpipolarLimits
) -> NodeParallaxes:
    """Match the nodes (rows x cols) of a left image along the rows of a right image.

    left (H, W), right (H, W'): float32, smoothed, NaN without data. rows, cols: pixel rows (n,) and columns (m,) of the nodes, both
    equally spaced by the same step. shift: the right column of left column c at parallax q is c + shift - q.
    """
    near, far = residual_correlation(limits.smoothing)
    widest = max(limits.edge_half, limits.small_half, limits.half, limits.wide_half)
    rules = NodeRules(limits, (float(near), float(far)), widest)
    lattice = NodeLattice.around(rows, cols, _REACH)
    pair, half, tolerance = WarpedPair.of(left, widest + 1), limits.half, limits.surface_tolerance
    level = lattice.thinned(max(1, _COARSE // lattice.step))
    begin = start_planes(start, level, half, tolerance)
    planes, weights = begin.copy(), np.empty(level.shape, np.float32)
    # A start that is good to a pixel needs one round: a second one gains 1 % on noisy images and loses as much on real ones.
    warp(pair, right, shift, level, planes)
    _adjust_planes(pair, level, planes, left.shape, rules, np.array([half, limits.wide_half]), run_for(widest, level.step), weights)
    planes = smoothed_planes(planes, weights, level, half, tolerance)
    planes, begin = finer_planes(planes, level, lattice), finer_planes(begin, level, lattice)
    # Nodes on another surface than the nearest coarser one begin with their own plane.
    values = start_values(start, lattice)
    other = np.isfinite(values) & ~(np.abs(planes[..., 0] - values) <= tolerance)
    own = start_planes(start, lattice, half, tolerance, other)
    other &= ~(np.abs(planes[..., 0] - own[..., 0]) <= tolerance)
    planes, begin = (np.where(other[..., None], own, carried) for carried in (planes, begin))
    warp(pair, right, shift, lattice, planes)
    nodes = NodeParallaxes.unmatched(np.zeros((len(rows), len(cols)), np.uint8))
    variance, misfit = np.full((2, *nodes.outcome.shape), np.nan)
    _solve_nodes(
        pair,
        lattice,
        planes,
        begin[..., 0].copy(),
        left.shape,
        rules,
        (run_for(widest, lattice.step), _ladder()),
        nodes,
        variance,
        misfit,
    )
    ring = (lattice.rows - len(rows)) // 2
    moved = nodes.parallax - begin[ring : ring + len(rows), ring : ring + len(cols), 0]
    nodes = nodes._replace(sigma=np.sqrt(stated_variance(variance, moved, misfit)).astype(np.float32))
    slopes = planes[ring : ring + len(rows), ring : ring + len(cols), 1:] * np.float32(lattice.step)
    return nodes._replace(parallax=joined(nodes.parallax, nodes.sigma, slopes))


def stated_variance(variance: np.ndarray, moved: np.ndarray, misfit: np.ndarray) -> np.ndarray:
    """Variances (rows, cols) of parallaxes among their neighbours, px^2.

    variance: what the grey values of the windows say. moved: how far the nodes ended from the planes of their start, px; the start
    is a second opinion, from another measure of likeness, and differs by no more than its own noise where both are right. misfit:
    ratio of the variances by scores and by noise in whole normal windows, NaN elsewhere; where its median is above that of mere
    noise, the images have errors that no window shows in full: aliasing, distortion, other radiometry.
    """
    known = misfit[np.isfinite(misfit)]
    share = np.clip((np.median(known) - _NOISE_ALONE) / _NOISE_ALONE, 0.0, 1.0) if known.size >= _MISFITS else 1.0
    near = np.abs(moved[np.isfinite(moved)])
    # Half of all nodes are nearer than 0.67 standard deviations to a start that is only noisy.
    noise = (1.4826 * np.median(near)) ** 2 if near.size >= _MISFITS else 0.0
    apart = np.clip(moved * moved - max(noise, _START_NOISE), 0.0, _DISAGREED)
    return variance * (1.0 + share * _MODEL) + share * _SAMPLING + apart
