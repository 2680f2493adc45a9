"""The windows of one size of a run of nodes in a row: those that are whole from sums that they share, the others one by one."""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.matching.dense.kernel import kernel
from orthomill.tasks.matching.dense.shared_sums import (
    RUN,
    SMALLEST,
    SharedSums,
    columns_of,
    fill_sums,
    is_whole,
    off_plane,
    shared_sums_for,
)
from orthomill.tasks.matching.dense.window_solution import (
    ASIDE,
    STRENGTH,
    SUPPORT,
    SurfaceScratch,
    cut_block,
    lay_out,
    scratch_for,
    solved,
    solved_whole,
)
from orthomill.tasks.matching.least_squares import result_columns as outcomes

_SPARSE = 6
"""nodes of a run per whole window from which on sharing costs more than it saves"""
_ASIDE = 0.8
"""half windows: farther than this from the node its texture says little about it, such as the shore about water"""


class NodeRun(NamedTuple):
    """Nodes next to each other in a row, and what their windows of one size gave."""

    centre: np.ndarray
    """(RUN,) int64: flat place in the images of a `WarpedPair`"""
    plane: np.ndarray
    """(RUN, 3): parallax and slopes"""
    wanted: np.ndarray
    """(RUN,) bool: whether the window of this size is to be solved"""
    whole: np.ndarray
    """(RUN,) bool: whether all of it lies on the plane"""
    found: np.ndarray
    """(RUN,) int64: outcome"""
    solution: np.ndarray
    """(RUN, 10)"""
    best: np.ndarray
    """(RUN,): least variance so far, px^2"""
    cut: SurfaceScratch
    shared: SharedSums


@njit()
def run_for(half, step):
    """Room for runs of nodes `step` px apart with windows of half side `half` at most."""
    return NodeRun(
        np.zeros(RUN, np.int64),
        np.zeros((RUN, 3)),
        np.zeros(RUN, np.bool_),
        np.zeros(RUN, np.bool_),
        np.zeros(RUN, np.int64),
        np.zeros((RUN, 10)),
        np.zeros(RUN),
        scratch_for(half),
        shared_sums_for(half, step),
    )


@kernel()
def solve_windows(pair, run, step, half, rules):
    """Solve the windows of half side `half` of the wanted nodes of a run, `step` px apart; fills their outcomes and solutions."""
    limits = rules.limits
    # A field smoothed over normal windows holds errors that wider ones could remove: those count from the plane.
    flat = half > limits.half
    first, laid = _share(pair, run, step, half, flat, rules), False
    for j in range(RUN):
        if not run.wanted[j]:
            continue
        plane, solution = run.plane[j], run.solution[j]
        solution[:] = np.nan
        if first >= 0 and run.whole[j]:
            away = (j - first) * step
            off = off_plane(run.plane[first], plane, away) if flat else (0.0, 0.0, 0.0)
            found = solved_whole(run.shared, away, half, off, plane[1], run.cut.sums, solution)
        else:
            if not laid:
                lay_out(half, run.cut.block)
                laid = True
            size = cut_block(pair, run.centre[j], half, plane, limits.surface_tolerance, flat, run.cut.block)
            found = solved(run.cut, half, size, rules.correlation, plane[1], solution)
        if found == outcomes.CONVERGED and solution[SUPPORT] < limits.min_support * (2 * half + 1) ** 2:
            found = outcomes.NOT_TRIED
        elif found == outcomes.CONVERGED and not (solution[STRENGTH] > limits.min_gradient and solution[ASIDE] < _ASIDE * half):
            found = outcomes.LOW_TEXTURE
        run.found[j] = found


@kernel(inline="always")
def _share(pair, run, step, half, flat, rules):
    """Fill the sums of the whole windows of a run; returns the node that they begin with, -1 where sharing does not pay."""
    first, last, count, tolerance, ramp = -1, -1, 0, rules.limits.surface_tolerance, run.shared.ramp
    if half < SMALLEST:
        return -1
    for j in range(RUN):
        run.whole[j] = run.wanted[j] and is_whole(pair, run.centre[j], half, run.plane[j], tolerance, ramp)
        if run.whole[j]:
            first, last, count = j if first < 0 else first, j, count + 1
    n = columns_of(last - first, step, half)
    if count * _SPARSE * step < n:
        return -1
    fill_sums(pair, run.centre[first], half, n, run.plane[first], flat, rules.correlation, run.shared)
    return first
