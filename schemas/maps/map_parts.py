"""A large map in parts, each made by itself: which image tiles and which values a part has, and where its files lie.

Level 0 of a layer has all its pixels, every level above half the pixels of the one below. A part is a square of `SPAN` tiles a side
at its finest level, with `LEVELS` levels; those above them are made of the coarsest tiles of finer parts. So no part grows with
the map, and the parts of a layer end in a single one.
"""

from collections.abc import Iterator

from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Table
from orthomill.schemas.raster import Tile, tiles_of
from orthomill.schemas.stage_report import Picture

PAGE = "products/index.html"
FOLDER = "products/viewer"
"""beside the page"""
VALUES = f"{FOLDER}/values"
TILE = 512
"""px along an image tile"""
LEVELS = 4
SPAN = 1 << (LEVELS - 1)  # so that the coarsest level of a part is one tile
PART = TILE * SPAN
"""px along a part of the finest level; cells along a part of the values"""
RIM = 1
"""px around a part that relief is shaded from"""


class MapLayer(BaseModel):
    """What parts of one layer are told: its picture, its size in pixels, and the finest level that they have."""

    model_config = ConfigDict(frozen=True)

    number: int
    picture: Picture
    rows: int
    cols: int
    level: int = 0


class Shades(BaseModel):
    """What the colours of a layer rest on: the least and the greatest value told apart, and by how much relief is exaggerated."""

    model_config = ConfigDict(frozen=True)

    low: float = 0.0
    high: float = 1.0
    steep: float = 1.0


class WrittenTiles(BaseModel):
    """Names of the tiles that a part and the finer ones in it have written, "row-col" with what kind of file it is, by level."""

    model_config = ConfigDict(frozen=True)

    names: dict[int, tuple[str, ...]]


def level_count(shape: tuple[int, ...]) -> int:
    """How many levels a raster of `shape` has: the last one is a single tile."""
    count = 1
    while max(shape[:2]) > TILE << (count - 1):
        count += 1
    return count


def first_levels(shape: tuple[int, ...]) -> range:
    """The finest levels of the parts of a raster."""
    return range(0, level_count(shape), LEVELS)


def parts_at(shape: tuple[int, ...], level: int) -> Iterator[Tile]:
    """The parts with this finest level, and their windows in the pixels of level 0."""
    return tiles_of(shape[:2], PART << level)


def layer_table(number: int, level: int) -> Table[MapLayer]:
    """What the parts of a layer with this finest level are told."""
    return Table(f"viewer/layers/{number}-{level}.json", MapLayer)


def shades_file(number: int) -> str:
    """Where the `Shades` of a layer lie, in the run's folder."""
    return f"{FOLDER}/{number}/parts/shades.json"


def tiles_file(number: int, level: int, row: int, col: int) -> str:
    """Where the `WrittenTiles` of a part of a layer lie."""
    return f"{FOLDER}/{number}/parts/{level}-{row}-{col}.json"


def last_tiles_file(number: int, shape: tuple[int, ...]) -> str:
    """Where the names of all tiles of a layer lie: the list of its coarsest part."""
    return tiles_file(number, first_levels(shape)[-1], 0, 0)


def values_file(row: int, col: int) -> str:
    """Where the `WrittenTiles` of a part of the values lie."""
    return f"{VALUES}/parts/{row}-{col}.json"


CLOUD_FILE = f"{FOLDER}/cloud.js"
LINES_FILE = f"{FOLDER}/lines.js"
EDGES_FILE = f"{FOLDER}/edges.js"
