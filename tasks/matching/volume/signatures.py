"""Census signatures: which neighbours of a pixel are darker than it, one bit each; invariant to gain and offset.

Strategy: the window is sampled with a stride, so that an image sampled more finely than the cells of the volume gives signatures at
positions between them: a candidate is then looked up at the nearest position and nothing is interpolated. A pixel has a signature
when it has a value itself; neighbours without one count as brighter, so that signatures reach the border of a photograph.

Source: Zabih & Woodfill 1994.
"""

from typing import Any

import numpy as np
from numba.extending import intrinsic

from orthomill.kernels.kernel_compilation import njit

BITS = {2: 24, 3: 48}
"""half side of the window -> neighbours compared, the greatest distance of two signatures"""
_TYPE = {2: np.uint32, 3: np.uint64}


def _population_count(context: Any, value: Any) -> Any:
    # numba has no population count of its own, although every processor has: LLVM's instruction is reached through an intrinsic.
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return value(value), generate


bits_set: Any = intrinsic(_population_count)
"""Number of bits set in an unsigned integer, of the same type; for kernels."""


def no_signature(half: int) -> np.unsignedinteger:
    """The code of a pixel without a value: the highest bit, which no signature uses."""
    return np.uint32(1 << 31) if half == 2 else np.uint64(1 << 63)


def signatures(grey: np.ndarray, half: int, stride: int) -> np.ndarray:
    """Signatures (rows, cols) uint32 (`half` 2) or uint64 (3) of an image (rows, cols) float32, NaN without a value.

    Neighbours are `stride` px apart, (2 * half + 1)^2 - 1 of them.
    """
    reach = half * stride
    padded = np.pad(grey, reach, constant_values=np.nan)
    out = np.zeros(grey.shape, _TYPE[half])
    _compare(padded, half, stride, np.empty((2, grey.shape[1]), np.uint32), out, no_signature(half))
    return out


@njit()
def _compare(padded, half, stride, words, out, none):
    """Census signatures into `out` (r, c): a bit for every pixel within `half` steps of `stride` px, set where it is darker than
    the centre; `none` without data. padded: the image, wider by the reach on all sides; words (2, c): scratch."""
    rows, cols = out.shape
    reach, side = half * stride, 2 * half + 1
    one, zero, middle = np.uint32(1), np.uint32(0), side * side // 2
    for r in range(rows):
        centre, row = padded[r + reach, reach : reach + cols], out[r]
        words[:] = zero
        for place in range(side * side):
            if place == middle:
                continue
            # The window runs outside and the columns inside, so that the inner loop is contiguous and vectorised; bits are
            # gathered in words as long as grey values, of which as many fit into a vector.
            first = reach + (place % side - half) * stride
            neighbour = padded[r + reach + (place // side - half) * stride, first : first + cols]
            word = words[0] if half > 2 and place < middle else words[1]
            for c in range(cols):
                word[c] = (word[c] << one) | (one if neighbour[c] < centre[c] else zero)
        for c in range(cols):
            row[c] = (np.uint64(words[0, c]) << np.uint64(24)) | np.uint64(words[1, c])
        for c in range(cols):
            if centre[c] != centre[c]:
                row[c] = none
