"""How far photographs agree about a roof: at its height all of them show the same place of it, beyond its edge each shows another.

Colours alone do not tell a roof from what looks like it: a wall in the light, a street beside a grey roof. But at the roof's height
a wall or a street is seen by every photograph at a place of its own. The pairs of photographs that agree best decide, for
something else may stand before some.

Source: the photo-consistency of Seitz and Dyer 1999 (Photorealistic scene reconstruction by voxel coloring), of pairs.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit

USUAL = 6.0
"""grey levels by which photographs differ where the upper surface is as likely as the lower one, by this alone"""
_MOST = 20.0  # grey levels from which on a difference tells no more
_WEIGHT = 2.0  # a grey level of disagreement is worth so many of likeness
_SURE = 15.0  # grey levels: likeness tells no more than this, however large
_COMPARED = 10  # photographs of a pixel: others between them add hardly anything but time


def disagreement(colours: np.ndarray, shown: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """float32 (rows, cols) grey levels: mean difference of the better half of the pairs of photographs at the `chosen` pixels
    (rows, cols) bool; NaN elsewhere and where fewer than two photographs show the pixel.

    colours (photos, rows, cols, bands); shown (photos, rows, cols) bool.
    """
    out = np.full(chosen.shape, np.nan, np.float32)
    _disagree(colours, shown, chosen, out)
    return out


def with_agreement(scores: np.ndarray, differences: np.ndarray) -> np.ndarray:
    """Scores (rows, cols) as of `likeness`, to which is added by how much photographs differ at the upper height (rows, cols);
    where that is not known the likeness stands alone."""
    apart = np.minimum(np.where(np.isnan(differences), USUAL, differences), _MOST)
    return np.asarray(np.clip(scores, -_SURE, _SURE) + _WEIGHT * (apart - USUAL), np.float32)


@njit()
def _disagree(colours, shown, chosen, out):
    """Fills `out` (rows, cols) as `disagreement` tells."""
    photos, rows, cols, bands = colours.shape
    number, apart = np.empty(_COMPARED, np.int64), np.empty(_COMPARED * (_COMPARED - 1) // 2)
    for r in range(rows):
        for c in range(cols):
            if not chosen[r, c]:
                continue
            count = 0
            for p in range(photos):
                count += shown[p, r, c]
            every, seen, used = -(-count // _COMPARED), 0, 0
            for p in range(photos):
                if shown[p, r, c]:
                    if seen % every == 0:
                        number[used] = p
                        used += 1
                    seen += 1
            if used < 2:
                continue
            pairs = 0
            for i in range(used):
                for j in range(i + 1, used):
                    total = 0.0
                    for band in range(bands):
                        total += abs(colours[number[i], r, c, band] - colours[number[j], r, c, band])
                    apart[pairs] = total / bands
                    pairs += 1
            out[r, c] = np.sort(apart[:pairs])[: (pairs + 1) // 2].mean()
