"""Selection of the pairs of a block that are worth matching.

Strategy. Every two photographs whose footprints overlap on the mean ground are judged by overlap, base over height, convergence and
scale. Of those that pass, each photograph first gets its nearest neighbours: short bases see woods, walls and water alike, and what
they see is complete. Neighbours are pairs with no third photograph between them, so that they lie in different directions: before
and behind along the strip, where that is denser than the strips. The other half of a photograph's pairs are taken in order of score
(overlap times base over height: ground covered times precision), as long as a good part of their ground lies under few pairs: where
every place is in ten photographs, further pairs cost time and tell nothing new. The number of pairs thus grows linearly with the
number of photographs. A photograph whose neighbours have all their pairs already still gets its best one.

Source of the neighbours: Toussaint 1980, The relative neighbourhood graph of a finite planar set.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.epipolar import EpipolarPair, EpipolarPairs
from orthomill.schemas.errors import GeometryError, some_of
from orthomill.schemas.orientation import Area, Block
from orthomill.tasks.epipolar.area_cut import cut_to
from orthomill.tasks.epipolar.height_precision import height_sigmas
from orthomill.tasks.epipolar.pair_choice import PairChoice
from orthomill.tasks.epipolar.row_precision import row_sigma
from orthomill.tasks.geometry.normal_case import (
    HeightRange,
    border_pixels,
    common_polygon,
    convex,
    corner_rays,
    in_order,
    normal_case,
    polygon_area,
)
from orthomill.tasks.geometry.view import View, block_view

_NEEDY_SHARE = 0.25
"""share of a pair's ground that has to lie under too few pairs; less is a fringe that the next pair along the strip sees as well"""
_COARSE = 3.0
"""times the distance of the nearest ground that a photograph shows: what lies farther away is no place for which pairs compete"""
_PLACES_ACROSS = 10
"""places across a footprint: coverage is counted to a tenth of a photograph"""
Places = frozenset[tuple[int, int]]
"""places of a regular grid on the ground, by row and column"""
_LEAST_DIP = 0.087
"""sine of 5 degrees below the horizon: the ground of flatter rays lies more than eleven flying heights away"""
_HORIZON = "shows the horizon"
_UPRIGHT = (
    "A surface on the map is measured in photographs that look down. A wall or a row of houses gets its own with "
    "grid: {kind: plane} in the stage densification, an object from all sides a mesh (docs/guide.md)."
)
_NAMED = 5
"""photographs or pairs that are named with the reason that they share"""
_MOST_STRETCH = 4.0
"""times the pixels of photographs: epipolar images whose sides are twice as long hold no more than these, and cost as much"""
_GREATEST_ROOM = 0.35
"""share of the flying height; higher objects are rarely visible in two photographs, and the parallax range would explode"""


@dataclass(frozen=True)
class Candidate:
    """Two photographs, by number in the block, and the geometry of their pair."""

    first: int
    second: int
    overlap: float
    base_height: float
    convergence: float
    scale: float

    @property
    def score(self) -> float:
        """What pairs are ordered by: much overlap and a wide base."""
        return self.overlap * self.base_height


@dataclass(frozen=True, eq=False)
class Footprint:
    """The ground that a photograph shows at the mean height."""

    polygon: np.ndarray
    """(N, 2) m, relative to `origin`"""
    area: float
    pixel: float
    """m, mean ground pixel"""


def block_heights(block: Block, margin: float, room: float = 0.0) -> HeightRange:
    """The heights that a pair must cover: those of the block, extended by `margin` of the mean flying height, and upwards by `room`
    (m) where that is more, up to a limit well below the camera."""
    # Tie points lie mostly on the ground. Room for crowns and roofs is given in metres, because trees do not grow with the
    # flying height; the limit keeps drone flights at 30 m from asking for parallaxes up to the camera.
    flying = abs(float(np.mean([photo.centre[2] for photo in block.photos]) - block.ground_mean))
    spare = margin * flying
    return HeightRange(block.ground_low - spare, block.ground_high + max(spare, min(room, _GREATEST_ROOM * flying)))


