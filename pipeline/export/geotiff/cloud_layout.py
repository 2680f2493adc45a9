"""How a GeoTIFF for the cloud is laid out: all directories, the largest image first, then the tiles row by row, the smallest image
first.

GDAL reads from a text behind the head that it is laid out so (gdal.org, driver COG, "Header ghost area"): every tile has its length
before it and its last four bytes once more behind it, so that it can be read in one request, and checked.
"""

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from orthomill.pipeline.export.geotiff.tiff_directory import (
    BIG,
    CLASSIC,
    HEIGHT,
    LONG,
    LONG8,
    TILE_OFFSETS,
    TILE_SIZES,
    WIDTH,
    Directory,
    Form,
    TiffField,
    encoded,
    field,
)

TILE = 512
"""side of a tile, px"""
LEVELS = 3
"""overviews of a part"""
PART = TILE << LEVELS
"""side of a part, px: its last overview is one tile"""
FRAME = 4
"""bytes before a tile, and behind it"""
_TOLD = (
    "LAYOUT=IFDS_BEFORE_DATA\nBLOCK_ORDER=ROW_MAJOR\nBLOCK_LEADER=SIZE_AS_UINT4\nBLOCK_TRAILER=LAST_4_BYTES_REPEATED\n"
    "KNOWN_INCOMPATIBLE_EDITION=NO\n "
)
MOST = 2**32
"""bytes of a file that numbers of 32 bits reach"""
_BLOCK = 2**24
"""bytes that are copied at a time"""


class Tiles(NamedTuple):
    """Tiles of a level in a file, in the order in which they stand in the new one: `row`, `col`, `start`, `size`: (N,).

    `framed`: whether they follow each other there with their frames, and can be copied as one block.
    """

    path: Path
    row: np.ndarray
    col: np.ndarray
    start: np.ndarray
    size: np.ndarray
    framed: bool


@dataclass(frozen=True)
class Level:
    """One of the images, the whole or an overview: its directory without the places of its tiles, and the files that hold these."""

    directory: Directory
    tiles: tuple[Tiles, ...]

    @property
    def size(self) -> int:
        """Bytes of its tiles with their frames."""
        return sum(int(part.size.sum()) + 2 * FRAME * len(part.size) for part in self.tiles)

    def placed(self, begin: int, form: Form) -> Directory:
        """Its directory when its tiles stand from a place in the file on."""
        across = -(-int(self.directory[WIDTH].numbers[0]) // TILE)
        down = -(-int(self.directory[HEIGHT].numbers[0]) // TILE)
        place = np.concatenate([part.row * across + part.col for part in self.tiles])
        size = np.concatenate([part.size for part in self.tiles])
        offsets, sizes = np.zeros(across * down, np.uint64), np.zeros(across * down, np.uint32)
        offsets[place], sizes[place] = begin + FRAME + np.cumsum(size + 2 * FRAME) - (size + 2 * FRAME), size
        kind, dtype = (LONG8, "<u8") if form is BIG else (LONG, "<u4")
        places = {
            TILE_OFFSETS: TiffField(kind, len(offsets), offsets.astype(dtype).tobytes()),
            TILE_SIZES: TiffField(LONG, len(sizes), sizes.astype("<u4").tobytes()),
        }
        return self.directory | places


def tiles_in(path: Path, directory: Directory, row: int = 0, col: int = 0, framed: bool = False) -> Tiles:
    """All tiles of an image of a file, whose first one is (row, col) of the level."""
    across = -(-int(directory[WIDTH].numbers[0]) // TILE)
    start, size = directory[TILE_OFFSETS].numbers.astype(np.int64), directory[TILE_SIZES].numbers.astype(np.int64)
    order = np.arange(len(start))
    return Tiles(path, row + order // across, col + order % across, start, size, framed)


def row_by_row(parts: Iterable[Tiles]) -> tuple[Tiles, ...]:
    """The tiles of parts that lie beside and below each other, as they follow each other in the whole."""
    rows = [_taken(part, part.row == row) for part in parts for row in np.unique(part.row)]
    return tuple(sorted(rows, key=lambda one: (one.row[0], one.col[0])))


def _taken(tiles: Tiles, some: np.ndarray) -> Tiles:
    return tiles._replace(**{name: getattr(tiles, name)[some] for name in ("row", "col", "start", "size")})


def resized(directory: Directory, shape: tuple[int, int]) -> Directory:
    """A directory for an image of other rows and columns."""
    return directory | {WIDTH: field(LONG, shape[1]), HEIGHT: field(LONG, shape[0])}


def write_layout(path: Path, levels: list[Level]) -> None:
    """Write the file; `levels` from the whole to the smallest. Raises OSError."""
    head, begin, form = _head(levels, CLASSIC)
    if begin + sum(level.size for level in levels) >= MOST:
        head, begin, form = _head(levels, BIG)
    places = begin + np.cumsum([0, *(level.size for level in reversed(levels))])[:-1][::-1]
    with path.open("wb") as target:
        target.write(head)
        for level, place in zip(levels, places, strict=True):
            target.write(encoded(level.placed(int(place), form), form, target.tell(), last=level is levels[-1]))
        for level in reversed(levels):
            for part in level.tiles:
                target.writelines(_blocks(part) if part.framed else _framed(part))


def _head(levels: list[Level], form: Form) -> tuple[bytes, int, Form]:
    """What stands before the first directory, where the tiles begin, and the form."""
    ghost = f"GDAL_STRUCTURAL_METADATA_SIZE={len(_TOLD):06d} bytes\n{_TOLD}".encode()
    start = struct.pack(form.head, b"II", form.version, *((8, 0) if form is BIG else ()))
    first = len(start) + struct.calcsize(form.place) + len(ghost)
    first += -first % 8
    head = (start + struct.pack(form.place, first) + ghost).ljust(first, b"\0")
    end = first
    for level in levels:
        end += len(encoded(level.placed(0, form), form, end, last=False))
    return head, end, form


def _framed(part: Tiles) -> Iterator[bytes]:
    with part.path.open("rb") as source:
        for start, size in zip(part.start.tolist(), part.size.tolist(), strict=True):
            source.seek(start)
            tile = source.read(size)
            yield struct.pack("<I", size) + tile + tile[-FRAME:]


def _blocks(part: Tiles) -> Iterator[bytes]:
    begin, end = int(part.start[0]) - FRAME, int(part.start[-1] + part.size[-1]) + FRAME
    with part.path.open("rb") as source:
        source.seek(begin)
        while begin < end and (block := source.read(min(_BLOCK, end - begin))):
            begin += len(block)
            yield block
