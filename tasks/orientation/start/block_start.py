"""Approximate exterior orientation of all photographs of a block from tie points and cameras alone.

Strategy: photographs are grouped by their oriented pairs; the largest group grows from its strongest pair (many tie points that
intersect at good angles, see `block_growth`). Photographs that are left are grouped again, until no two are connected: every group
is kept, each in the system of its first photograph and in units of its base; `georeference` transforms them to the ground. Where
approximate exterior orientations are given, the block starts from these. Every photograph that does not join is reported with its
reason.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.orientation import RelativeOrientation, Unoriented
from orthomill.tasks.adjustment.model.network import State
from orthomill.tasks.orientation.start.block_growth import BlockGrowth, Given, GrowthMaterial, from_given, grow

TRUSTED = 0.9
"""A smaller share of measurements that fit makes the camera constants doubtful."""
# The usual mistakes: a focal length for full frame taken for that of a half frame sensor, or photographs reduced to half their
# size. Between them lie the zooms, crops and guesses.
OTHER_CONSTANTS: tuple[tuple[float, tuple[float, ...]], ...] = ((TRUSTED, (0.5, 2.0)), (0.8, (0.7, 0.85, 1.2, 1.4)))
"""Factors of the camera constants that are tried where a smaller share of measurements than stated before them fits. Wrong matches
alone leave four of five measurements right, a constant that is off by a fifth two of three."""
BETTER, LEFT = 1.1, 0.5
"""Other constants are used where the measurements that fit increase by the first factor, or those that do not fit fall to the
second."""


@dataclass(frozen=True, eq=False)
class BlockStart:
    """A model of the block in a system of its own: `photos` (p,) numbers of those that joined (the arrays of the state hold all
    photos; rows of the others are undefined), `known` (N,) bool points, `good` (M,) bool rays."""

    state: State
    photos: np.ndarray
    known: np.ndarray
    good: np.ndarray


def without_photo(start: BlockStart, photo: int) -> BlockStart:
    """The start without a photograph; its rays are skipped wherever `photos` is respected."""
    return replace(start, photos=start.photos[start.photos != photo])


Blocks = tuple[list[BlockStart], tuple[Unoriented, ...]]


def start_blocks(material: GrowthMaterial, given: Given | None = None) -> Blocks:
    """All groups of photographs, the largest first, each oriented in a system of its own (that of `given` for the group started
    from it), and the photographs that are in none. Where many measurements do not fit, camera constants from half to twice as large
    are tried, and kept where far more fits. Raises GeometryError when no two photographs can be oriented."""
    # A wrong camera constant may leave no block at all: the failure is raised only when the other constants fail as well.
    try:
        best, failure = _blocks(material, given), None
    except GeometryError as error:
        best, failure = None, error
    # A given start has its own constants; without one, a wrong constant shows in the share of measurements that fit nowhere.
    for enough, factors in OTHER_CONSTANTS if given is None else ():
        if _believed(material, best) >= enough:
            break
        for factor in factors:
            other = _tried(material, factor)
            if _fits_better(_believed(material, other), _believed(material, best)):
                best = other
    if best is None:
        raise failure or GeometryError(_no_block(material))
    return best


def start_with(material: GrowthMaterial, constants: np.ndarray, given: Given | None = None) -> Blocks:
    """As `start_blocks` with camera constants (C,) px instead of the given ones; no others are tried."""
    value = material.interior.value.copy()
    value[:, 0] = constants
    return _blocks(replace(material, interior=replace(material.interior, value=value)), given)


def _tried(material: GrowthMaterial, factor: float) -> Blocks | None:
    """The blocks with camera constants multiplied by `factor`; None without any."""
    try:
        return start_with(material, factor * material.interior.value[:, 0])
    except GeometryError:
        return None


def _fits_better(other: float, best: float) -> bool:
    """Compares the shares of measurements that fit."""
    return other > BETTER * best or 1.0 - other < LEFT * (1.0 - best)


def _believed(material: GrowthMaterial, blocks: Blocks | None) -> float:
    """The share of all measurements that fit."""
    if blocks is None:
        return 0.0
    rays, good = material.rays, np.zeros(len(material.rays), bool)
    for start in blocks[0]:
        good |= start.good & start.known[rays.point] & np.isin(rays.photo, start.photos)
    return float(good.mean())


def _blocks(material: GrowthMaterial, given: Given | None) -> Blocks:
    """All groups with the camera constants of `material`. Raises GeometryError when there is none."""
    twice = _given_twice(material)
    free = np.ones(len(material.names), bool)
    # Groups that failed are remembered by their members: a later growth may join some of them to another group.
    found: list[BlockGrowth] = []
    last: BlockGrowth | None = None
    free[list(twice)] = False
    if given is not None and given.known.sum() >= 2:
        last = from_given(material, given)
        found, free = [last], free & ~last.placed
    tried: set[int] = set()
    while (group := _next_group(material, free, tried)) is not None:
        growth = _best_growth(material, group, free)
        if growth is None:
            tried.update(int(photo) for photo in group)
            continue
        found.append(growth)
        last = last or growth
        free &= ~growth.placed
    if last is None:
        raise GeometryError(_no_block(material))
    starts = [BlockStart(g.state, np.flatnonzero(g.placed), g.known, g.good) for g in sorted(found, key=lambda g: -g.placed.sum())]
    copies = tuple(Unoriented(photo=material.names[photo], reason=reason) for photo, reason in sorted(twice.items()))
    return starts, (*copies, *_reasons(material, last, np.flatnonzero(free)))


def _given_twice(material: GrowthMaterial) -> dict[int, str]:
    """Photographs that are copies of others, with the sentence; the first of several copies stays."""
    # Two copies share all their points without parallax, and count every measurement twice in the adjustment.
    number = {name: i for i, name in enumerate(material.names)}
    found: dict[int, str] = {}
    for pair in sorted((p for p in material.relative if p.same_photo), key=lambda p: (number[p.left], number[p.right])):
        if number[pair.left] not in found:
            found.setdefault(number[pair.right], pair.outcome)
    return found


def _next_group(material: GrowthMaterial, free: np.ndarray, tried: set[int]) -> np.ndarray | None:
    """The largest group of two or more `free` photographs, other than the groups that failed before."""
    groups = [group for group in _groups(material, free) if len(group) >= 2 and not tried.issuperset(map(int, group))]
    return groups[0] if groups else None


def _no_block(material: GrowthMaterial) -> str:
    """Why there is no block at all."""
    groups = _groups(material, np.ones(len(material.names), bool))
    if not groups or len(groups[0]) < 2:
        return "No two photographs could be oriented to each other, so there is no block; " + _best_failure(material)
    return (
        "No pair of photographs gives points that intersect well enough to begin a block; the photographs may have been taken "
        "from one place, their tie points may be wrong, or the camera constant may be far from the truth."
    )


def _best_growth(material: GrowthMaterial, group: np.ndarray, free: np.ndarray) -> BlockGrowth | None:
    """The growth among the `free` photographs that places most of them; the search ends when the whole group is placed."""
    best = None
    for seed in _seeds(material, group):
        growth = grow(material, seed, free)
        if growth is not None and (best is None or growth.placed.sum() > best.placed.sum()):
            best = growth
        if best is not None and best.placed[group].all():
            break
    return best


def _best_failure(material: GrowthMaterial) -> str:
    if not material.relative:
        return "none of them share enough tie points: give photographs that overlap by half or more."
    best = max(material.relative, key=lambda pair: pair.matches)
    return f"of the pair with most matches is known: {best.outcome}"


def _groups(material: GrowthMaterial, free: np.ndarray) -> list[np.ndarray]:
    """The `free` photographs connected by oriented pairs, the largest group first."""
    pairs = [pair for pair in _oriented_pairs(material) if free[pair[0]] and free[pair[1]]]
    graph = csr_array((np.ones(len(pairs)), ([i for i, _, _ in pairs], [j for _, j, _ in pairs])), shape=(len(material.names),) * 2)
    _, label = connected_components(graph, directed=False)
    groups = [np.flatnonzero((label == k) & free) for k in np.unique(label[free])]
    return sorted(groups, key=lambda group: -len(group))


def _oriented_pairs(material: GrowthMaterial) -> list[tuple[int, int, RelativeOrientation]]:
    number = {name: i for i, name in enumerate(material.names)}
    return [(number[pair.left], number[pair.right], pair) for pair in material.relative if pair.oriented]


def _seeds(material: GrowthMaterial, group: np.ndarray) -> list[tuple[int, int, RelativeOrientation]]:
    """Up to three pairs to start from: many kept matches, rays that intersect at 6 degrees or more."""
    # Neighbours have most matches but the worst depth: up to 6 degrees the angle counts as much as the number.
    inside = [pair for pair in _oriented_pairs(material) if pair[0] in group and pair[1] in group]
    return sorted(inside, key=lambda pair: -pair[2].kept * min(pair[2].intersection_deg / 6.0, 1.0))[:3]


def _reasons(material: GrowthMaterial, growth: BlockGrowth, left: np.ndarray) -> Iterator[Unoriented]:
    """One sentence for every photograph that is `left` out of all groups."""
    for photo in left:
        yield Unoriented(photo=material.names[photo], reason=_reason(material, growth, int(photo)))


def _reason(material: GrowthMaterial, growth: BlockGrowth, photo: int) -> str:
    """Why a photograph is in no group: by its tie points, its pairs, or its resection."""
    name = material.names[photo]
    if not (material.rays.photo == photo).any():
        return (
            f"{name} has no tie points: it overlaps no other photograph, has too little texture, or repeats another one, which the "
            "report of the tie points then names."
        )
    own = [pair for pair in material.relative if name in (pair.left, pair.right)]
    if not any(pair.oriented for pair in own):
        best = max(own, key=lambda pair: pair.matches, default=None)
        if best is None:
            return f"{name} shares too few tie points with any other photograph; its overlap is too small."
        other = best.right if best.left == name else best.left
        return f"{name} could not be oriented to any other photograph (best: {other}): {best.outcome}"
    return f"{name} did not join the block: {growth.attempts.get(photo, 'its resection failed')}. More overlap would tie it."
