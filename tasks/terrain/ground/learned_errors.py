"""How wrong invented ground is, and how it bends, learned from ground of the same block that is hidden and invented again.

Strategy. The pattern of gaps and objects is laid over the ground beside them, moved by a fixed number of cells; what it covers is
hidden and filled from what it leaves. The differences from what was measured there, sorted by the distance to the ground that was
left, tell two things of this very terrain: which share of the bend that the slopes beyond a gap announce is found inside it
(`mean_value_fill`), and how far the rest is off, for ground that announces no bend and for ground that does. The same ground, at
the foot of walls and crowns, tells by how much matching windows that see both lift it there.
"""

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Columns
from orthomill.tasks.terrain.ground.mean_value_fill import GapFill

CLASSES = 10
"""of distance: up to 1, 2, 4, ... cells"""
LEAST_SAMPLES = 60
"""that a class of distance needs, or a ring beside objects: neighbours share their errors, so that fewer tell nothing"""
UNKNOWN_GROWTH = 0.1
"""m per m: error of invented ground where too little ground could be hidden, about that of hilly land"""
WIDEST_BEND = 4.0
"""bends beyond so many root mean squares of those that were hidden are no ground's"""
LEAST_GROWTH = 0.25
"""m per m: no bend is known better"""
_TWO_SIGMA = 0.9545
"""of a normal law lie within two standard errors"""


@dataclass(frozen=True)
class GroundSamples(Columns):
    """One row for a hidden cell, or one at the foot of an object: measured ground that was invented as well."""

    row: np.ndarray
    col: np.ndarray
    """int64: of the block of cells"""
    ring: np.ndarray
    """uint8: 0 for hidden ground; cells to the nearest object for ground at the foot of one"""
    distance: np.ndarray
    bend: np.ndarray
    """float32 cells and m, as in `GapFill`"""
    off: np.ndarray
    """float32 m: measured height above the mean of the border"""
    enclosed: np.ndarray
    """bool"""


class SideErrors(BaseModel):
    """By class of distance: the share of an announced bend that is found, its largest one (m), the error (m) of ground that
    announces none, what every metre of bend adds to it (m), and the samples that each rests on."""

    model_config = ConfigDict(frozen=True)

    found: tuple[float, ...]
    largest: tuple[float, ...]
    error: tuple[float, ...]
    growth: tuple[float, ...]
    samples: tuple[int, ...]


class FillErrors(BaseModel):
    """What hidden ground told: at the `distance` (cells), enclosed and open to one side; by ring beside objects, from the first
    on, how much too high ground is there (m), and the samples of each."""

    model_config = ConfigDict(frozen=True)

    distance: tuple[float, ...]
    enclosed: SideErrors
    one_sided: SideErrors
    lifted: tuple[float, ...]
    ring_samples: tuple[int, ...]

    def at(self, fill: GapFill) -> tuple[np.ndarray, np.ndarray]:
        """What the bend adds to filled cells, and their standard errors, (rows, cols) float32 m; zero and NaN where nothing was
        filled."""
        known = np.isfinite(fill.distance)
        place = np.log2(np.maximum(np.where(known, fill.distance, 1.0), 1e-3))
        inside, outside = (self._side(place, fill.bend, side) for side in (self.enclosed, self.one_sided))
        # From one to the other without a step, which would be one of the ground.
        added, error = (one + fill.beside * (other - one) for one, other in zip(inside, outside, strict=True))
        return np.where(known, added, 0.0).astype(np.float32), np.where(known, error, np.nan).astype(np.float32)

    def _side(self, place: np.ndarray, bend: np.ndarray, side: SideErrors) -> tuple[np.ndarray, np.ndarray]:
        log = np.log2(self.distance)
        found, largest, error, growth = (
            np.interp(place, log, values) for values in (side.found, side.largest, side.error, side.growth)
        )
        # In proportion to the distance beyond the last class.
        beyond = np.exp2(np.clip(place - log[-1], 0.0, None))
        held = np.clip(bend, -largest * beyond, largest * beyond)
        # Of a bend wider than any that was hidden nothing is known but that it is there.
        return found * held, np.sqrt((error * beyond) ** 2 + (growth * held) ** 2 + (bend - held) ** 2)


