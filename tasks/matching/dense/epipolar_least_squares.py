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

Source: methods/matching_windows.md 2.1; relative_orientation_and_epipolar.md 1.18; Goldenshluger & Nemirovski 1997 (intersection of
confidence intervals).
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from orthomill.tasks.matching.dense.joined_nodes import joined
from orthomill.tasks.matching.dense.node_surfaces import (
    NodeLattice,
    StartSurface,
    finer_planes,
    smoothed_planes,
    start_planes,
    start_values,
)
from orthomill.tasks.matching.dense.surface_warp import WarpedPair, warp
from orthomill.tasks.matching.dense.window_solution import (
    ASIDE,
    CORRECTION,
    CORRELATION,
    KERNEL,
    SLOPE_X,
    SLOPE_Y,
    SPREAD,
    STRENGTH,
    SUPPORT,
    VARIANCE,
    cut_block,
    scratch_for,
    solved,
)
from orthomill.tasks.matching.least_squares import result_columns as outcomes
from orthomill.tasks.matching.least_squares.shift_precision import residual_correlation

_EDGE, _SMALL, _NORMAL, _WIDER, _WIDE = range(5)
"""windows of a node from small to large"""
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
_ASIDE = 0.8
"""half windows: farther than this from the node its texture says little about it, such as the shore about water"""
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


@njit(cache=True, error_model="numpy", inline="always")
def _half_of(window, limits):
    """Half side of a window, px."""
    if window == _EDGE:
        return limits.edge_half
    if window == _SMALL:
        return limits.small_half
    if window == _NORMAL:
        return limits.half
    return limits.wide_half if window == _WIDE else (limits.half + limits.wide_half) // 2


@njit(cache=True, error_model="numpy", forceinline=True)
def _attempt(pair, centre, half, plane, rules, scratch, solution):
    """Solve one window of a node; returns its outcome."""
    limits = rules.limits
    # A field smoothed over normal windows holds errors that wider ones could remove: those count from the plane.
    size = cut_block(pair, centre, half, plane, limits.surface_tolerance, half > limits.half, scratch.block)
    solution[:] = np.nan
    found = solved(scratch, half, size, rules.correlation, plane[1], solution)
    if found == outcomes.CONVERGED and solution[SUPPORT] < limits.min_support * (2 * half + 1) ** 2:
        return outcomes.NOT_TRIED
    if found == outcomes.CONVERGED and not (solution[STRENGTH] > limits.min_gradient and solution[ASIDE] < _ASIDE * half):
        return outcomes.LOW_TEXTURE
    return found


@njit(cache=True, error_model="numpy", forceinline=True)
def _shown(pair, centre, half):
    """Whether both images show the node or the middle of a side of its window."""
    field = pair.field
    return (
        field[centre] == field[centre]
        or field[centre - half] == field[centre - half]
        or field[centre + half] == field[centre + half]
    )


@njit(cache=True, error_model="numpy")
def _adjust_planes(pair, lattice, planes, shape, rules, weights):
    """Correct the planes of all nodes once, in place; fills their weights. shape: of the left image."""
    limits = rules.limits
    scratch, solution, plane = scratch_for(rules.widest), np.empty(10), np.empty(3)
    for i in range(lattice.rows):
        for j in range(lattice.cols):
            weights[i, j] = _ALONE
            row, col = lattice.row + i * lattice.step, lattice.col + j * lattice.step
            if not (0 <= row < shape[0] and 0 <= col < shape[1]) or np.isnan(planes[i, j, 0]):
                continue
            plane[0], plane[1], plane[2] = planes[i, j, 0], planes[i, j, 1], planes[i, j, 2]
            centre, best = (row + pair.margin) * pair.cols + col + pair.margin, _VAGUE
            if not _shown(pair, centre, limits.half):
                continue
            for k in range(2):
                half = limits.half if k == 0 else limits.wide_half
                found = _attempt(pair, centre, half, plane, rules, scratch, solution)
                if found == outcomes.CONVERGED and solution[VARIANCE] < best and abs(solution[CORRECTION]) < 2.0 * _MAX_STEP:
                    best = solution[VARIANCE]
                    field = pair.field[centre]
                    begin = field if k == 0 and field == field else plane[0]
                    planes[i, j, 0] = begin + min(max(solution[CORRECTION], -_MAX_STEP), _MAX_STEP)
                    planes[i, j, 1] = plane[1] + min(max(solution[SLOPE_X], -_MAX_SLOPE_STEP), _MAX_SLOPE_STEP)
                    planes[i, j, 2] = plane[2] + min(max(solution[SLOPE_Y], -_MAX_SLOPE_STEP), _MAX_SLOPE_STEP)
                    weights[i, j] = 1.0 / (best + _FLOOR)
                if best < limits.weak_sigma**2:
                    break


