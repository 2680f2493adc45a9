"""The terrain against the true bare ground: by where its height comes from, and by what truly stands there."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.bare_ground import TerrainCode
from orthomill.schemas.job import Columns
from orthomill.schemas.raster import Window
from orthomill.schemas.surface import MEASURED
from orthomill.tasks.evaluation.classes import PlaceClass, place_classes
from orthomill.tasks.evaluation.grids import Placement, codes_on, heights_on

SIGMAS = (1.0, 2.0, 3.0)
FAR = 1.0
"""m: an error that no contour bears"""
OBJECT = 1.5
"""m above the true ground: what was called ground there is an object"""
_OPEN = (PlaceClass.CLEAR_GROUND, PlaceClass.TREE_MARGIN)
_CODES, _PLACES = len(TerrainCode), len(PlaceClass)

CODES: tuple[tuple[str, str, tuple[TerrainCode, ...]], ...] = (
    ("", "all of the terrain", tuple(TerrainCode)[1:]),
    ("measured", "measured ground", (TerrainCode.MEASURED,)),
    ("under_buildings", "bridged under buildings", (TerrainCode.UNDER_BUILDING,)),
    ("under_wood", "bridged under trees and shrubs", (TerrainCode.UNDER_WOOD,)),
    ("guessed", "guessed", (TerrainCode.GUESSED,)),
)
"""name in figures, words, and the codes that are combined; without name: all"""
PLACES: tuple[tuple[str, str, tuple[PlaceClass, ...]], ...] = (
    ("", "everywhere", tuple(PlaceClass)[1:]),
    ("open_ground", "open ground", _OPEN),
    ("building_margin", "within 3 cells of a building", (PlaceClass.BUILDING_MARGIN,)),
    ("roof", "under roofs", (PlaceClass.ROOF_INTERIOR, PlaceClass.ROOF_EDGE)),
    ("tree", "under trees", (PlaceClass.TREE,)),
    ("water", "water", (PlaceClass.WATER,)),
)


@dataclass(frozen=True)
class GroundSums(Columns):
    """Sums by code of the terrain and class of the truth: one row for every combination, code by code."""

    cells: np.ndarray
    sums: np.ndarray
    squares: np.ndarray
    """float64: of the differences, m and m2"""
    far: np.ndarray
    within_1: np.ndarray
    within_2: np.ndarray
    within_3: np.ndarray
    """int64: cells off by more than `FAR`, and within so many of their standard errors"""
    objects: np.ndarray
    """int64: cells more than `OBJECT` above the true ground"""
    seen: np.ndarray
    """int64: cells whose surface was measured"""


class GroundGroup(BaseModel):
    """The terrain of one group of codes in one group of places; lengths in m, shares in %."""

    model_config = ConfigDict(frozen=True)

    code: str
    place: str
    words: str
    cells: int
    share: float
    bias: float
    rmse: float
    far: float
    within: tuple[float, ...]


class GroundSummary(BaseModel):
    """All groups that occur; % of the open measured cells that were not called ground, and of the cells called ground that are an
    object."""

    model_config = ConfigDict(frozen=True)

    groups: tuple[GroundGroup, ...]
    type_1: float | None
    type_2: float | None


def ground_against_truth(
    height: np.ndarray,
    precision: np.ndarray,
    code: np.ndarray,
    provenance: np.ndarray,
    ground: np.ndarray,
    material: np.ndarray,
    place: Placement,
    core: Window,
) -> GroundSums:
    """The sums of the cells `core`: height, precision (rows, cols) m and codes of the terrain, provenance of the surface; the
    truth at the source window of `place`, whose window is `core` with a halo."""
    inner = core.within(place.window).slices
    classes = place_classes(codes_on(material, place))[inner]
    off = (height - heights_on(ground, place)[inner]).astype(np.float64)
    known = np.isfinite(off) & (classes != PlaceClass.UNKNOWN)
    group = (code.astype(np.int64) * _PLACES + classes)[known]
    e, sigma, seen = off[known], precision[known], np.isin(provenance, MEASURED)[known]

    def count(mask: np.ndarray) -> np.ndarray:
        return np.bincount(group[mask], minlength=_CODES * _PLACES)

    sums, squares = (np.bincount(group, values, _CODES * _PLACES) for values in (e, e * e))
    one, two, three = (count(np.abs(e) <= k * sigma) for k in SIGMAS)
    return GroundSums(
        cells=count(np.ones(len(e), bool)),
        sums=sums,
        squares=squares,
        far=count(np.abs(e) > FAR),
        within_1=one,
        within_2=two,
        within_3=three,
        objects=count(e > OBJECT),
        seen=count(seen),
    )


def summarise_ground(parts: tuple[GroundSums, ...]) -> GroundSummary:
    """The summary of all tiles."""
    names = GroundSums.__dataclass_fields__
    total = {name: np.sum([getattr(part, name) for part in parts], axis=0).reshape(_CODES, _PLACES) for name in names}
    groups = [
        _group(total, code, place, f"{words}, {where}", codes, places)
        for code, words, codes in CODES
        for place, where, places in PLACES
        if total["cells"][np.ix_(codes, places)].sum()
    ]
    ground = (TerrainCode.MEASURED,)
    open_seen = total["seen"][np.ix_(tuple(TerrainCode)[1:], _OPEN)].sum()
    open_ground = total["seen"][np.ix_(ground, _OPEN)].sum()
    called = total["cells"][TerrainCode.MEASURED].sum()
    return GroundSummary(
        groups=tuple(groups),
        type_1=_percent(open_seen - open_ground, open_seen),
        type_2=_percent(total["objects"][TerrainCode.MEASURED].sum(), called),
    )


def _group(
    total: dict[str, np.ndarray], code: str, place: str, words: str, codes: Iterable[int], places: Iterable[int]
) -> GroundGroup:
    at = np.ix_(tuple(codes), tuple(places))
    n = {name: float(values[at].sum()) for name, values in total.items()}
    cells = n["cells"]
    return GroundGroup(
        code=code,
        place=place,
        words=words,
        cells=int(cells),
        share=round(100.0 * cells / float(total["cells"].sum()), 2),
        bias=round(n["sums"] / cells, 4),
        rmse=round(float(np.sqrt(n["squares"] / cells)), 4),
        far=round(100.0 * n["far"] / cells, 3),
        within=tuple(round(100.0 * n[f"within_{k:.0f}"] / cells, 2) for k in SIGMAS),
    )


def _percent(part: float, whole: float) -> float | None:
    return round(100.0 * float(part) / float(whole), 3) if whole else None
