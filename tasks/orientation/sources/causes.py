"""Why sources contradict each other: hypotheses are tried, and the one that explains most is kept if chance does not.

Tried are constant errors of the positions (of a flight, or from one photograph in the order of exposure to another; in height
alone or in all coordinates; of all positions against the control), other camera constants of such photographs, a bend of the
block, another scale of the map of the control, and units of length of the control. The likelihood of each is compared with that of
the sources as given; several causes are found one after the other.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np
from scipy.special import chdtrc, fdtrc

from orthomill.tasks.orientation.sources.evidence import Source, Told
from orthomill.tasks.orientation.sources.hypotheses import Bend, Cause, Offset, PlanScale, Zoom
from orthomill.tasks.orientation.sources.rigid_block import RigidBlock
from orthomill.tasks.orientation.sources.robust_motion import Explained, explained

CHANCE = 1e-4
"""Probability that chance explains as much as a cause does, for all hypotheses together, from which on the cause is believed."""
JUMPS = 3
"""Places in the order of exposure, the largest jumps of the positions in height and in plan, between which offsets are tried."""
FEWEST_BENT = 8
"""Positions from which on a bend of the block can be told from single wrong ones."""
LEAST = 3
"""Photographs of an offset that no tag gives a reason for; the others must be as many. Control points that show a scale."""
CLEAR = 3.0
"""Such an offset is so many times larger than the scatter of the positions beside it; one of a flight is larger than it."""
DETERMINED = 3.0
"""Standard errors of an offset that it exceeds: two strips show no offset between them without attitudes."""
PIXELS = 3.0
"""Offsets up to so many pixels on the ground do not matter."""
UNTOLD_PIXELS = 20.0
"""The same of offsets that no tag gives a reason for: a block that is bent by some pixels looks like one that is broken in two."""
FARTHEST = 1000.0
"""m: positions that are farther off are of another place, and not those of this block with an error."""
HIGHEST = 9000.0
"""m: heights above the place of take-off that stand for heights above the sea miss no more than the highest ground."""
NEEDED = 16.0
"""What a cause has to explain beside the others, in squares of standard errors."""
ALIKE = 9.0
"""Less than this, in squares of standard errors, does not tell another camera constant from an offset; the offset is the plainer
cause."""
SEVERAL = 4
"""Causes that are looked for one after the other."""
UnitName = Literal["feet", "metres"]
UNITS: dict[UnitName, float] = {"feet": 0.3048, "metres": 1.0 / 0.3048}
"""What the coordinates of control are in when they are not in metres, and the factor that makes metres of them; `metres`: they were
taken for feet."""


@dataclass(frozen=True, eq=False)
class Groups:
    """How photographs belong together: `flight` (P,) numbers of flights, receivers and kinds of heights, `order` (P,) the numbers
    of the photographs in the order of exposure."""

    flight: np.ndarray
    order: np.ndarray


@dataclass(frozen=True)
class Unit:
    """Control that is in another unit: its `name` as in UNITS, in its heights only or in all coordinates."""

    name: UnitName
    heights_only: bool

    def applied(self, told: Told) -> Told:
        """What the sources say with the control in metres."""
        factor = np.where([self.heights_only, self.heights_only, False], 1.0, UNITS[self.name])
        return replace(told, control=told.control * factor)


@dataclass(frozen=True, eq=False)
class Findings:
    """The causes that were found, the unit of the control where it is not metres, what the sources say as given (`before`) and with
    the causes (`after`), what they say then (`told`), and the other camera constants with their shares that explain what the causes
    do (`zooms`), which the photographs themselves have to decide."""

    causes: tuple[Cause, ...]
    unit: Unit | None
    before: Explained
    after: Explained
    told: Told
    zooms: tuple[tuple[Zoom, float], ...] = ()


@dataclass(frozen=True, eq=False)
class _Trial:
    """A hypothesis beside the causes found before, and what remains after it; the `last` of the causes (None: a unit is tried), and
    how probable it is that chance explains as much."""

    causes: tuple[Cause, ...]
    unit: Unit | None
    result: Explained
    last: Cause | None
    chance: float

    @property
    def numbers(self) -> int:
        """How many parameters it adds."""
        return 1 if self.last is None else self.last.numbers

    @property
    def zoom(self) -> tuple[Zoom, float] | None:
        """Another camera constant, where it is what the trial adds, with its share."""
        return (self.last, float(self.result.parameters[-1])) if isinstance(self.last, Zoom) else None


def causes_of(block: RigidBlock, told: Told, groups: Groups, origin: np.ndarray) -> Findings:
    """The causes that explain the contradictions of the sources best; none where chance explains them. `origin` (3,) of local
    coordinates, which units do not scale."""
    before = now = explained(block, told)
    causes: tuple[Cause, ...] = ()
    unit: Unit | None = None
    zooms: list[tuple[Zoom, float]] = []
    for _ in range(SEVERAL):
        trials = list(_trials(block, told, groups, origin, now, causes, unit))
        found = [trial for trial in trials if trial.chance * len(trials) < CHANCE and _matters(block, groups, trial)]
        if not found:
            break
        count = len(now.has.y)
        best = min(found, key=lambda trial: _cost(trial, count))
        zooms += [other.zoom for other in trials if other.zoom and _rivals(other, best, now)]
        causes, unit, now = best.causes, best.unit, best.result
        causes, now = _needed(block, told if unit is None else _in_metres(told, unit, origin), causes, now)
    return Findings(causes, unit, before, now, told if unit is None else _in_metres(told, unit, origin), tuple(zooms))


def _rivals(other: _Trial, best: _Trial, now: Explained) -> bool:
    """Whether another trial of the same photographs explains at least half of what the best does."""
    photos = [trial.last.photos for trial in (other, best) if isinstance(trial.last, Offset | Zoom)]
    gains = [now.misfit - trial.result.misfit for trial in (other, best)]
    return len(photos) == 2 and bool((photos[0] == photos[1]).all()) and gains[0] > 0.5 * gains[1]


def _cost(trial: _Trial, equations: int) -> float:
    """What speaks against a trial: what it leaves unexplained, and how many numbers it takes."""
    return trial.result.misfit + trial.numbers * float(np.log(equations)) + ALIKE * (trial.zoom is not None)


def _needed(block: RigidBlock, told: Told, causes: tuple[Cause, ...], now: Explained) -> tuple[tuple[Cause, ...], Explained]:
    """The causes without those that later ones have made superfluous."""
    for cause in causes[:-1]:
        fewer = tuple(other for other in causes if other is not cause)
        without = explained(block, told, fewer, now)
        if without.misfit - now.misfit < NEEDED:
            causes, now = fewer, without
    return causes, now


def _in_metres(told: Told, unit: Unit, origin: np.ndarray) -> Told:
    """`Unit.applied` to coordinates less their origin."""
    whole = unit.applied(replace(told, control=told.control + origin))
    return replace(whole, control=whole.control - origin)


def _trials(
    block: RigidBlock, told: Told, groups: Groups, origin: np.ndarray, now: Explained, causes: tuple[Cause, ...], unit: Unit | None
) -> Iterator[_Trial]:
    has_control = bool((now.has.source == Source.CONTROL).any())
    own = told if unit is None else _in_metres(told, unit, origin)
    of_all: tuple[Cause, ...] = (*_bends(told, causes), *_plan_scales(block, causes))
    for cause in (*_of_photographs(told, groups, now, causes, has_control), *of_all):
        yield _trial(now, explained(block, own, (*causes, cause), now), (*causes, cause), unit, cause)
    if has_control and unit is None:
        for name, heights_only in ((name, heights) for name in UNITS for heights in (True, False)):
            other = Unit(name, heights_only)
            yield _trial(now, explained(block, _in_metres(told, other, origin), causes), causes, other, None)


def _bends(told: Told, causes: tuple[Cause, ...]) -> tuple[Bend, ...]:
    enough = told.positioned.sum() >= FEWEST_BENT and not any(isinstance(cause, Bend) for cause in causes)
    return (Bend(),) if enough else ()


def _plan_scales(block: RigidBlock, causes: tuple[Cause, ...]) -> tuple[PlanScale, ...]:
    points = np.isfinite(block.control).all(axis=1).sum()
    return (PlanScale(),) if points >= LEAST and not any(isinstance(cause, PlanScale) for cause in causes) else ()


def _trial(now: Explained, then: Explained, causes: tuple[Cause, ...], unit: Unit | None, cause: Cause | None) -> _Trial:
    return _Trial(causes, unit, then, cause, _chance(now, then, cause))


def _chance(now: Explained, then: Explained, cause: Cause | None) -> float:
    """How probable it is that chance explains as much as a cause (None: a unit)."""
    gain, stated = max(now.misfit - then.misfit, 0.0), now.stated - then.stated
    numbers = 1 if cause is None else cause.numbers
    if cause is None or (isinstance(cause, Offset) and cause.photos.all()):
        return float(chdtrc(numbers, gain))
    if stated > 0.5 * gain:
        return float(chdtrc(numbers, min(stated, gain)))
    # The scatter of the positions is estimated from themselves: few of them show little.
    height = int((now.has.source == Source.HEIGHT).sum())
    count = height - 3 if numbers == 1 else 3 * height - 7
    left = count - numbers
    if left < 1:
        return 1.0
    ratio = np.expm1(min(gain / count, 500.0)) * left / numbers
    return float(fdtrc(numbers, left, ratio))


def _of_photographs(
    told: Told, groups: Groups, now: Explained, causes: tuple[Cause, ...], has_control: bool
) -> Iterator[Offset | Zoom]:
    """The constant errors of positions, and other camera constants, that are tried beside the causes found already."""
    has, known = told.positioned, [cause.photos for cause in causes if isinstance(cause, Offset | Zoom)]
    masks = [has] if has_control else []
    masks += list(_flights(groups, has)) + list(_ranges(groups, has, now))
    tried: list[np.ndarray] = []
    for mask in masks:
        if not mask.any() or any((mask == other).all() for other in (*tried, *known)):
            continue
        tried.append(mask)
        everything = bool((mask == has).all())
        for axes in ((2,), (0, 1, 2)):
            yield Offset(np.ones_like(mask) if everything else mask, axes)
        # Positions that agree to decimetres show camera constants; that of all photographs is one of the sources.
        if not everything and mask.sum() >= LEAST:
            yield Zoom(mask)


def _flights(groups: Groups, has: np.ndarray) -> Iterator[np.ndarray]:
    numbers = np.unique(groups.flight[has])
    if len(numbers) > 1:
        # The largest one keeps its place: without control, offsets are those against the others.
        largest = max(numbers, key=lambda number: ((groups.flight == number) & has).sum())
        yield from ((groups.flight == number) & has for number in numbers if number != largest)


def _ranges(groups: Groups, has: np.ndarray, now: Explained) -> Iterator[np.ndarray]:
    """Photographs between two jumps of the positions in the order of exposure."""
    order = groups.order[has[groups.order]]
    if len(order) < 2 * LEAST:
        return
    breaks = np.sort(_jumps(order, now))
    for first, end in combinations(np.unique([0, *breaks, len(order)]), 2):
        if first == 0 and end == len(order):
            continue
        inside = np.zeros(len(has), bool)
        inside[order[first:end]] = True
        # An offset of one part is that of the other with another sign: told of the smaller one, or of the later.
        if 2 * inside.sum() > len(order) or (2 * inside.sum() == len(order) and first == 0):
            inside = has & ~inside
        if inside.sum() >= LEAST:
            yield inside


def _jumps(order: np.ndarray, now: Explained) -> np.ndarray:
    """The places of the largest jumps of the residuals, in height and in plan, from one photograph to the next."""
    residual, axis = np.zeros((order.max() + 1, 3)), now.has.axis
    for part in (Source.PLAN, Source.HEIGHT):
        own = now.has.source == part
        v = now.has.y[own] - now.has.A[own] @ _without_motion(now)
        residual[now.has.photo[own], axis[own]] = v
    jump = np.diff(residual[order], axis=0)
    places = (np.argsort(-size, kind="stable")[:JUMPS] for size in (np.abs(jump[:, 2]), np.hypot(jump[:, 0], jump[:, 1])))
    return 1 + np.union1d(*places)


def _without_motion(now: Explained) -> np.ndarray:
    rest = now.parameters[: now.has.A.shape[1]].copy()
    rest[:7] = 0.0
    return rest


def _matters(block: RigidBlock, groups: Groups, trial: _Trial) -> bool:
    """Whether the last cause of a trial is large enough to be told."""
    cause, result = trial.last, trial.result
    if cause is None:
        return True
    own = slice(-cause.numbers, None)
    size, sigma = np.abs(result.parameters[own]), np.sqrt(np.diag(result.covariance)[own])
    if size.max() < DETERMINED * sigma.max():
        return False
    if isinstance(cause, Bend):
        return bool(size[0] > PIXELS * block.pixel)
    if isinstance(cause, PlanScale):
        away = block.control[np.isfinite(block.control).all(axis=1), :2] - block.middle[:2]
        return bool(size[0] * np.linalg.norm(away, axis=1).max() > PIXELS * block.pixel)
    metres = float(size.max()) * (float(np.median(block.depth[cause.photos])) if isinstance(cause, Zoom) else 1.0)
    if isinstance(cause, Offset) and cause.photos.all():
        return PIXELS * block.pixel < metres < (FARTHEST if cause.numbers > 1 else HIGHEST)
    if metres > FARTHEST:
        return False
    inside = np.unique(groups.flight[cause.photos])
    of_flights = not np.isin(groups.flight[~cause.photos], inside).any()
    part = Source.HEIGHT if cause.numbers == 1 else Source.PLAN
    scatter = result.scale[part] * float(np.median(result.has.sigma[result.has.source == part]))
    least, clear = (PIXELS, 1.0) if of_flights else (UNTOLD_PIXELS, CLEAR)
    return metres > max(least * block.pixel, clear * scatter)
