"""Tie points by region growing on raw photographs, whose orientation nobody knows.

Strategy. Seeds are features that both photographs agree on, with the turn and the scale between them, or the points of a list.
From these growth matches the nodes of a regular grid on the searched level by least squares, free in both directions; a node that
fewer than two neighbours predict is left out. What has grown tells of every feature of the left photograph where it lies in the
right one: it is assigned to the feature at that place, so that tracks continue to further photographs. Turned photographs and other
scales are followed by the affine parameters of each match.

Source: Otto & Chau 1989; Skarlatos (sources/matching.md#region-growing).
"""

import csv

import numpy as np
from scipy.spatial import cKDTree

from orthomill.schemas.camera import Cameras
from orthomill.schemas.errors import WorkflowError
from orthomill.tasks.imagery.pyramid import full_to_level
from orthomill.tasks.imagery.radiometry import grey_range, real_grey
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching
from orthomill.tasks.matching.least_squares.matching import Matches
from orthomill.tasks.matching.strategies.growing_settings import RegionGrowing
from orthomill.tasks.matching.strategies.node_grid import ImagePart, NodeGrid
from orthomill.tasks.matching.strategies.region_growing import Seeds, grow
from orthomill.tasks.tie_points.correlation_search import joined
from orthomill.tasks.tie_points.descriptor_search import mutual_matches
from orthomill.tasks.tie_points.match_records import DESCRIPTOR, Features, MatchedPair, Values
from orthomill.tasks.tie_points.pair_matching import PairRules, PhotoPair, accepted_matches
from orthomill.tasks.tie_points.search_settings import GrowingSearch

SEED_COLUMNS = ("left", "left_col", "left_row", "right", "right_col", "right_row")
_CROSSINGS = 8
"""how often growth enters regions without seeds from their neighbours"""
_NEIGHBOURS = 2
"""that must predict a node: chance has none"""
_REACH = 1.5
"""steps from a node that was matched to a feature of which it tells"""


def growth_of(window: int) -> RegionGrowing:
    """How regions grow in photographs of which nothing is known; window: px along a side."""
    matching = LeastSquaresMatching(window=window, smoothing=0.6, max_shift=2.0)
    return RegionGrowing(crossings=_CROSSINGS, min_neighbours=_NEIGHBOURS, matching=matching)


def feature_seeds(left: tuple[Features, np.ndarray], right: tuple[Features, np.ndarray], ratio: float) -> Seeds:
    """Points that features of both photographs agree on, px of the photographs, with the turn and the scale between them; each
    side: features and descriptors (N, 128)."""
    (here, first), (there, second) = left, right
    one, other = mutual_matches(first, second, ratio).T
    turn = np.radians(there.angle[other].astype(np.float64) - here.angle[one])
    scale = there.size[other].astype(np.float64) / here.size[one]
    # Angles run from the columns to the rows, as the affine of a match does.
    affine = np.column_stack([scale * np.cos(turn), -scale * np.sin(turn), scale * np.sin(turn), scale * np.cos(turn)])
    return Seeds(np.column_stack([here.col[one], here.row[one]]), np.column_stack([there.col[other], there.row[other]]), affine)


def listed_seeds(text: str, names: tuple[str, str]) -> Seeds:
    """The seeds of a list for two photographs, px. Raises WorkflowError for one that cannot be read."""
    rows = list(csv.DictReader(text.lstrip("\ufeff").splitlines()))
    points = []
    for number, row in enumerate(rows, start=2):
        try:
            here, there = ((row[side], float(row[f"{side}_col"]), float(row[f"{side}_row"])) for side in ("left", "right"))
        except (KeyError, TypeError, ValueError) as error:
            raise WorkflowError(
                f"The seeds, line {number}, cannot be read ({error}): give the columns {', '.join(SEED_COLUMNS)}; the "
                "photographs by their names, pixels as numbers."
            ) from error
        for one, other in ((here, there), (there, here)):
            if (one[0], other[0]) == names:
                points.append((*one[1:], *other[1:]))
    table = np.array(points, np.float64).reshape(-1, 4)
    return Seeds(table[:, :2], table[:, 2:])


def grow_pair(
    left: tuple[Features, Values],
    right: tuple[Features, Values],
    pixels: tuple[np.ndarray, np.ndarray],
    cameras: Cameras,
    names: tuple[str, str],
    levels: tuple[int, int],
    rules: PairRules,
    search: GrowingSearch,
    seeds: str | None = None,
) -> MatchedPair:
    """Matches of two photographs and their summary, as from descriptors. pixels: the complete searched levels of both; seeds: the
    text of a list. Raises WorkflowError for a list that cannot be read."""
    here, there = ((features, values.rows(DESCRIPTOR)) for features, values in (left, right))
    start = feature_seeds(here, there, rules.ratio) if seeds is None else listed_seeds(seeds, names)
    pairs = np.zeros((0, 2), dtype=np.int64)
    if len(start.points) and len(left[0]) and len(right[0]):
        found = _grown(pixels, _of_levels(start, levels), search)
        places = [
            full_to_level(np.column_stack([one[0].col, one[0].row]), lv) for one, lv in zip((left, right), levels, strict=True)
        ]
        partners, known = _told(found, places[0], search.step)
        pairs = joined(partners, known, places[1])
    return accepted_matches((left[0], right[0]), pairs, PhotoPair.of(cameras, names), rules)


def _of_levels(seeds: Seeds, levels: tuple[int, int]) -> Seeds:
    """Seeds of the photographs as seeds of pyramid levels."""
    here, there = (full_to_level(points, level) for points, level in zip((seeds.points, seeds.right), levels, strict=True))
    wider = 2.0 ** (levels[0] - levels[1])
    affine = np.tile([1.0, 0.0, 0.0, 1.0], (len(here), 1)) if seeds.affine is None else np.asarray(seeds.affine)
    return Seeds(here, there, affine * wider)


def _grown(pixels: tuple[np.ndarray, np.ndarray], seeds: Seeds, search: GrowingSearch) -> Matches:
    # 0 means "no data" to the matching.
    left, right = (ImagePart(np.ascontiguousarray(real_grey(one, grey_range(one)))) for one in pixels)
    return grow(left, right, NodeGrid.within(left, search.step, search.window // 2 + 2), seeds, growth_of(search.window))


def _told(found: Matches, places: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray]:
    """Where the nearest grown node puts places (N, 2) of the left photograph, and (N,) bool where one is near."""
    good = np.flatnonzero(found.converged)
    if not len(good):
        return np.zeros_like(places), np.zeros(len(places), bool)
    distance, number = cKDTree(found.reference[good]).query(places, distance_upper_bound=_REACH * step)
    known = np.isfinite(distance)
    node = good[np.where(known, number, 0)]
    off = places - found.reference[node]
    affine = found.affine[node].astype(np.float64).reshape(-1, 2, 2)
    return found.position[node] + np.einsum("nij,nj->ni", affine, off), known