@njit(cache=True, error_model="numpy", forceinline=True)
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


@njit(cache=True, error_model="numpy", forceinline=True)
def _solid(outcome, solution):
    """Whether a window was solved near its start."""
    return outcome == outcomes.CONVERGED and abs(solution[CORRECTION]) <= _MAX_STEP


@njit(cache=True, error_model="numpy", forceinline=True)
def _solve_node(pair, centre, plane, rules, scratch, solutions, kept):
    """The best of the windows of a node, in `kept` (see `_take`); returns its outcome. solutions (2, 10): scratch."""
    limits = rules.limits
    kept[0], kept[1], kept[2], kept[3], kept[4], kept[5] = np.nan, np.inf, np.nan, -np.inf, np.inf, np.nan
    outcome, field = outcomes.NOT_TRIED, pair.field[centre]
    near = field if abs(field - plane[0]) <= limits.surface_tolerance else plane[0]
    normal, other = solutions[0], solutions[1]
    first = _attempt(pair, centre, limits.half, plane, rules, scratch, normal)
    solid, whole = _solid(first, normal), normal[SUPPORT] > _WHOLE * (2 * limits.half + 1) ** 2
    if solid and whole:
        kept[5] = normal[SPREAD] / normal[VARIANCE]
    # Scores that scatter as noise does are no sign of a surface that bends or breaks: smaller windows would add nothing.
    window = _NORMAL if kept[5] < _MISFIT else _SMALL if whole or limits.edge_half == limits.small_half else _EDGE
    while window <= _WIDE:
        # Texture that is weak becomes precise in a larger window; grey values that are not alike remain so.
        if window > _NORMAL and (kept[1] < limits.weak_sigma**2 or normal[CORRELATION] < _HOPELESS * limits.min_correlation):
            break
        found, solution = first, normal
        if window != _NORMAL:
            found, solution = _attempt(pair, centre, _half_of(window, limits), plane, rules, scratch, other), other
        if _solid(found, solution):
            if not _take(solution, near if window <= _NORMAL else plane[0], kept):
                break
            outcome = found
        elif outcome != outcomes.CONVERGED:
            outcome = outcomes.MOVED_TOO_FAR if found == outcomes.CONVERGED else found
        window += 1
    return outcome


@njit(cache=True, error_model="numpy")
def _solve_nodes(pair, lattice, planes, start, shape, rules, nodes, variance, misfit):
    """Solve the inner nodes of a lattice, of which `nodes` are the results. start (rows, cols): parallaxes of the start planes."""
    limits = rules.limits
    parallax, _, likeness, outcome = nodes
    scratch, solutions, plane, kept = scratch_for(rules.widest), np.empty((2, 10)), np.empty(3), np.empty(7)
    ring = (lattice.rows - parallax.shape[0]) // 2
    for i in range(parallax.shape[0]):
        for j in range(parallax.shape[1]):
            row, col = lattice.row + (ring + i) * lattice.step, lattice.col + (ring + j) * lattice.step
            centre = (row + pair.margin) * pair.cols + col + pair.margin
            if not (0 <= row < shape[0] and 0 <= col < shape[1]) or np.isnan(pair.left[centre]):
                outcome[i, j] = outcomes.OUTSIDE
                continue
            plane[0], plane[1], plane[2] = (
                planes[ring + i, ring + j, 0],
                planes[ring + i, ring + j, 1],
                planes[ring + i, ring + j, 2],
            )
            if np.isnan(plane[0]):
                outcome[i, j] = outcomes.NOT_TRIED
                continue
            if not _shown(pair, centre, limits.half):
                outcome[i, j] = outcomes.OUTSIDE
                continue
            found = _solve_node(pair, centre, plane, rules, scratch, solutions, kept)
            if found == outcomes.NOT_TRIED and np.isnan(pair.field[centre]):
                found = outcomes.OUTSIDE
            likeness[i, j], misfit[i, j] = kept[2], kept[5]
            if found == outcomes.CONVERGED and not kept[2] >= limits.min_correlation:
                found = outcomes.LOW_CORRELATION
            elif found == outcomes.CONVERGED and not abs(kept[0] - start[ring + i, ring + j]) <= limits.max_shift:
                found = outcomes.MOVED_TOO_FAR
            outcome[i, j] = found
            if found == outcomes.CONVERGED:
                parallax[i, j], variance[i, j] = kept[0], kept[1] + kept[6]


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
    _adjust_planes(pair, level, planes, left.shape, rules, weights)
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
    _solve_nodes(pair, lattice, planes, begin[..., 0].copy(), left.shape, rules, nodes, variance, misfit)
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
