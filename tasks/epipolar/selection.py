"""Which pairs of a block are worth matching.

Strategy. Every two photographs whose footprints meet on the mean ground are judged by overlap, base over height, convergence and
scale. What passes is taken in order of score (overlap times base over height: ground covered times precision) until
each photograph has its fill, so that the number of pairs grows with the number of photographs. A photograph whose neighbours are
all full still gets its best pair.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.epipolar import EpipolarPair, EpipolarPairs
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.orientation import Block
from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.epipolar.height_precision import height_sigmas
from orthomill.tasks.epipolar.row_precision import row_sigma
from orthomill.tasks.geometry.normal_case import (
    HeightRange,
    border_pixels,
    common_polygon,
    convex,
    in_order,
    normal_case,
    polygon_area,
)
from orthomill.tasks.geometry.view import View, block_view


class PairChoice(Settings):
    """When a pair of photographs is useful."""

    overlap: float = setting(0.25, "Least common ground of a pair, as a share of the smaller footprint.", gt=0, le=1)
    base_height_low: float = setting(0.1, "Least base over flying height; flatter intersections give poor heights.", gt=0)
    base_height_high: float = setting(1.2, "Greatest base over flying height; steeper views differ too much to be matched.", gt=0)
    convergence: float = setting(40.0, "Greatest angle between the viewing directions.", "degrees", gt=0, le=90)
    scale: float = setting(1.6, "Greatest ratio of the ground pixel sizes of the two photographs.", ge=1)
    per_photo: int = setting(4, "Pairs that a photograph takes part in, at most; the best are taken first.", ge=1)


_MOST_ROOM = 0.35
"""share of the flying height; what stands higher is hardly seen by two photographs"""


@dataclass(frozen=True)
class Candidate:
    """Two photographs, by number in the block, with what their pair would give."""

    first: int
    second: int
    overlap: float
    base_height: float
    convergence: float
    scale: float

    @property
    def score(self) -> float:
        return self.overlap * self.base_height


@dataclass(frozen=True, eq=False)
class Footprint:
    """The ground at mean height that a photograph shows."""

    polygon: np.ndarray
    """(N, 2) m, about `origin`"""
    area: float
    pixel: float
    """m, at the middle of the photograph"""


def block_heights(block: Block, margin: float, room: float = 0.0) -> HeightRange:
    """The heights that a pair must see: those of the block, widened by `margin` of the mean flying height, and upwards by
    `room` (m) where that is more, but never so that it comes near the camera."""
    flying = abs(float(np.mean([photo.centre[2] for photo in block.photos]) - (block.ground_low + block.ground_high) / 2))
    spare = margin * flying
    return HeightRange(block.ground_low - spare, block.ground_high + max(spare, min(room, _MOST_ROOM * flying)))


def choose_pairs(block: Block, choice: PairChoice, height_margin: float, height_room: float = 0.0) -> EpipolarPairs:
    """The epipolar geometry of every useful pair, and why others are not used.

    `height_margin` widens the block's heights, as a share of the flying height; `height_room` (m) upwards. Raises GeometryError
    when no pair is useful.
    """
    heights = block_heights(block, height_margin, height_room)
    views = [block_view(block, name) for name in block.names]
    found = candidates(views, heights.mean)
    useful = [c for c in found if not why_not(c, choice)]
    kept = best_pairs(useful, choice.per_photo)
    refused = [
        (view.name, "shows the horizon; a surface is measured in photographs that look down")
        for view in views
        if np.isnan(view.at_height(border_pixels(view), heights.mean)).any()
    ]
    refused += [
        (_name(views, c), why_not(c, choice) or f"one of the photos already has {choice.per_photo} better pairs")
        for c in found
        if c not in kept
    ]
    pairs = []
    for c in kept:
        try:
            pairs.append(_pair(block, views, c, heights))
        except GeometryError as error:
            refused.append((_name(views, c), str(error)))
    if not pairs:
        raise GeometryError(_no_pair(block, found, refused))
    return EpipolarPairs(pairs=tuple(sorted(pairs, key=lambda p: p.name)), not_used=tuple(sorted(refused)))


def candidates(views: list[View], z: float) -> list[Candidate]:
    """All pairs whose footprints meet at height `z` (m), in order of the photographs; none with a photograph that shows the
    horizon."""
    origin = np.mean([view.centre for view in views], axis=0)[:2]
    prints = [footprint(view, z, origin) for view in views]
    nowhere = np.full((1, 2), np.nan)
    polygons = [nowhere if p is None else p.polygon for p in prints]
    low, high = (np.array([extreme(polygon, axis=0) for polygon in polygons]) for extreme in (np.min, np.max))
    found = []
    for i in range(len(views)):
        near = np.flatnonzero((low[i + 1 :] < high[i]).all(axis=1) & (high[i + 1 :] > low[i]).all(axis=1)) + i + 1
        for j in near:
            common = polygon_area(common_polygon(polygons[i], polygons[j]))
            if common > 0:
                found.append(_candidate((i, int(j)), (views[i], views[j]), (prints[i], prints[j]), common))
    return found


def footprint(view: View, z: float, origin: np.ndarray) -> Footprint | None:
    """The ground of a photograph at height `z` (m); None when a part of it looks over the horizon."""
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
    """The reason why a pair is not useful, as a few words; None when it is."""
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


def best_pairs(useful: list[Candidate], per_photo: int) -> list[Candidate]:
    """The pairs by falling score, so that no photograph has more than `per_photo`, but each that can have one has one."""
    ordered = sorted(useful, key=lambda c: (-round(c.score, 3), c.first, c.second))
    count: dict[int, int] = {}
    kept = [c for c in ordered if _take(c, count, per_photo)]
    for c in ordered:
        if c not in kept and not (count.get(c.first) and count.get(c.second)):
            count[c.first], count[c.second] = count.get(c.first, 0) + 1, count.get(c.second, 0) + 1
            kept.append(c)
    return kept


def _take(candidate: Candidate, count: dict[int, int], limit: int) -> bool:
    both = candidate.first, candidate.second
    if any(count.get(photo, 0) >= limit for photo in both):
        return False
    for photo in both:
        count[photo] = count.get(photo, 0) + 1
    return True


def _pair(block: Block, views: list[View], candidate: Candidate, heights: HeightRange) -> EpipolarPair:
    left, right = in_order(views[candidate.first], views[candidate.second])
    pair = normal_case(left, right, heights)
    return pair.model_copy(update={"row_sigma": row_sigma(pair, block), "height_sigmas": height_sigmas(pair, block)})


def _name(views: list[View], candidate: Candidate) -> str:
    left, right = in_order(views[candidate.first], views[candidate.second])
    return f"{left.name}-{right.name}"


def _no_pair(block: Block, found: list[Candidate], refused: list[tuple[str, str]]) -> str:
    if not found and refused:
        return "No pair of photographs is useful for matching: " + "; ".join(f"{name} {why}" for name, why in refused[:5]) + "."
    if not found:
        return f"None of the {len(block.photos)} oriented photographs share ground; a surface needs overlapping photographs."
    return "No pair of photographs is useful for matching: " + "; ".join(f"{name}: {reason}" for name, reason in refused[:5]) + "."
