"""Classes of places, and strata of judged cells: where a cell lies, what its height is worth, and whether it can be measured."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from scipy import ndimage

from orthomill.schemas.job import Columns
from orthomill.schemas.surface import ESTIMATED, MEASURED, Provenance
from orthomill.schemas.truth import Material


class PlaceClass(IntEnum):
    """Where a cell lies; every cell has one class."""

    UNKNOWN = 0
    CLEAR_GROUND = 1
    TREE_MARGIN = 2
    BUILDING_MARGIN = 3
    ROOF_INTERIOR = 4
    ROOF_EDGE = 5
    TREE = 6
    WATER = 7
    VEHICLE = 8
    WIRE = 9


GROUPS: tuple[tuple[str, str, tuple[PlaceClass, ...]], ...] = (
    ("all", "all cells but water", tuple(c for c in PlaceClass if c not in (PlaceClass.WATER,))),
    ("open_ground", "open ground: no building within 3 cells, no tree", (PlaceClass.CLEAR_GROUND, PlaceClass.TREE_MARGIN)),
    ("clear_ground", "open ground with no tree within 3 cells either", (PlaceClass.CLEAR_GROUND,)),
    ("building_margin", "ground within 3 cells of a building", (PlaceClass.BUILDING_MARGIN,)),
    ("roof", "roofs", (PlaceClass.ROOF_INTERIOR, PlaceClass.ROOF_EDGE)),
    ("roof_interior", "roofs, 2 cells or more from their edge", (PlaceClass.ROOF_INTERIOR,)),
    ("tree", "trees", (PlaceClass.TREE,)),
    ("water", "water", (PlaceClass.WATER,)),
    ("vehicle", "ground on which a vehicle stands in some photograph", (PlaceClass.VEHICLE,)),
    ("wire", "ground below wires and at poles", (PlaceClass.WIRE,)),
)
"""name in figures, words in the report, and the classes that are combined"""

CODE_GROUPS: tuple[tuple[str, str, tuple[Provenance, ...]], ...] = (
    ("measured", "measured heights", MEASURED),
    ("all_codes", "heights of all codes, the estimated ones too", MEASURED + ESTIMATED),
    ("agreed", "heights of two or more pairs", (Provenance.AGREED,)),
    ("one_pair", "heights of one pair", (Provenance.ONE_PAIR,)),
    ("disputed", "heights of pairs that disagree", (Provenance.DISPUTED,)),
    ("volume", "heights of all photographs together", (Provenance.VOLUME,)),
    ("incoherent", "incoherent heights", (Provenance.INCOHERENT,)),
    ("coarse", "heights of a coarser scale", (Provenance.COARSE,)),
    ("interpolated", "interpolated heights", (Provenance.INTERPOLATED,)),
)
"""name in figures, words in the report, and the codes that are combined"""

MARGIN = 3
"""cells around a building or a tree that are not open ground: matching windows there contain both surfaces"""
ROOF_RIM = 2
"""cells along the edge of a roof that do not belong to its interior"""
HALO = MARGIN + 1
"""cells of material needed around the judged window"""


def _near(mask: np.ndarray, cells: int) -> np.ndarray:
    """Cells within `cells` rows and columns of a set one, diagonals included."""
    return ndimage.maximum_filter(mask, size=2 * cells + 1, mode="constant", cval=0)


def place_classes(material: np.ndarray) -> np.ndarray:
    """uint8 codes of PlaceClass (rows, cols) from codes of Material (rows, cols) on the same cells, 0 where nothing is known."""
    # fields and roads are open ground like any other: both have texture and carry no objects
    roof, tree = material == Material.ROOF, material == Material.TREE
    known = material > 0
    # Later assignments win: a building margin under a tree is a building margin, and what a cell is itself beats what is near.
    classes = np.full(material.shape, PlaceClass.CLEAR_GROUND, np.uint8)
    classes[_near(tree, MARGIN)] = PlaceClass.TREE_MARGIN
    classes[_near(roof, MARGIN)] = PlaceClass.BUILDING_MARGIN
    classes[roof] = np.where(_near(known & ~roof, ROOF_RIM - 1)[roof], PlaceClass.ROOF_EDGE, PlaceClass.ROOF_INTERIOR)
    classes[tree] = PlaceClass.TREE
    # The truth of these three is the ground; what moves or hangs above it is what makes them hard.
    for place, code in (
        (PlaceClass.WATER, Material.WATER),
        (PlaceClass.VEHICLE, Material.VEHICLE),
        (PlaceClass.WIRE, Material.WIRE),
    ):
        classes[material == code] = place
    classes[~known] = PlaceClass.UNKNOWN
    return classes


# One number for three facts: sums and histograms need one column, and any selection of strata adds up.
_CODE, _TWICE = 16, 256


def strata(place: np.ndarray, code: np.ndarray, seen_twice: np.ndarray) -> np.ndarray:
    """int32 stratum of cells from their PlaceClass, their Provenance, and whether two photographs or more truly see them."""
    return (place.astype(np.int32) + _CODE * code.astype(np.int32) + _TWICE * seen_twice.astype(np.int32)).astype(np.int32)


def strata_of(
    places: tuple[PlaceClass, ...], codes: tuple[Provenance, ...] = tuple(Provenance), only_seen_twice: bool = False
) -> tuple[int, ...]:
    """The strata of these classes and codes."""
    twice = (True,) if only_seen_twice else (False, True)
    return tuple(int(p + _CODE * c + _TWICE * t) for p in places for c in codes for t in twice)


@dataclass(frozen=True)
class CheckCounts(Columns):
    """How many cells the check gave each code, by class; one row per combination."""

    place: np.ndarray
    """uint8 PlaceClass"""
    code: np.ndarray
    """uint8 CheckCode"""
    cells: np.ndarray
    """int64"""


def check_counts(place: np.ndarray, code: np.ndarray) -> CheckCounts:
    """The counts of cells with these classes and codes, both (rows, cols) uint8."""
    both, cells = np.unique(place.astype(np.int64) * _TWICE + code, return_counts=True)
    return CheckCounts((both // _TWICE).astype(np.uint8), (both % _TWICE).astype(np.uint8), cells.astype(np.int64))