def learned_errors(parts: tuple[GroundSamples, ...], cell: float, rings: int) -> FillErrors:
    """What the samples of all tiles tell together; `cell` m."""
    # In the order of the map, whatever the tiles: sums of rounded numbers depend on it.
    names = GroundSamples.__dataclass_fields__
    samples = GroundSamples(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
    samples = samples.take(np.lexsort((samples.col, samples.row)))
    distance = 2.0 ** (np.arange(CLASSES) - 0.5)
    hidden = samples.ring == 0
    inside = _side(samples.take(hidden & samples.enclosed), UNKNOWN_GROWTH * cell * distance)
    outside = _side(samples.take(hidden & ~samples.enclosed), 2.0 * np.array(inside.error))
    # What is open to one side is never better than what is enclosed: it is extrapolated.
    worst = tuple(np.maximum(outside.error, inside.error).tolist())
    outside = outside.model_copy(update={"error": worst})
    lifted, count = zip(*(_lifted(samples, ring, inside) for ring in range(1, rings + 1)), strict=True)
    return FillErrors(distance=tuple(distance.tolist()), enclosed=inside, one_sided=outside, lifted=lifted, ring_samples=count)


def _class_of(distance: np.ndarray) -> np.ndarray:
    return np.clip(np.ceil(np.log2(np.maximum(distance, 1.0))), 0, CLASSES - 1).astype(np.int64)


def _side(samples: GroundSamples, otherwise: np.ndarray) -> SideErrors:
    """Of one kind of samples; `otherwise` (CLASSES,) m: their errors where too few are known."""
    number = _class_of(samples.distance)
    rows = [_one_class(samples.bend[number == k], samples.off[number == k]) for k in range(CLASSES)]
    count = np.bincount(number, minlength=CLASSES)
    known = count >= LEAST_SAMPLES
    found, largest, error, growth = np.array(rows).T
    return SideErrors(
        found=_continued(found, known, 0.0 * otherwise, 1.0),
        largest=_continued(largest, known, otherwise, 2.0),
        error=tuple(np.maximum.accumulate(_continued(error, known, otherwise, 2.0)).tolist()),
        growth=_continued(growth, known, 1.0 + 0.0 * otherwise, 1.0),
        samples=tuple(count.tolist()),
    )


def _one_class(bend: np.ndarray, off: np.ndarray) -> tuple[float, float, float, float]:
    """Share of the bend that is found, the largest one, the error without a bend, and its growth with it."""
    if len(off) < LEAST_SAMPLES:
        return (0.0, 0.0, 0.0, 0.0)
    c, d = bend.astype(np.float64), off.astype(np.float64)
    largest = WIDEST_BEND * max(float(np.sqrt((c * c).mean())), 1e-6)
    c = np.clip(c, -largest, largest)
    square = c * c
    found = float(np.clip((d * c).sum() / max(square.sum(), 1e-12), 0.0, 1.0))
    rest = (d - found * c) ** 2
    # A line through the squares: what is off without a bend, and what a bend adds.
    spread = square - square.mean()
    slope = max(float((spread * rest).sum() / max((spread * spread).sum(), 1e-18)), LEAST_GROWTH**2)
    level = rest.mean() - slope * square.mean()
    if level <= 0.0:
        level, slope = 0.25 * rest.mean(), 0.75 * rest.mean() / max(square.mean(), 1e-18)
    # Errors of ground have longer tails than a normal law: two standard errors are to hold what they promise.
    scale = float(np.quantile(np.sqrt(rest / np.maximum(level + slope * square, 1e-18)), _TWO_SIGMA)) / 2.0
    return found, largest, scale * float(np.sqrt(level)), scale * float(np.sqrt(slope))


def _continued(values: np.ndarray, known: np.ndarray, otherwise: np.ndarray, factor: float) -> tuple[float, ...]:
    """The values of the classes, on beyond the known ones by a `factor` from class to class; `otherwise` without any."""
    if not known.any():
        return tuple(otherwise.tolist())
    number = np.arange(len(values))
    first, last = np.flatnonzero(known)[[0, -1]]
    filled = np.interp(number, np.flatnonzero(known), values[known])
    away = np.minimum(number - first, 0) + np.maximum(number - last, 0)
    return tuple((filled * factor**away).tolist())


def _lifted(samples: GroundSamples, ring: int, inside: SideErrors) -> tuple[float, int]:
    """By how much ground in a ring beside objects is too high, m, and the samples that tell it."""
    here = (samples.ring == ring) & samples.enclosed
    count = int(here.sum())
    if count < LEAST_SAMPLES:
        return 0.0, count
    found = np.array(inside.found)[_class_of(samples.distance[here])]
    return max(float(np.median(samples.off[here] - found * samples.bend[here])), 0.0), count
