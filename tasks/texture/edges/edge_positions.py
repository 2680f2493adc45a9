"""Where an edge lies: one line of the upper surface that explains the changes of all photographs, with its standard errors.

Unknown are the displacement across the edge, its turn, and the error of the height: a height that is too low displaces the edge in
every photograph away from the projection centre, so that photographs from two sides tell it from a displacement. The line is looked
for where photographs change most together, and then adjusted to the places of the greatest change in each.

A photograph's orientation displaces all of its parts alike: photographs, not parts, are the observations from whose residuals the
standard error follows.
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.texture.edges.edge_profiles import PARTS, SEARCH, SHIFT, STEPS

LEAST_CHANGE = 4.0
"""grey levels per px: a smaller change across is no edge"""
PRIOR_HEIGHT = 1.0
"""cells: standard error of the height before photographs are asked"""
PRIOR_BOARD = 0.5
"""cells: how deep the board or gutter may be that photographs from outside see below the edge, before they are asked"""
PRIOR_SIGMA, PRIOR_FREEDOM = 0.3, 2.0
"""px: standard error of the place of a change in a photograph before residuals are known; degrees of freedom that it counts for"""
_TURNS = np.array([-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3])  # tangents that are tried
_NEAR = 1.0  # px around the predicted place in which a photograph's change belongs to the edge
_SHARE = 0.4  # of a photograph's greatest change, that a change must have to be that of the edge
_LEVELS = 3  # heights that are tried upwards and downwards
_ROUNDS = 3
_DISTANT = 0.03  # of a photograph's score, that an edge a cell away must be better


class EdgeFit(NamedTuple):
    """Edges (N,): `across` px outwards of the place, `turn` (tangent), `height` m above the surface; their standard errors
    `sigma_across` px and `sigma_height` m; `photos` that show the edge, of `asked`; `rms` px of the residuals. NaN and 0 where
    fewer than two photographs show one."""

    across: np.ndarray
    turn: np.ndarray
    height: np.ndarray
    sigma_across: np.ndarray
    sigma_height: np.ndarray
    photos: np.ndarray
    asked: np.ndarray
    rms: np.ndarray


def edge_fits(changes: np.ndarray, lean: np.ndarray, parts: np.ndarray, cell: float, divisor: int) -> EdgeFit:
    """The edges at places from `changes` (N, P, PARTS, S) of photographs as of `edge_changes`, NaN where they show nothing.

    lean (N, P): px by which a metre of height displaces the edge outwards in each photograph; parts (PARTS,): px along the edge of
    the middle of each part; `cell`: side of a pixel, m.
    """
    count = len(changes)
    across, turn, height, sigma_across, sigma_height, rms = np.full((6, count), np.nan)
    photos, asked = np.zeros((2, count), np.int64)
    out = EdgeFit(across, turn, height, sigma_across, sigma_height, photos, asked, rms)
    if changes.size:
        limits = _SearchBounds(SEARCH * divisor, SHIFT * divisor, PRIOR_HEIGHT * divisor * cell, PRIOR_BOARD * divisor * cell)
        _fit(np.asarray(changes, np.float32), lean, parts, limits, out)
    return out


class _SearchBounds(NamedTuple):
    """How far an edge is looked for, px: across, and by a wrong height in a photograph; what is known before of the height and of
    the board below the edge, m."""

    search: float
    shift: float
    height: float
    board: float


class _Asked(NamedTuple):
    """A place in the photographs: `changes` (P, PARTS, S), `lean` (P,) and `parts` as of `edge_fits`; the greatest change of each,
    and whether it counts."""

    changes: np.ndarray
    lean: np.ndarray
    parts: np.ndarray
    strength: np.ndarray
    counts: np.ndarray


@njit()
def _value(profile, at):
    """Linear between the values of a profile; 0 beyond it."""
    place = at * STEPS + 0.5 * (profile.size - 1)
    k = int(np.floor(place))
    if k < 0 or k + 1 >= profile.size:
        return 0.0
    share = place - k
    return (1.0 - share) * profile[k] + share * profile[k + 1]


@njit()
def _peak(profile, at):
    """(place, value): the greatest value within _NEAR of `at`, px, by a parabola; NaN where none is greater than its neighbours."""
    middle = 0.5 * (profile.size - 1)
    low = max(int(np.ceil((at - _NEAR) * STEPS + middle)), 1)
    high = min(int(np.floor((at + _NEAR) * STEPS + middle)), profile.size - 2)
    best, value = -1, 0.0
    for k in range(low, high + 1):
        if profile[k] > value and profile[k] >= profile[k - 1] and profile[k] >= profile[k + 1]:
            best, value = k, profile[k]
    if best < 0:
        return np.nan, 0.0
    bend = profile[best - 1] - 2.0 * profile[best] + profile[best + 1]
    shift = 0.5 * (profile[best - 1] - profile[best + 1]) / bend if bend < 0.0 else 0.0
    return (best + shift - middle) / STEPS, value


@njit()
def _fit(changes, lean, parts, limits, out):
    """Fills `out` place by place."""
    count, photos = changes.shape[0], changes.shape[1]
    strength, counts, peaks = np.empty(photos), np.empty(photos, np.bool_), np.empty((photos, PARTS))
    for n in range(count):
        for p in range(photos):
            shows = not np.isnan(changes[n, p]).any()
            strength[p] = changes[n, p].max() if shows else 0.0
            counts[p] = shows and strength[p] >= LEAST_CHANGE
            out.asked[n] += shows
        if counts.sum() < 2:
            continue
        asked = _Asked(changes[n], lean[n], parts, strength, counts)
        line = _adjusted(asked, _start(asked, limits), limits, peaks)
        _judge(asked, line, limits, peaks, n, out)


@njit()
def _start(asked, limits):
    """(across, turn, height, board) that the changes of the photographs favour together; nothing is known of the board."""
    most, number = 1e-9, 0
    for p in range(asked.counts.size):
        if asked.counts[p]:
            number += 1
            most = max(most, abs(asked.lean[p]))
    highest = min(limits.shift / most, 2.0 * limits.height)
    best, found = -1.0, (0.0, 0.0, 0.0, 0.0)
    steps = int(np.ceil(STEPS * limits.search))
    for turn in _TURNS:
        for i in range(-steps, steps + 1):
            across = min(max(i / STEPS, -limits.search), limits.search)
            for h in range(-_LEVELS, _LEVELS + 1):
                height, score = h / _LEVELS * highest, 0.0
                for p in range(asked.counts.size):
                    if asked.counts[p]:
                        at = across + height * asked.lean[p]
                        for k in range(PARTS):
                            score += _value(asked.changes[p, k], at + turn * asked.parts[k]) / asked.strength[p]
                score /= number * PARTS
                far = (across / limits.search) ** 2 + (height / limits.height) ** 2 + (turn / _TURNS[-1]) ** 2
                if score - _DISTANT * far > best:
                    best, found = score - _DISTANT * far, (across, turn, height, 0.0)
    return found


@njit()
def _find_peaks(asked, line, peaks):
    """Fills `peaks` (photos, PARTS) px, places of the greatest change near a line; NaN where a photograph does not show it."""
    across, turn, height, board = line
    for p in range(asked.counts.size):
        peaks[p] = np.nan
        if not asked.counts[p]:
            continue
        shift, shown = height * asked.lean[p] + board * max(-asked.lean[p], 0.0), 0
        for k in range(PARTS):
            at, value = _peak(asked.changes[p, k], across + turn * asked.parts[k] + shift)
            if value >= max(_SHARE * asked.strength[p], LEAST_CHANGE):
                peaks[p, k] = at
                shown += 1
        if shown < 2:
            peaks[p] = np.nan


@njit()
def _adjusted(asked, line, limits, peaks):
    """(across, turn, height, board) by least squares from `line` on; fills `peaks` (photos, PARTS) px."""
    row = np.empty(4)
    for _ in range(_ROUNDS):
        _find_peaks(asked, line, peaks)
        normal, right = np.zeros((4, 4)), np.zeros(4)
        # Height and board keep their first value, zero, as far as photographs do not tell.
        normal[0, 0], normal[1, 1] = 1e-9, 1e-9
        normal[2, 2], normal[3, 3] = PARTS * (PRIOR_SIGMA / limits.height) ** 2, PARTS * (PRIOR_SIGMA / limits.board) ** 2
        for p in range(asked.counts.size):
            for k in range(PARTS):
                if not np.isnan(peaks[p, k]):
                    row[0], row[1], row[2], row[3] = 1.0, asked.parts[k], asked.lean[p], max(-asked.lean[p], 0.0)
                    for i in range(4):
                        right[i] += row[i] * peaks[p, k]
                        for j in range(4):
                            normal[i, j] += row[i] * row[j]
        across, turn, height, board = np.linalg.solve(normal, right)
        line = (across, turn, height, board)
    return line


@njit()
def _judge(asked, line, limits, peaks, n, out):
    """Fills row n of `out` with the adjusted line and its precision."""
    across, turn, height, board = line
    seen, of_photos, of_parts, number = 0, 0.0, 0.0, 0
    row, normal = np.empty(3), np.zeros((3, 3))
    normal[1, 1], normal[2, 2] = (PRIOR_SIGMA / limits.height) ** 2, (PRIOR_SIGMA / limits.board) ** 2
    for p in range(asked.counts.size):
        total, shown, lean, below = 0.0, 0, asked.lean[p], max(-asked.lean[p], 0.0)
        for k in range(PARTS):
            if not np.isnan(peaks[p, k]):
                left = peaks[p, k] - across - turn * asked.parts[k] - height * lean - board * below
                total, shown, of_parts = total + left, shown + 1, of_parts + left * left
        if shown:
            seen, number, of_photos = seen + 1, number + shown, of_photos + (total / shown) ** 2
            row[0], row[1], row[2] = 1.0, lean, below
            for i in range(3):
                for j in range(3):
                    normal[i, j] += row[i] * row[j]
    if seen < 2:
        return
    variance = (PRIOR_FREEDOM * PRIOR_SIGMA**2 + of_photos) / (PRIOR_FREEDOM + max(seen - 2, 0))
    cofactor = np.linalg.inv(normal)
    out.across[n], out.turn[n], out.height[n] = across, turn, height
    out.sigma_across[n], out.sigma_height[n] = np.sqrt(variance * cofactor[0, 0]), np.sqrt(variance * cofactor[1, 1])
    out.photos[n], out.rms[n] = seen, np.sqrt(of_parts / number)
