"""Ground that is hidden and invented again, and ground beside objects as what lies farther away lets expect it."""

from typing import NamedTuple

import numpy as np

from orthomill.tasks.terrain.ground.learned_errors import GroundSamples
from orthomill.tasks.terrain.ground.mean_value_fill import GapFill, fill_gaps

STRIDE = 3
"""every so many-th row and column is a sample: neighbours tell the same"""
EXPECTED_REACH = 32
"""cells from which ground beside objects is expected: a height from farther away is worth less than what was measured"""
BANDS = 4


class ToldGround(NamedTuple):
    """samples: what measured ground tells; expected (rows, cols, 4) float32: of ground beside objects the height that follows from
    free ground around, the standard error of that ground (m), the distance (cells) and the bend (m) as in `GapFill`; NaN
    elsewhere."""

    samples: GroundSamples
    expected: np.ndarray


def told_by_ground(
    blocks: np.ndarray,
    rings: np.ndarray,
    free: int,
    moved: np.ndarray,
    core: tuple[slice, slice],
    place: tuple[int, int],
    reach: int,
) -> ToldGround:
    """What the cells `core` tell.

    blocks (rows, cols, 3) as of `block_heights`; rings (rows, cols) uint8: 0 for objects, then the distance of ground from them,
    `free` for ground that counts; moved (rows, cols) bool: the free ground as it is a fixed number of cells away; place: row and
    column of the first cell of the arrays; `reach` in cells.
    """
    anchors = rings == free
    inside = np.zeros(rings.shape, bool)
    inside[core] = True
    beside = inside & (rings > 0) & ~anchors
    near = fill_gaps(blocks[..., :2], anchors, beside, EXPECTED_REACH)
    beside &= near.enclosed & np.isfinite(near.distance)
    expected = np.stack([near.values[..., 0], near.values[..., 1], near.distance, near.bend], axis=-1)
    sampled = np.zeros(rings.shape, bool)
    sampled[-place[0] % STRIDE :: STRIDE, -place[1] % STRIDE :: STRIDE] = True
    hidden = inside & sampled & anchors & ~moved
    far = fill_gaps(blocks[..., :1], anchors & moved, hidden, reach)
    parts = (
        _samples(blocks, far, hidden & np.isfinite(far.distance), np.zeros(rings.shape, np.uint8), place),
        _samples(blocks, near, sampled & beside, rings, place),
    )
    names = GroundSamples.__dataclass_fields__
    samples = GroundSamples(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
    return ToldGround(samples, np.where(beside[..., None], expected, np.nan)[core].astype(np.float32))


def _samples(blocks: np.ndarray, fill: GapFill, where: np.ndarray, ring: np.ndarray, place: tuple[int, int]) -> GroundSamples:
    row, col = np.nonzero(where)
    return GroundSamples(
        row=(row + place[0]).astype(np.int64),
        col=(col + place[1]).astype(np.int64),
        ring=ring[where],
        distance=fill.distance[where],
        bend=fill.bend[where],
        off=(blocks[..., 0] - fill.values[..., 0])[where],
        enclosed=fill.enclosed[where],
    )
