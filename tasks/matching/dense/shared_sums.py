"""Sums of the whole windows of neighbouring nodes, which share them.

Strategy
- Where the surface is smooth all pixels of a node's window lie on it. Its sums are then sums over a square, whose columns belong to
  the windows of its neighbours, too: products are summed once down the columns of a run of nodes, by row of parts (the scores need
  the sums of nine parts), and then along each part.
- Along a row, coordinates count from the first pixel of a part, for a column has many nodes; a node shifts them to itself. In
  wide windows parallaxes count from the plane of one node of the run: another adds multiples of the gradient, whose sums are there.
- Windows that are not whole are cut pixel by pixel (window_solution.py). Both ways give the same but for rounding.

Grey values count from one level for the whole run, in single precision: a run is short, so that little is lost.
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.matching.dense.kernel import kernel
from orthomill.tasks.matching.dense.surface_warp import LANES
from orthomill.tasks.matching.least_squares.grey_values import EXACT

RUN = 64
"""nodes in a row that share sums, at most"""
PARTS = 3
"""rows and columns of parts of a window"""
_L, _R, _G, _GY, _GG, _GGY, _GL, _GR, _GX, _GGX = range(10)
"""Sums by row of parts: left, right and gradient, and products of these with the gradient; x and y: times the coordinates. Those
with x exist along parts only."""
_LL, _LR, _RR, _GLY, _GRY, _GGYY, _OWN, _BELOW, _BESIDE, _ALONG, _SECOND, _GLX, _GRX, _GGXY, _GGXX, _PAIRS = range(16)
"""Sums of all rows, likewise. From `_OWN` to `_SECOND`: of the gradients that are not in the last two rows, with themselves, with
those below, with those of the next column, with that in the same row of the next column, and of the column after that; all but the
first and fourth weighted by the correlation of residuals, and together in `_PAIRS`"""
_VECTORS = 16
"""columns of a run are a multiple of this, so that loops over them have no rest"""
SMALLEST = 4
"""half side of windows whose parts are three pixels wide at least; smaller ones are cheap to cut"""


class SharedSums(NamedTuple):
    """Sums of a run of nodes, float32; the last axis is the pixel column, from the first of the first window on."""

    strips: np.ndarray
    """(3, 8, n): down the columns, by row of parts"""
    columns: np.ndarray
    """(11, n): down the columns, all rows"""
    strip_parts: np.ndarray
    """(2, 3, 10, n): along the part that begins at a column, by row of parts; of narrow and of wide parts"""
    parts: np.ndarray
    """(2, 16, n): the same of all rows"""
    line: np.ndarray
    """(n,): scratch"""
    ramp: np.ndarray
    """(n,): 0, 1, 2, ..."""


@kernel(inline="always")
def columns_of(away, step, half):
    """Columns of a run of nodes `step` px apart, whose last is `away` nodes from its first; filled up to whole vectors."""
    return (away * step + 2 * half + 1 + _VECTORS) // _VECTORS * _VECTORS


@njit()
def shared_sums_for(half, step):
    """Room for runs of nodes `step` px apart with windows of half side `half` at most."""
    n = columns_of(RUN - 1, step, half)
    return SharedSums(
        np.empty((PARTS, 8, n), np.float32),
        np.empty((11, n), np.float32),
        np.empty((2, PARTS, 10, n), np.float32),
        np.empty((2, 16, n), np.float32),
        np.zeros(n, np.float32),
        np.arange(n).astype(np.float32),
    )


@kernel(forceinline=True, fastmath=EXACT)
def is_whole(pair, centre, half, plane, tolerance, ramp):
    """Whether all pixels of a window lie on the plane of its node, as `cut_block` tests them; ramp: of `SharedSums`."""
    field, cols = pair.field, pair.cols
    limit, slope, last = np.float32(tolerance), np.float32(plane[1]), np.float32(2 * half)
    # Whole vectors are compared, also beyond the end of the row.
    lanes = np.uint64((2 * half + LANES) // LANES * LANES)
    for y in range(-half, half + 1):
        k = np.uint64(centre + y * cols - half)
        begin = np.float32(plane[0] + plane[2] * y - plane[1] * half)
        off = np.float32(0.0)
        for i in range(lanes):
            near = abs(field[k + i] - (begin + slope * ramp[i])) <= limit
            off += np.float32(0.0) if near | (ramp[i] > last) else np.float32(1.0)
        if off > 0.0:
            return False
    return True


@kernel(inline="always")
def fill_sums(pair, centre, half, n, plane, flat, correlation, shared):
    """Fill the sums of a run: of n columns, from the left side of the window of its first node on.

    centre: flat place of that node in the images of `pair`. plane (3,): parallaxes count from it where `flat`, see `cut_block`.
    correlation: of residuals 1 and 2 px apart.
    """
    side, cols = 2 * half + 1, pair.cols
    shared.strips[:, :, :n] = np.float32(0.0)
    shared.columns[:, :n] = np.float32(0.0)
    level = np.float32(0.0)
    for i in range(np.int64(n)):
        grey = pair.left[centre - half + i]
        level += grey / np.float32(n) if grey == grey else np.float32(0.0)
    for part in range(PARTS):
        for number in range(part * side // PARTS, (part + 1) * side // PARTS):
            # Read from memory, see `cut_block`.
            row = np.int64(shared.ramp[number])
            first = centre + (row - half) * cols - half
            begin = plane[0] + plane[2] * (row - half) - plane[1] * half
            _add_row(pair, first, n, (row - half, level, begin, plane[1], flat), shared.ramp, shared.strips[part], shared.columns)
            if row < side - 2:
                _add_pairs(pair.gradient, first, n, cols, correlation, shared.columns)
    before = 0
    for part in range(PARTS):
        width = (part + 1) * side // PARTS - part * side // PARTS
        if width != before:
            _sum_parts(shared, width, n - width + 1, shared.strip_parts[width - side // PARTS], shared.parts[width - side // PARTS])
        before = width


@kernel(forceinline=True, fastmath=EXACT)
def _add_row(pair, first, n, row, ramp, strip, columns):
    """Add the products of a row of n pixels, from the flat place `first` on. row: its y, and from what grey values and parallaxes
    count."""
    grey, warped, steepness, field = pair.left, pair.warped, pair.gradient, pair.field
    k, size, y, level = np.uint64(first), np.uint64(n), np.float32(row[0]), row[1]
    begin, slope, bend = np.float32(row[2]), np.float32(row[3]), np.float32(1.0 if row[4] else 0.0)
    # Few sums in each loop: more would not fit into the registers.
    a, b, c, d, e = strip[_L], strip[_R], columns[_LL], columns[_LR], columns[_RR]
    p, q = strip[_GR], columns[_GRY]
    for i in range(size):
        apart = field[k + i] - (begin + slope * ramp[i])
        g = steepness[k + i]
        left, right = grey[k + i] - level, warped[k + i] - level + bend * g * apart
        a[i] += left
        b[i] += right
        c[i] += left * left
        d[i] += left * right
        e[i] += right * right
        p[i] += g * right
        q[i] += y * (g * right)
    a, b, c, d, e = strip[_G], strip[_GY], strip[_GG], strip[_GGY], columns[_GGYY]
    p, q = strip[_GL], columns[_GLY]
    for i in range(size):
        g = steepness[k + i]
        left, gg = g * (grey[k + i] - level), g * g
        a[i] += g
        b[i] += y * g
        c[i] += gg
        d[i] += y * gg
        e[i] += y * (y * gg)
        p[i] += left
        q[i] += y * left


@kernel(forceinline=True, fastmath=EXACT)
def _add_pairs(gradient, first, n, cols, correlation, columns):
    """Add the products of the gradients of a row with those around them."""
    near, far, one, two = np.float32(correlation[0]), np.float32(correlation[1]), np.uint64(1), np.uint64(2)
    k, down, square = np.uint64(first), np.uint64(cols), np.float32(correlation[0] * correlation[0])
    a, b, c, d, e = columns[_OWN], columns[_BELOW], columns[_BESIDE], columns[_ALONG], columns[_SECOND]
    for i in range(np.uint64(n)):
        g, right, below = gradient[k + i], gradient[k + i + one], gradient[k + i + down]
        a[i] += g * g
        b[i] += g * (near * below + far * gradient[k + i + down + down])
        c[i] += near * (g * right) + square * (g * gradient[k + i + down + one] + right * below)
        d[i] += g * right
        e[i] += far * (g * gradient[k + i + two])


@kernel(inline="always")
def _sum_parts(shared, width, size, strip_parts, parts):
    """Fill the sums along the parts of `width` px that begin at the first `size` columns."""
    columns, line = shared.columns, shared.line
    for strip in range(PARTS):
        down, along = shared.strips[strip], strip_parts[strip]
        for which in (_L, _R, _GY, _GL, _GR, _GGY):
            _sum_along(down[which], width, size, along[which])
        for which, moment in ((_G, _GX), (_GG, _GGX)):
            _sum_along(down[which], width, size, along[which])
            _sum_moments(down[which], width, size, 1, along[moment])
    for which, moment, power in ((_GL, _GLX, 1), (_GR, _GRX, 1), (_GGY, _GGXY, 1), (_GG, _GGXX, 2)):
        _sum_of(shared.strips[0, which], shared.strips[1, which], shared.strips[2, which], line)
        _sum_moments(line, width, size, power, parts[moment])
    _sum_of(columns[_BELOW], columns[_BESIDE], columns[_SECOND], line)
    _sum_along(line, width, size, parts[_PAIRS])
    for which in (_LL, _LR, _RR, _GLY, _GRY, _GGYY, _OWN, _ALONG):
        _sum_along(columns[which], width, size, parts[which])


@kernel(forceinline=True, fastmath=EXACT)
def _sum_of(a, b, c, out):
    """Fill (n,) with the sum of three; an array expression would make an array first."""
    for i in range(np.uint64(out.size)):
        out[i] = a[i] + b[i] + c[i]


@kernel(forceinline=True, fastmath=EXACT)
def _sum_along(source, width, size, out):
    """Fill `size` places with the sums of (n,) over `width` places, three or more, from each on."""
    n = np.uint64(size)
    # Three at once and the rest in pairs: every loop more reads and writes the sums once more.
    a, b, c = source[:size], source[1 : size + 1], source[2 : size + 2]
    for i in range(n):
        out[i] = a[i] + b[i] + c[i]
    for x in range(3, width - 1, 2):
        a, b = source[x : x + size], source[x + 1 : x + 1 + size]
        for i in range(n):
            out[i] += a[i] + b[i]
    if (width - 3) % 2:
        a = source[width - 1 : width - 1 + size]
        for i in range(n):
            out[i] += a[i]


@kernel(forceinline=True, fastmath=EXACT)
def _sum_moments(source, width, size, power, out):
    """The same times the distance from the first place to that power."""
    n, two = np.uint64(size), np.float32(2**power)
    a, b = source[1 : size + 1], source[2 : size + 2]
    for i in range(n):
        out[i] = a[i] + two * b[i]
    for x in range(3, width - 1, 2):
        a, b, u, v = source[x : x + size], source[x + 1 : x + 1 + size], np.float32(x**power), np.float32((x + 1) ** power)
        for i in range(n):
            out[i] += u * a[i] + v * b[i]
    if (width - 3) % 2:
        a, u = source[width - 1 : width - 1 + size], np.float32((width - 1) ** power)
        for i in range(n):
            out[i] += u * a[i]


@kernel(forceinline=True)
def sums_of(shared, at, half, off, sums):
    """Fill the sums of one window as `block_sums` does, and return those that `correlation_factor` takes.

    at: column of its first pixel in the run. off (3,): what the plane of the run has more than that of the node, see `off_plane`.
    """
    side, strips, rows = 2 * half + 1, shared.strip_parts, shared.parts
    sums[:] = 0.0
    sums[0] = side * side
    own = pairs = along = 0.0
    for part in range(PARTS):
        begin = part * side // PARTS
        slot, k, x = (part + 1) * side // PARTS - begin - side // PARTS, at + begin, float(begin - half)
        for strip in range(PARTS):
            g, gg, ggy = strips[slot, strip, _G, k], strips[slot, strip, _GG, k], strips[slot, strip, _GGY, k]
            gl, gr, ggx = strips[slot, strip, _GL, k], strips[slot, strip, _GR, k], strips[slot, strip, _GGX, k]
            sums[1] += strips[slot, strip, _L, k]
            sums[2] += strips[slot, strip, _R, k]
            sums[6] += g
            sums[7] += strips[slot, strip, _GX, k] + x * g
            sums[8] += strips[slot, strip, _GY, k]
            sums[9] += gg
            sums[10] += ggx + x * gg
            sums[11] += ggy
            sums[12] += 2.0 * x * ggx + x * x * gg
            sums[13] += x * ggy
            sums[15] += gl
            sums[16] += x * gl
            sums[18] += gr
            sums[19] += x * gr
        sums[3] += rows[slot, _LL, k]
        sums[4] += rows[slot, _LR, k]
        sums[5] += rows[slot, _RR, k]
        sums[12] += rows[slot, _GGXX, k]
        sums[13] += rows[slot, _GGXY, k]
        sums[14] += rows[slot, _GGYY, k]
        sums[16] += rows[slot, _GLX, k]
        sums[17] += rows[slot, _GLY, k]
        sums[19] += rows[slot, _GRX, k]
        sums[20] += rows[slot, _GRY, k]
        own += rows[slot, _OWN, k]
        pairs += rows[slot, _PAIRS, k]
        along += rows[slot, _ALONG, k]
    # The last columns have no neighbours within the window.
    last = at + side - 1
    pairs -= shared.columns[_BESIDE, last] + shared.columns[_SECOND, last] + shared.columns[_SECOND, last - 1]
    along -= shared.columns[_ALONG, last]
    _move_plane(off, sums)
    return own, pairs, along


@kernel(forceinline=True)
def off_plane(plane, to, distance):
    """Parallax at a node, and slopes, that `plane` (3,) has more than the plane `to` (3,) of the node, which lies `distance` px to
    the right of its own."""
    return plane[0] + plane[1] * distance - to[0], plane[1] - to[1], plane[2] - to[2]


@kernel(forceinline=True)
def _move_plane(off, sums):
    """Let the parallaxes of the right window count from a plane that lies lower by `off`: it gains so many gradients."""
    level, x, y = off
    sums[2] += level * sums[6] + x * sums[7] + y * sums[8]
    sums[4] += level * sums[15] + x * sums[16] + y * sums[17]
    more = (
        level * sums[9] + x * sums[10] + y * sums[11],
        level * sums[10] + x * sums[12] + y * sums[13],
        level * sums[11] + x * sums[13] + y * sums[14],
    )
    sums[5] += level * (2.0 * sums[18] + more[0]) + x * (2.0 * sums[19] + more[1]) + y * (2.0 * sums[20] + more[2])
    sums[18] += more[0]
    sums[19] += more[1]
    sums[20] += more[2]


@kernel(forceinline=True)
def squared_shared_scores(shared, at, half, off, constant, mean, unknowns):
    """Sum of the squared scores of the parts of a window, as `squared_scores` gives it; at, off: see `sums_of`."""
    side, strips = 2 * half + 1, shared.strip_parts
    gain, b, c, a = unknowns[0], unknowns[1] - off[1], unknowns[2] - off[2], unknowns[3] - off[0]
    total = 0.0
    for part in range(PARTS):
        begin = part * side // PARTS
        width = (part + 1) * side // PARTS - begin
        slot, k = width - side // PARTS, at + begin
        # From the node to the first column of the part.
        level = a + b * (begin - half)
        for strip in range(PARTS):
            n = width * ((strip + 1) * side // PARTS - strip * side // PARTS)
            g = strips[slot, strip, _G, k]
            residual = strips[slot, strip, _R, k] - constant * n - gain * strips[slot, strip, _L, k]
            residual -= level * g + b * strips[slot, strip, _GX, k] + c * strips[slot, strip, _GY, k]
            score = strips[slot, strip, _GR, k] - constant * g - gain * strips[slot, strip, _GL, k] - mean * residual
            score -= level * strips[slot, strip, _GG, k] + b * strips[slot, strip, _GGX, k] + c * strips[slot, strip, _GGY, k]
            total += score * score
    return total