def choose_pairs(
    block: Block, choice: PairChoice, height_margin: float, height_room: float = 0.0, level: int = 0, area: Area | None = None
) -> EpipolarPairs:
    """The epipolar geometry of every useful pair on pyramid level `level`, and the reasons why others are not used.

    `height_margin` extends the block's heights, as a share of the flying height, `height_room` (m) upwards. The images
    of pairs are cut to `area` (m), and pairs that see nothing of it are not used. Raises GeometryError when no pair is useful.
    """
    heights = block_heights(block, height_margin, height_room)
    views = [block_view(block, name) for name in block.names]
    found = candidates(views, heights.mean)
    centres = np.array([view.centre for view in views])
    places, wanted = seen_places(views, heights.mean), (level, area)
    made: dict[Candidate, EpipolarPair] = {}
    unfit: dict[Candidate, str] = {}
    useful = [c for c in found if not why_not(c, choice)]
    # What cannot be made has its place taken by the next best, until all that are chosen can be made.
    while True:
        kept, before = best_pairs([c for c in useful if c not in unfit], centres, places, choice), len(unfit)
        for c in kept:
            if c not in made:
                try:
                    made[c] = _pair(block, views, c, heights, wanted)
                except GeometryError as error:
                    unfit[c] = str(error)
        if len(unfit) == before:
            break
    # First those that could not be made: they are the reason if no pair is left.
    refused = [(_name(views, c), unfit[c]) for c in found if c in unfit]
    refused += [*_horizons(views, heights.mean), *_refused(views, [c for c in found if c not in unfit], kept, choice)]
    if not kept:
        raise GeometryError(_no_pair(block, found, refused))
    pairs = [made[c] for c in kept]
    # In order of name: the order of the photographs in the block must not decide the order of jobs and fusion.
    ordered = tuple(sorted(pairs, key=lambda p: p.name))
    return EpipolarPairs(pairs=ordered, not_used=tuple(sorted(refused)), heights=(heights.low, heights.high))


def _horizons(views: list[View], z: float) -> list[tuple[str, str]]:
    """Photographs without a footprint at height `z` (m), with the reason."""
    return [(view.name, _HORIZON) for view in views if np.isnan(view.at_height(border_pixels(view), z)).any()]


def _refused(views: list[View], found: list[Candidate], kept: list[Candidate], choice: PairChoice) -> list[tuple[str, str]]:
    """Pairs that are not kept, with the reason."""
    count = Counter(number for c in kept for number in (c.first, c.second))
    full = f"one of the photos already has {choice.per_photo} better pairs"
    covered = f"most of its ground lies under {choice.per_place} better pairs"

    def surplus(c: Candidate) -> str:
        return full if max(count[c.first], count[c.second]) >= choice.per_photo else covered

    taken = set(kept)
    return [(_name(views, c), why_not(c, choice) or surplus(c)) for c in found if c not in taken]


def candidates(views: list[View], z: float) -> list[Candidate]:
    """All pairs whose footprints overlap at height `z` (m), in order of the photographs; none with a photograph that shows the
    horizon."""
    prints = footprints(views, z)
    nowhere = np.full((1, 2), np.nan)
    polygons = [nowhere if p is None else p.polygon for p in prints]
    # bounding boxes first: of n^2 / 2 pairs of a large block only the neighbours have their polygons intersected
    low, high = (np.array([extreme(polygon, axis=0) for polygon in polygons]) for extreme in (np.min, np.max))
    found = []
    for i in range(len(views)):
        near = np.flatnonzero((low[i + 1 :] < high[i]).all(axis=1) & (high[i + 1 :] > low[i]).all(axis=1)) + i + 1
        for j in map(int, near):
            first, second = prints[i], prints[j]
            common = polygon_area(common_polygon(polygons[i], polygons[j]))
            if first and second and common > 0:
                found.append(_candidate((i, j), (views[i], views[j]), (first, second), common))
    return found


def footprints(views: list[View], z: float) -> list[Footprint | None]:
    """The footprint of every photograph at height `z` (m), relative to the middle of the block."""
    # OpenCV intersects polygons in float32, which resolves map coordinates of millions of metres to half a metre only.
    origin = np.mean([view.centre for view in views], axis=0)[:2]
    return [footprint(view, z, origin) for view in views]


def seen_places(views: list[View], z: float) -> list[Places]:
    """The places that every photograph sees at height `z` (m), less those far away; none for one that shows the horizon."""
    prints, origin = footprints(views, z), np.mean([view.centre for view in views], axis=0)
    spacing = min((np.sqrt(p.area) for p in prints if p), default=1.0) / _PLACES_ACROSS
    below = [view.centre - (*origin[:2], z) for view in views]
    return [
        Places() if p is None else _places_in(p.polygon / spacing, *(each / spacing for each in _near(p.polygon, centre)))
        for p, centre in zip(prints, below, strict=True)
    ]


