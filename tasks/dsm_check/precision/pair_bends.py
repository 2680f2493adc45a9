"""By how much the pairs of the check bend against each other: what orientation and lens leave of the heights of a pair.

Strategy. A standard error of matching tells how well two windows fit, and neighbours average it. What orientation and lens get
wrong is alike over whole parts of a photograph: no window shows it, no neighbour averages it, and it is as large on good texture as
on bad. But another pair has another one. So pairs are compared at the nodes that they have in common, where the error of the
surface is the same for both and cancels. Medians of their differences over blocks hold little noise: their variance, less what
noise leaves, is the sum of both bends. One error of a shift, in pixels, explains the differences of all pairs (the median of what
each of them asks for): a bend is a few waves over a photograph, of which a single pair tells no more than the order, and what two
of them differ by does not say which of them it is.

Histograms of differences add up over the tiles, so that every tiling gives the same bends.
"""

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.tasks.dsm_check.correction_map import CorrectionNodes
from orthomill.tasks.dsm_check.coverage import CheckedPairs
from orthomill.tasks.dsm_check.joint_correction import PairBends, shared_noise
from orthomill.tasks.dsm_check.nodes import DH, SIGMA
from orthomill.tasks.dsm_check.statistics import Counts, added, count, summarised
from orthomill.tasks.dsm_check.tile import NodeWindow

BLOCK = 32
"""cells along a block, in which noise is averaged and a bend is not; every tile begins at a multiple"""
_LEAST_SHARE = 0.25
"""of the nodes of a block that must have been matched in both pairs"""
_LEAST_BLOCKS = 5
"""in common: fewer tell no spread"""
_MEDIAN = 1.57
"""variance of a median of many, relative to that of their mean"""


class PairsApart(BaseModel):
    """The blocks that two pairs have in common in a tile: their differences (m), and what noise leaves of these (m)."""

    model_config = ConfigDict(frozen=True)

    one: str
    other: str
    apart: Counts
    due: Counts


class TilePairs(BaseModel):
    """All pairs of pairs of a tile."""

    model_config = ConfigDict(frozen=True)

    differences: tuple[PairsApart, ...] = ()


def compare_pairs(
    pairs: tuple[NodeWindow, ...], grid: CorrectionNodes, pixel_height: float, nodes: tuple[np.ndarray, ...] = ()
) -> TilePairs:
    """The differences of all pairs in the blocks of a tile; nodes: one array (rows, cols, bands) for each of `pairs`; pixel_height:
    m, of an orthoimage pixel."""
    noise, found = shared_noise([pair.geometry for pair in pairs]), []
    for k, one in enumerate(pairs):
        for m, other in enumerate(pairs[:k]):
            common = one.own.overlap(other.own)
            if common.empty:
                continue
            a, b = (array[common.within(pair.given).slices] for pair, array in ((one, nodes[k]), (other, nodes[m])))
            # What noise in a photograph of both makes alike, or opposite, is no bend.
            together = 2.0 * noise[k, m] * a[..., SIGMA] * b[..., SIGMA]
            variance = np.maximum(a[..., SIGMA] ** 2 + b[..., SIGMA] ** 2 - together, 0.0)
            apart, due = block_medians(a[..., DH] - b[..., DH], variance, grid)
            if len(apart):
                counts = count(apart, due, pixel_height), count(due, due, pixel_height)
                found.append(PairsApart(one=one.pair, other=other.pair, apart=counts[0], due=counts[1]))
    return TilePairs(differences=tuple(found))


def block_medians(apart: np.ndarray, variance: np.ndarray, grid: CorrectionNodes) -> tuple[np.ndarray, np.ndarray]:
    """Medians (N,) m of differences (rows, cols) m over blocks of nodes, NaN left out, and the standard errors (N,) m that noise
    of this variance (rows, cols) m^2 leaves them."""
    side = BLOCK // grid.step
    # Windows of neighbouring nodes overlap, and so does their noise: so many nodes say as much as one.
    alike = sum(max(1.0 - abs(k) * grid.step / grid.window, 0.0) for k in range(-side, side + 1)) ** 2
    medians, errors = [], []
    for row in range(0, apart.shape[0], side):
        for col in range(0, apart.shape[1], side):
            place = np.s_[row : row + side, col : col + side]
            known = np.isfinite(apart[place])
            if known.sum() >= _LEAST_SHARE * side**2:
                medians.append(float(np.median(apart[place][known])))
                of_noise = float(np.median(variance[place][known]))
                errors.append(float(np.sqrt(_MEDIAN * of_noise * min(alike / known.sum(), 1.0))))
    return np.array(medians), np.array(errors)


def pair_bends(tiles: tuple[TilePairs, ...], pairs: CheckedPairs) -> PairBends:
    """The bend of every pair from the differences in all tiles."""
    ratio = {pair.name: 1 / pair.base_height for pair in pairs.pairs}
    # The height of a pixel of each pair: narrow bases make more of the same error in the photographs.
    pixel = {name: pairs.pixel_height * one / float(np.mean(list(ratio.values()))) for name, one in ratio.items()}
    sets: dict[tuple[str, str], list[PairsApart]] = {}
    for tile in tiles:
        for part in tile.differences:
            sets.setdefault((part.one, part.other), []).append(part)
    squares = []
    for one, other in sorted(sets):
        apart, due = (added([getattr(part, name) for part in sets[one, other]]) for name in ("apart", "due"))
        if apart.number >= _LEAST_BLOCKS:
            # Medians: walls, crowns and wrong matches are no bends. About zero: that a pair lies higher as a whole is one.
            seen, noise = summarised(apart, pairs.pixel_height), summarised(due, pairs.pixel_height)
            excess = seen.median**2 + seen.nmad**2 - noise.median**2
            squares.append(excess / (pixel[one] ** 2 + pixel[other] ** 2))
    error = float(np.sqrt(max(float(np.median(squares)), 0.0))) if squares else 0.0
    return PairBends(error=round(error, 4), of_pair={name: round(error * height, 6) for name, height in pixel.items()})
