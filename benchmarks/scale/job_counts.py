"""How many jobs a project of another size, or with other tiles, has for each job of a finished run.

Strategy. What a function makes once it makes once. Of the others the plan of the same project with tiles of four times the side
tells what their number goes by: those that stay as many go by photograph (or pair), or by squares of the map that are as large
whatever the tile; those that become fewer go by the tile, of a photograph (or pair) or of the map, of which the last tile is cut.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum, auto

import numpy as np

from orthomill.pipeline.engine.planned.planned_jobs import PlannedJob
from orthomill.pipeline.engine.running import session_of
from orthomill.pipeline.forecast.known_costs import Family, family_of
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow
from orthomill.schemas.job import Export, Raster
from orthomill.schemas.raster import Window

LARGER = 4
"""times the side of a tile that the plan is asked with"""
IN_SHEETS = {"join_contours", "tie_counts"}
"""functions of jobs that a project has for every sheet of some thousand cells: volos is one sheet"""

OF_LEVELS = {"solve_square"}
"""functions of jobs that cover the map several times, level by level; those of others that have several items cover photographs"""
Group = tuple[Family, str]
"""jobs of a kind that have one item: they cover a photograph, a level, or the map"""


class GoesBy(IntEnum):
    """What the number of jobs goes by."""

    ONCE = auto()
    PHOTOGRAPH = auto()
    SQUARE = auto()
    TILE_OF_PHOTOGRAPH = auto()
    TILE_OF_MAP = auto()


@dataclass(frozen=True, eq=False)
class Spread:
    """Of each job (N,): what the number of its kind goes by; how many there are of it side by side; the tiles along its raster,
    whole and parts of one; by how much its own tile is larger in a plan with larger ones, in parts of what it should be: less than
    1 where tiles have a least side, which coarse levels of the map come to."""

    goes: np.ndarray
    beside: np.ndarray
    rows: np.ndarray
    cols: np.ndarray
    follows: np.ndarray

    def numbers(self, larger: float, more: float, coarser: float) -> np.ndarray:
        """(N,) jobs for each one of a project with `larger` times the megapixels in `more` times the photographs, and tiles of
        `coarser` times the side."""
        found = np.ones(len(self.goes))
        found[self.goes == GoesBy.PHOTOGRAPH] = more
        found[self.goes == GoesBy.SQUARE] = larger
        tiles = ((GoesBy.TILE_OF_PHOTOGRAPH, more), (GoesBy.TILE_OF_MAP, 1.0))
        coarse = np.where(self.follows < 1.0, np.maximum(coarser * self.follows, 1.0), coarser)
        for kind, times in tiles:
            mine = self.goes == kind
            side = np.sqrt(larger / times) / coarse[mine]
            # Rounded before: three tiles are three, whatever the square root leaves of them.
            rows, cols = (np.ceil(np.round(along[mine] * side, 6)) for along in (self.rows, self.cols))
            found[mine] = times * np.maximum(rows, 1) * np.maximum(cols, 1) / self.beside[mine]
        return found

    def with_parts(self, parted: np.ndarray) -> "Spread":
        """The same where the jobs that are `parted` (N,) go by squares of the map, and as many more at the end are made once."""
        ones = np.ones(int(parted.sum()))
        goes = np.append(np.where(parted, int(GoesBy.SQUARE), self.goes), int(GoesBy.ONCE) * ones.astype(int))
        return Spread(goes, *(np.append(values, ones) for values in (self.beside, self.rows, self.cols, self.follows)))


def planned_with(loaded: LoadedWorkflow, tile: int, left_out: Sequence[str]) -> list[PlannedJob]:
    """The jobs of a finished project with such tiles, as if the tables that they follow from were made with them."""
    project = loaded.project.model_copy(update={"tile": tile})
    session = session_of(replace(loaded, project=project))
    session.planner.is_done = lambda key: True
    while list(session.planner.advance()):
        pass
    return [planned for key, planned in session.graph.jobs.items() if key[0] not in left_out]


def spread_of(planned: Sequence[PlannedJob], larger: Sequence[PlannedJob]) -> Spread:
    """That of the jobs of a plan, of which another is known with tiles of LARGER times the side."""
    families, with_larger = [family_of(one) for one in planned], Counter(map(family_of, larger))
    larger_places = {family_of(one) for one in larger if one.job.row or one.job.col}
    counts, items = Counter(families), defaultdict(set)
    for one, family in zip(planned, families, strict=True):
        items[family].add(one.job.item)
    goes = [
        GoesBy.ONCE
        if _made_once(one, counts[family])
        else _goes_by(family, counts[family] <= with_larger[family], family in larger_places, len(items[family]))
        for one, family in zip(planned, families, strict=True)
    ]
    groups = [_group_of(one) for one in planned]
    beside, extents = Counter(groups), _extents(planned)
    along = np.array([extents[group] for group in groups]).reshape(-1, 2)
    sides, larger_sides = _level_sides(planned), _level_sides(larger)
    follows = {group: min(larger_sides.get(group, LARGER * side) / (LARGER * side), 1.0) for group, side in sides.items()}
    return Spread(
        np.array(goes, int),
        np.array([beside[group] for group in groups]),
        along[:, 0],
        along[:, 1],
        np.array([follows.get(group, 1.0) for group in groups]),
    )


def _made_once(one: PlannedJob, of_family: int) -> bool:
    """Every file that is exported whole, and what a function makes in a single job; not exports of a window, and points, of which
    large projects have a file a tile."""
    if isinstance(one.job, Export):
        return one.job.window is None and one.job.format != "laz"
    return of_family == 1 and family_of(one)[1] not in IN_SHEETS


def _goes_by(family: Family, as_many: bool, placed: bool, items: int) -> GoesBy:
    if as_many:
        return GoesBy.SQUARE if placed or family[1] in IN_SHEETS else GoesBy.PHOTOGRAPH
    return GoesBy.TILE_OF_PHOTOGRAPH if items > 1 and family[1] not in OF_LEVELS else GoesBy.TILE_OF_MAP


def _extents(planned: Sequence[PlannedJob]) -> dict[Group, tuple[float, float]]:
    """(rows, cols) of tiles of each group, whole and parts of one: by the windows that it writes, or else by the number of its rows
    and columns, of which the last is half on average."""
    tile, ends, places = defaultdict(lambda: (1, 1)), defaultdict(lambda: (0, 0)), defaultdict(lambda: (1, 1))
    for one in planned:
        family, group = family_of(one), _group_of(one)
        places[group] = _most(places[group], (one.job.row + 1, one.job.col + 1))
        for window in _window_of(one):
            # A photograph may be smaller than a tile, which others show whole.
            alike = group if family[1] in OF_LEVELS else family
            tile[alike] = _most(tile[alike], (window.height, window.width))
            ends[group] = _most(ends[group], (window.row + window.height, window.col + window.width))
    found = {}
    for group in places:
        by_place = tuple(n if n == 1 else n - 0.5 for n in places[group])
        alike = group if group[0][1] in OF_LEVELS else group[0]
        found[group] = tuple(np.divide(ends[group], tile[alike])) if group in ends else by_place
    return found


def _level_sides(planned: Sequence[PlannedJob]) -> dict[Group, int]:
    """The side of the tiles of each level, cells."""
    found: dict[Group, int] = defaultdict(int)
    for one in planned:
        for window in _window_of(one):
            if family_of(one)[1] in OF_LEVELS:
                found[_group_of(one)] = max(found[_group_of(one)], window.height, window.width)
    return found


def _group_of(one: PlannedJob) -> Group:
    return family_of(one), one.job.item


def _window_of(one: PlannedJob) -> Iterator[Window]:
    """That of the first raster that a job writes; none where it writes no raster."""
    if not isinstance(one.job, Export):
        yield from [region.window for region in one.job.writes.values() if isinstance(region, Raster)][:1]


def _most(one: tuple[int, int], other: tuple[int, int]) -> tuple[int, int]:
    return max(one[0], other[0]), max(one[1], other[1])
