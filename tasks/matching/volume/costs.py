"""The cost of every candidate of every cell: how much the photographs that show it there differ from one another.

Strategy: of every cell the first photographs of the list that show it (they come best first, those that the coarser surface hides
left out) are compared in pairs; a candidate costs the mean distance of the best share of the pairs, so that a photograph in which
something else stands in front does not decide. All candidates of a cell are sorted at once, by comparing and exchanging whole rows.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.matching.volume.candidates import CellRanges
from orthomill.tasks.matching.volume.lowest_sums import exchanges, lowest_sums
from orthomill.tasks.matching.volume.rectified_photograph import RectifiedPhotograph
from orthomill.tasks.matching.volume.signatures import BITS, bits_set, no_signature

COST_UNIT = 4
"""costs per bit of distance: means of several pairs are finer than a bit"""
_BATCH = 512
"""candidates that are compared together, at least: few enough that their distances stay in the nearest cache"""


ALIKE = 1.25
"""bases that are narrower by no more than this factor count as equal: those of one block differ by as much everywhere"""
MOST_STRETCHED = 8.0
"""times by which a base may be narrower than the widest ones before its heights count as known: beyond, they are not"""


@dataclass(frozen=True)
class Comparison:
    """How the photographs of a cell are compared."""

    most: int
    """photographs per cell"""
    share: float
    """best share of the pairs"""
    blank: float
    """distance of a pair of which one does not show the candidate, share of the bits"""


@dataclass(frozen=True, eq=False)
class Choice:
    """Which photographs are compared where: `preferred` (places, places, n) numbers of photographs, the best first, -1 for
    none, one place for every `spacing` x `spacing` cells; `hidden` (photographs, rows, cols) bool, those that something else
    stands before."""

    spacing: int
    preferred: np.ndarray
    hidden: np.ndarray


@dataclass(frozen=True, eq=False)
class PhotographStack:
    """All photographs of a volume in one piece, as kernels take them; `none` is the code of a place without a signature, `pixels`
    the sides of their own pixels, in cells."""

    flat: np.ndarray
    starts: np.ndarray
    sizes: np.ndarray
    planes: np.ndarray
    pixels: np.ndarray
    none: np.unsignedinteger

    @classmethod
    def of(cls, photographs: Iterable[RectifiedPhotograph], pixels: int, half: int) -> "PhotographStack":
        """The stack of one photograph or more that have `pixels` signatures together; each is let go when the next one is
        asked for."""
        flat, starts, sizes, planes, sides = np.empty(pixels, type(no_signature(half))), [0], [], [], []
        for photo in photographs:
            flat[starts[-1] : starts[-1] + photo.signatures.size] = photo.signatures.ravel()
            starts.append(starts[-1] + photo.signatures.size)
            sizes.append(photo.signatures.shape)
            sides.append(photo.pixel)
            # Far outside instead of NaN: a comparison then says that the photograph does not show the plane.
            planes.append(np.nan_to_num(photo.planes, nan=-1e9))
        plane_numbers, own = np.stack(planes).astype(np.float32), np.array(sides, np.float32)
        return cls(flat, np.array(starts[:-1]), np.array(sizes), plane_numbers, own, no_signature(half))


def volume_costs(stack: PhotographStack, choice: Choice, candidates: CellRanges, half: int, rules: Comparison) -> np.ndarray:
    """Packed costs uint8 of all candidates, in 1/COST_UNIT bits.

    Hidden photographs are used only where fewer than two are left without them.
    """
    cost = np.empty(candidates.offset[-1], np.uint8)
    blank = np.uint8(round(rules.blank * BITS[half] * COST_UNIT))
    images = stack.flat, stack.starts, stack.sizes, stack.planes
    where = choice.spacing, choice.preferred.astype(np.int16), choice.hidden
    cells = candidates.low, candidates.offset, stack.none, rules.most
    _costs(*images, *where, *cells, _selections(rules), blank, cost)
    return cost


class Selections(NamedTuple):
    """How the best pairs are found: `take` (pairs + 1,) int64, how many of so many pairs; `exchanges` (n, 2), for one photograph
    after the other, of which those of p photographs begin at `begins[p]`, see `lowest_sums`."""

    take: np.ndarray
    exchanges: np.ndarray
    begins: np.ndarray


def _selections(rules: Comparison) -> Selections:
    most = rules.most * (rules.most - 1) // 2
    lists = [exchanges(p * (p - 1) // 2) for p in range(rules.most + 1)]
    take = np.ceil(rules.share * np.arange(most + 1) - 1e-6).astype(np.int64)
    return Selections(take, np.concatenate(lists), np.cumsum([0, *map(len, lists)]))


def photographs_at(stack: PhotographStack, hidden: np.ndarray, nearest: np.ndarray) -> np.ndarray:
    """Number of photographs (rows, cols) uint8 that show the cells at the planes `nearest` (rows, cols; -1: none)."""
    out = np.zeros(nearest.shape, np.uint8)
    _photographs_at(stack.flat, stack.starts, stack.sizes, stack.planes, hidden, nearest, stack.none, out)
    return out


def stretches(stack: PhotographStack, choice: Choice, candidates: CellRanges, most: int, parallax: float) -> np.ndarray:
    """How many heights of a cell (rows, cols) lie within the parallax that two neighbouring ones are made for; float32, 1 to
    MOST_STRETCHED.

    most: photographs that are compared in a cell; parallax: px of the rectified photographs. Heights are as far apart as the widest
    base of the median place asks for. Where the photographs stand closer together, or show the place with pixels larger than its
    cells, neighbouring heights look more alike, and only what lies that many times farther away is another height.
    """
    out = np.ones(candidates.low.shape, np.float32)
    images = stack.flat, stack.starts, stack.sizes, stack.planes
    where = choice.spacing, choice.preferred.astype(np.int16), choice.hidden
    _stretches(*images, *where, candidates.low, candidates.offset, stack.none, most, stack.pixels, np.float32(parallax), out)
    return np.clip(out / np.float32(ALIKE), 1.0, MOST_STRETCHED)


@njit()
def _stretches(flat, starts, sizes, planes, spacing, preferred, hidden, low, offset, none, most, pixels, parallax, out):
    """Steps of height (of the levels of the volume) in which the widest parallax of two photographs changes by `parallax` px, into
    `out` (r, c). Arguments as in `_costs`; pixels (p,): ground pixels of the photographs, in cells."""
    rows, cols = low.shape
    chosen = np.empty(starts.size, np.int64)
    for r in range(rows):
        for c in range(cols):
            n, first = offset[r * cols + c + 1] - offset[r * cols + c], low[r, c]
            if n < 2:
                continue
            photos = choose(
                flat, starts, sizes, planes, preferred[r // spacing, c // spacing], hidden, r, c, first, n, none, most, chosen
            )
            one, next_one = first + n // 2 - 1, first + n // 2
            widest = np.float32(0.0)
            for a in range(photos):
                p = chosen[a]
                x, y = _moved(planes[p, one], planes[p, next_one], r, c)
                for b in range(a):
                    q = chosen[b]
                    u, v = _moved(planes[q, one], planes[q, next_one], r, c)
                    # A parallax is seen in the pixels of the coarser photograph, where these are larger than cells.
                    seen = np.sqrt((x - u) * (x - u) + (y - v) * (y - v)) / max(pixels[p], pixels[q], np.float32(1.0))
                    widest = max(widest, seen)
            if widest > 0:
                out[r, c] = parallax / widest


@njit(inline="always")
def _moved(plane, other, r, c):
    """Columns and rows by which a cell moves in a rectified photograph from one plane to another."""
    return (other[0] - plane[0]) * c + other[1] - plane[1], (other[0] - plane[0]) * r + other[2] - plane[2]


@njit(inline="always")
def looked_up(flat, start, rows, cols, plane, r, c, none):
    """The signature of a photograph at a cell and plane, `none` outside."""
    col, row = plane[0] * c + plane[1] + np.float32(0.5), plane[0] * r + plane[2] + np.float32(0.5)
    if col >= 0 and row >= 0 and col < cols and row < rows:
        return flat[start + np.int64(row) * cols + np.int64(col)]
    return none


@njit(inline="always")
def _look_along(signatures, rows, cols, planes, r, c, none, at, out):
    """Fill the first of `out` with the signatures of a photograph (rows x cols of them) at a cell and n planes, (3, n) numbers as
    in `looked_up`; at: scratch, int32."""
    scale, right, down = planes
    n, x, y, half = scale.size, np.float32(c), np.float32(r), np.float32(0.5)
    high, wide = np.float32(rows), np.float32(cols)
    # In two loops, of which the first computes many places at a time.
    for k in range(n):
        col, row = scale[k] * x + right[k] + half, scale[k] * y + down[k] + half
        inside = (col >= 0) & (row >= 0) & (col < wide) & (row < high)
        at[k] = np.int32(row) * np.int32(cols) + np.int32(col) if inside else np.int32(-1)
    for k in range(n):
        out[k] = signatures[np.uint32(at[k])] if at[k] >= 0 else none


@njit()
def _costs(flat, starts, sizes, planes, spacing, preferred, hidden, low, offset, none, most, selections, blank, cost):
    """Costs of every height of every cell, into `cost` (cells after each other, as `offset` says). flat: the signatures of all
    photographs in a row, which begin at `starts` (p,) and have `sizes` (p, 2); planes (p, levels): where a cell of a level lies in
    each; preferred: photographs in order of preference for every `spacing` cells; hidden (p, r, c): what does not see a cell; low
    (r, c): its lowest level; none: the signature of no data; most: photographs at most; selections: how many of their pairs count,
    and how they are found; blank: distance of a pair of which one does not show the height."""
    rows, cols = low.shape
    widest = _BATCH
    for i in range(rows * cols):
        widest = max(widest, offset[i + 1] - offset[i])
    found, distance = np.empty((most, widest), flat.dtype), np.empty((most * (most - 1) // 2, widest), np.uint8)
    scratch = distance, np.empty(widest, np.uint16), np.empty(widest, flat.dtype), np.empty(65, np.int64)
    # Numbers of one kind side by side, so that many planes are computed at a time.
    apart, at = np.ascontiguousarray(planes.transpose(2, 0, 1)), np.empty(widest, np.int32)
    chosen = np.empty(starts.size, np.int64)
    # Cells in a row that as many photographs show are treated as one: loops over the candidates of a single cell would be short.
    photos, begin, end = 0, 0, 0
    for r in range(rows):
        for c in range(cols):
            first, n = low[r, c], offset[r * cols + c + 1] - end
            if n == 0:
                continue
            shown = choose(
                flat, starts, sizes, planes, preferred[r // spacing, c // spacing], hidden, r, c, first, n, none, most, chosen
            )
            if shown != photos or end + n - begin > widest:
                _compare(found, photos, none, selections, blank, scratch, cost[begin:end])
                photos, begin = shown, end
            for m in range(shown):
                p = chosen[m]
                places = apart[:, p, first : first + n]
                _look_along(flat[starts[p] :], sizes[p, 0], sizes[p, 1], places, r, c, none, at, found[m, end - begin :])
            end += n
    _compare(found, photos, none, selections, blank, scratch, cost[begin:end])


@njit()
def _compare(found, photos, none, selections, blank, scratch, cost):
    """Fill the costs (n,) of candidates whose signatures are the first n of `found` (p, N), by so many photographs. scratch:
    rows of distances, of sums, of signatures, and the counts of one candidate."""
    n = cost.size
    if photos < 2:
        cost[:] = 0
        return
    distance, sums, united, counts = scratch
    united[:n] = found[0, :n]
    pairs = 0
    for a in range(photos):
        one = found[a]
        for b in range(a + 1, photos):
            other, row = found[b], distance[pairs]
            for k in range(n):
                row[k] = np.uint8(bits_set(one[k] ^ other[k]))
            pairs += 1
        for k in range(n):
            united[k] |= one[k]
    take = selections.take[pairs]
    order = selections.exchanges[selections.begins[photos] : selections.begins[photos + 1]]
    lowest_sums(distance, pairs, take, order, n, sums)
    for k in range(n):
        cost[k] = np.uint8(np.float32(sums[k]) * np.float32(COST_UNIT) / np.float32(take) + np.float32(0.5))
    for k in range(n):
        if united[k] >= none:
            cost[k] = _of_those_known(found[:photos, k], none, selections.take, blank, counts)


@njit()
def _of_those_known(found, none, take_of, blank, counts):
    """The cost of a candidate that not all photographs (p,) show; counts: scratch, pairs by their distance."""
    counts[:] = 0
    pairs = 0
    for a in range(found.size):
        for b in range(a):
            if found[a] < none and found[b] < none:
                counts[bits_set(found[a] ^ found[b])] += 1
                pairs += 1
    if pairs == 0:
        return blank
    take = left = take_of[pairs]
    total = 0
    for bits in range(counts.size):
        total += min(counts[bits], left) * bits
        left -= min(counts[bits], left)
    return np.uint8(np.float32(total) * np.float32(COST_UNIT) / np.float32(take) + np.float32(0.5))


@njit(inline="always")
def _shows(flat, start, size, planes, r, c, none):
    """Whether a photograph shows a cell at any of nine planes spread over its range; the middle first, which is most likely."""
    last = planes.shape[0] - 1
    for q in (4, 0, 8, 2, 6, 1, 3, 5, 7):
        if looked_up(flat, start, size[0], size[1], planes[q * last // 8], np.float32(r), np.float32(c), none) != none:
            return True
    return False


@njit(inline="always")
def choose(flat, starts, sizes, planes, preferred, hidden, r, c, first, n, none, most, chosen):
    """Writes the numbers of the photographs to be compared into `chosen`; returns how many. Those not hidden come first."""
    photos = 0
    for use_hidden in range(2):
        if photos >= 2:
            break
        for p in preferred:
            if photos >= most or p < 0:
                break
            usable = hidden[p, r, c] == (use_hidden == 1)
            if usable and _shows(flat, starts[p], sizes[p], planes[p, first : first + n], r, c, none):
                chosen[photos] = p
                photos += 1
    return photos


@njit()
def _photographs_at(flat, starts, sizes, planes, hidden, winners, none, out):
    """Add the number of photographs that see the level `winners` (r, c) of every cell to `out`; arguments as in `_costs`."""
    for r in range(winners.shape[0]):
        for c in range(winners.shape[1]):
            if winners[r, c] < 0:
                continue
            for p in range(starts.size):
                plane = planes[p, winners[r, c]]
                seen = looked_up(flat, starts[p], sizes[p, 0], sizes[p, 1], plane, np.float32(r), np.float32(c), none) != none
                out[r, c] += seen and not hidden[p, r, c]