def _near(polygon: np.ndarray, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The box (2,), (2,) m round a photograph, at `centre` (3,) above the ground, in which it shows ground of its `polygon`
    (N, 2) m in pixels not far coarser than its finest: just below the horizon a footprint has no end."""
    above = _inside(polygon, centre[None, :2])[0]
    nearest = 0.0 if above else float(np.linalg.norm(polygon - centre[:2], axis=1).min())
    reach = np.sqrt(max(_COARSE**2 * (nearest**2 + centre[2] ** 2) - centre[2] ** 2, 0.0))
    return centre[:2] - reach, centre[:2] + reach


def _places_in(polygon: np.ndarray, least: np.ndarray, most: np.ndarray) -> Places:
    """The points with whole coordinates in a convex polygon (N, 2), and between `least` and `most` (2,)."""
    low = np.ceil(np.maximum(polygon.min(axis=0), least)).astype(int)
    high = np.floor(np.minimum(polygon.max(axis=0), most)).astype(int)
    cols, rows = (span.ravel() for span in np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True))))
    inside = _inside(polygon, np.column_stack([cols, rows]))
    return Places(zip(rows[inside].tolist(), cols[inside].tolist(), strict=True))


def _inside(polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(M,) bool: points (M, 2) in a convex polygon (N, 2) or on its border."""
    edges, spokes = np.roll(polygon, -1, axis=0) - polygon, points[:, None] - polygon
    turns = edges[:, 0] * spokes[..., 1] - edges[:, 1] * spokes[..., 0]
    return (turns >= 0).all(axis=1) | (turns <= 0).all(axis=1)


def footprint(view: View, z: float, origin: np.ndarray) -> Footprint | None:
    """The ground of a photograph at height `z` (m), relative to `origin` (2,) m; None when a part of it shows the horizon."""
    ground = view.at_height(border_pixels(view), z)
    if np.isnan(ground).any():
        return None
    polygon = convex(ground[:, :2] - origin)
    area = polygon_area(polygon)
    return Footprint(polygon, area, float(np.sqrt(area / (view.camera.width * view.camera.height))))


def _candidate(numbers: tuple[int, int], views: tuple[View, View], prints: tuple[Footprint, Footprint], common: float) -> Candidate:
    first, second = views
    base = second.centre - first.centre
    direction = first.rotation[2] + second.rotation[2]
    direction /= np.linalg.norm(direction)
    # Only the part of the base across the viewing direction intersects rays; one photograph above the other gives no heights.
    across = np.linalg.norm(base - (base @ direction) * direction)
    height = prints[0].pixel * first.camera.c / 2 + prints[1].pixel * second.camera.c / 2
    cosine = np.clip(first.rotation[2] @ second.rotation[2], -1, 1)
    sizes = sorted((prints[0].pixel, prints[1].pixel))
    return Candidate(
        *numbers,
        common / min(prints[0].area, prints[1].area),
        float(across / height),
        float(np.degrees(np.arccos(cosine))),
        sizes[1] / sizes[0],
    )


def why_not(candidate: Candidate, choice: PairChoice) -> str | None:
    """The reason why a pair is not useful, in a few words; None when it is."""
    ratio = candidate.base_height
    tests = (
        (candidate.overlap < choice.overlap, f"overlap of {candidate.overlap:.0%} is below {choice.overlap:.0%}"),
        (ratio < choice.base_height_low, f"base/height of {ratio:.2f} is below {choice.base_height_low}"),
        (ratio > choice.base_height_high, f"base/height of {ratio:.2f} is above {choice.base_height_high}"),
        (
            candidate.convergence > choice.convergence,
            f"viewing directions {candidate.convergence:.0f} degrees apart, more than {choice.convergence:.0f}",
        ),
        (candidate.scale > choice.scale, f"ground pixels differ by a factor {candidate.scale:.1f}, more than {choice.scale}"),
    )
    return next((reason for failed, reason in tests if failed), None)


def best_pairs(useful: list[Candidate], centres: np.ndarray, places: list[Places], choice: PairChoice) -> list[Candidate]:
    """Neighbours up to half of `per_photo`, then the others by falling score where their ground needs them: no photograph in more
    than `per_photo` pairs, but every photograph that can in at least one.

    centres: (N, 3) m, projection centres of all photographs; places: what each of them sees.
    """
    # Rounded, then by number: equal geometry must not be ranked by the last bits of the orientation.
    near = sorted(neighbours(useful, centres), key=lambda c: (round(c.base_height, 3), c.first, c.second))
    wide = sorted(useful, key=lambda c: (-round(c.score, 3), c.first, c.second))
    chosen = ChosenPairs(places)
    for c in near:
        if chosen.most(c) < (choice.per_photo + 1) // 2:
            chosen.add(c)
    for c in wide:
        if c not in chosen and chosen.most(c) < choice.per_photo and chosen.needed(c, choice.per_place):
            chosen.add(c)
    for c in wide:
        if c not in chosen and not (chosen.of_photo[c.first] and chosen.of_photo[c.second]):
            chosen.add(c)
    return chosen.pairs


class ChosenPairs:
    """The pairs taken so far, counted by photograph and by place."""

    def __init__(self, places: list[Places]) -> None:
        self.pairs: list[Candidate] = []
        self._known: set[Candidate] = set()
        self.of_photo: Counter[int] = Counter()
        self._places, self._over = places, Counter[tuple[int, int]]()

    def __contains__(self, c: Candidate) -> bool:
        return c in self._known

    def _ground(self, c: Candidate) -> Places:
        return self._places[c.first] & self._places[c.second]

    def add(self, c: Candidate) -> None:
        """Take a pair."""
        self.pairs.append(c)
        self._known.add(c)
        self.of_photo.update((c.first, c.second))
        self._over.update(self._ground(c))

    def most(self, c: Candidate) -> int:
        """Pairs of the one of its photographs that has more."""
        return max(self.of_photo[c.first], self.of_photo[c.second])

    def needed(self, c: Candidate, enough: int) -> bool:
        """Whether a good part of its ground lies under fewer than `enough` pairs."""
        ground = self._ground(c)
        return sum(self._over[place] < enough for place in ground) >= _NEEDY_SHARE * len(ground)


_NEARER = 0.999
"""ratio of two distances below which one is the shorter: in a regular block the last bits must not decide"""


def neighbours(useful: list[Candidate], centres: np.ndarray) -> list[Candidate]:
    """The useful pairs of which no third photograph is nearer to both than they are to each other; centres: (N, 3) m."""
    partners: dict[int, set[int]] = {}
    for c in useful:
        partners.setdefault(c.first, set()).add(c.second)
        partners.setdefault(c.second, set()).add(c.first)
    return [c for c in useful if not _nearer_to_both(c, centres, partners[c.first] | partners[c.second])]


def _nearer_to_both(c: Candidate, centres: np.ndarray, others: set[int]) -> bool:
    # Only partners of one of the two stand between them: at 90 % overlap the next photograph is too near for a pair, and must not
    # keep the one after it from being the neighbour.
    third = centres[sorted(others - {c.first, c.second})]
    reach = _NEARER * np.linalg.norm(centres[c.first] - centres[c.second])
    distances = (np.linalg.norm(third - centres[number], axis=1) for number in (c.first, c.second))
    return bool(np.any(np.maximum(*distances) < reach))


def _pair(
    block: Block, views: list[View], candidate: Candidate, heights: HeightRange, wanted: tuple[int, Area | None]
) -> EpipolarPair:
    left, right = in_order(views[candidate.first], views[candidate.second])
    level, area = wanted
    pair = normal_case(left, right, heights, level)
    if (size := _stretch(pair, left, right)) > _MOST_STRETCH:
        raise GeometryError(
            f"its base points along the view, so that its epipolar images have {size:.0f} times the pixels of its photographs"
        )
    pair = pair if area is None else cut_to(pair, area, heights)
    if _shows_horizon(pair):
        raise GeometryError("corners of its epipolar images show the horizon, so that its ground has no bounds on the map")
    predicted = row_sigma(pair, block)
    rows = {"row_sigma": predicted, "row_sigma_predicted": predicted}
    return pair.model_copy(update={**rows, "height_sigmas": height_sigmas(pair, block)})


def _stretch(pair: EpipolarPair, left: View, right: View) -> float:
    """Pixels of the epipolar images of a pair, by those of its photographs on their level."""
    photographs = sum(view.camera.width * view.camera.height for view in (left, right)) / 4**pair.level
    return pair.rows * (pair.left_cols + pair.right_cols) / photographs


def _shows_horizon(pair: EpipolarPair) -> bool:
    """Whether the ground of the epipolar images, which are wider than what both photographs show of it, ends nowhere."""
    rays = np.concatenate([corner_rays(pair, "left"), corner_rays(pair, "right")])
    return bool((rays[:, 2] > -_LEAST_DIP * np.linalg.norm(rays, axis=1)).any())


def _name(views: list[View], candidate: Candidate) -> str:
    left, right = in_order(views[candidate.first], views[candidate.second])
    return f"{left.name}-{right.name}"


def _no_pair(block: Block, found: list[Candidate], refused: list[tuple[str, str]]) -> str:
    if not found and not refused:
        return f"None of the {len(block.photos)} oriented photographs share ground; a surface needs overlapping photographs."
    names: dict[str, list[str]] = {}
    for name, reason in refused:
        names.setdefault(reason, []).append(name)
    told = "; ".join(f"{some_of(of_one, _NAMED)}: {reason}" for reason, of_one in names.items())
    # What people do who photograph a wall, or a street, with what is made for the ground.
    advice = f" {_UPRIGHT}" if _HORIZON in names else ""
    return f"No pair of photographs is useful for matching: {told}.{advice}"
