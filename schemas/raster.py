"""Rasters by name: their shape, chunks and georeference, and windows into them. Pure geometry, no storage.

Arrays are (rows, cols) or (rows, cols, bands). A window is half open. A chunk spans all bands.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import ceil, floor
from typing import TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

NO_UNIT = "unit of the block"
"""what a reference system calls its unit where nothing tells how long it is"""
ROUNDING = 1e-3
"""of a pixel: what borders that two grids share may seem to differ by"""
Coordinates = TypeVar("Coordinates", float, np.ndarray)


@dataclass(frozen=True, order=True, slots=True)
class Window:
    """Rows [row, row + height) and columns [col, col + width) of a raster, in pixels."""

    row: int
    col: int
    height: int
    width: int

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.height, self.width

    @property
    def cells(self) -> int:
        """How many: what memory is counted by, `bytes per cell * cells`."""
        return self.height * self.width

    @property
    def slices(self) -> tuple[slice, slice]:
        """What takes the window out of an array of the whole raster."""
        return slice(self.row, self.row + self.height), slice(self.col, self.col + self.width)

    @property
    def empty(self) -> bool:
        """Whether it holds no pixel."""
        return self.height <= 0 or self.width <= 0

    def grown(self, halo: int) -> "Window":
        """The window with `halo` pixels more on every side; may extend beyond the raster, so clip it."""
        return Window(self.row - halo, self.col - halo, self.height + 2 * halo, self.width + 2 * halo)

    def clipped(self, shape: tuple[int, ...]) -> "Window":
        """The part inside a raster of `shape`; empty (height or width 0) where there is none."""
        return self.overlap(Window(0, 0, shape[0], shape[1]))

    def overlap(self, other: "Window") -> "Window":
        """What both have in common; empty where they do not meet."""
        row, col = max(self.row, other.row), max(self.col, other.col)
        bottom, right = min(self.row + self.height, other.row + other.height), min(self.col + self.width, other.col + other.width)
        return Window(row, col, max(bottom - row, 0), max(right - col, 0))

    def within(self, outer: "Window") -> "Window":
        """The same pixels, counted from the corner of a window that holds them: their place in an array of `outer`."""
        return Window(self.row - outer.row, self.col - outer.col, self.height, self.width)

    def reduced(self, factor: int) -> "Window":
        """The pixels, `factor` times larger, that the window touches."""
        row, col = self.row // factor, self.col // factor
        bottom, right = -(-(self.row + self.height) // factor), -(-(self.col + self.width) // factor)
        return Window(row, col, bottom - row, right - col)

    def scaled(self, factor: int) -> "Window":
        """The window of the same area in a raster whose pixels are `factor` times smaller."""
        return Window(self.row * factor, self.col * factor, self.height * factor, self.width * factor)


def enclosing(windows: Iterable[Window]) -> Window:
    """The smallest window that holds several, of which empty ones hold nothing; empty where all are."""
    held = [window for window in windows if not window.empty]
    if not held:
        return Window(0, 0, 0, 0)
    row, col = min(window.row for window in held), min(window.col for window in held)
    bottom, right = max(window.row + window.height for window in held), max(window.col + window.width for window in held)
    return Window(row, col, bottom - row, right - col)


@dataclass(frozen=True, slots=True)
class Tile:
    """One cell of a tiling: its place in the tiling, and its window."""

    row: int
    col: int
    window: Window


def tiles_of(shape: tuple[int, ...], size: int | tuple[int, int]) -> Iterator[Tile]:
    """Tiles of `size` pixels (or rows, columns) that cover a raster of `shape`, row by row; the last ones are smaller."""
    height, width = (size, size) if isinstance(size, int) else size
    for row in range(-(-shape[0] // height)):
        for col in range(-(-shape[1] // width)):
            yield Tile(row, col, Window(row * height, col * width, height, width).clipped(shape))


def sheets_of(shape: tuple[int, ...], size: int, side: int) -> tuple[Tile, ...]:
    """Whole tiles of `size` pixels together, in squares of about `side` pixels, row by row."""
    return tuple(tiles_of(shape, max(side // size, 1) * size))


def tiles_in(sheet: Tile, shape: tuple[int, ...], size: int) -> Iterator[Tile]:
    """Those of `tiles_of` that lie in a sheet of whole tiles, row by row."""
    window = sheet.window
    for row in range(window.row // size, -(-(window.row + window.height) // size)):
        for col in range(window.col // size, -(-(window.col + window.width) // size)):
            yield Tile(row, col, Window(row * size, col * size, size, size).clipped(shape))


def windows_in(window: Window, size: int) -> tuple[Window, ...]:
    """Windows of `size` pixels that cover a window, counted from its corner, row by row; the last ones are smaller."""
    inside = (tile.window for tile in tiles_of(window.shape, size))
    return tuple(Window(window.row + one.row, window.col + one.col, one.height, one.width) for one in inside)


class MapGrid(BaseModel):
    """A north-up grid on the ground. `west` and `north` are the outer corner of the upper-left cell (m, in the project's CRS)."""

    model_config = ConfigDict(frozen=True)

    west: float
    north: float
    cell: float
    rows: int
    cols: int

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.rows, self.cols

    @property
    def cells(self) -> int:
        """How many."""
        return self.rows * self.cols

    @property
    def transform(self) -> tuple[float, float, float, float, float, float]:
        """GDAL's corner convention, in rasterio's order (a, b, c, d, e, f)."""
        return self.cell, 0.0, self.west, 0.0, -self.cell, self.north

    def centres(self, window: Window) -> tuple[np.ndarray, np.ndarray]:
        """X of the columns and Y of the rows of `window`: cell centres, (width,) and (height,), m."""
        x = self.west + (np.arange(window.col, window.col + window.width) + 0.5) * self.cell
        y = self.north - (np.arange(window.row, window.row + window.height) + 0.5) * self.cell
        return x, y

    def pixel(self, x: Coordinates, y: Coordinates) -> tuple[Coordinates, Coordinates]:
        """(col, row) of ground points, float; cell centres are integers."""
        # Half a cell less than the transform gives, which counts from the outer corner: confusing the two shifts a map by half a
        # cell.
        return (x - self.west) / self.cell - 0.5, (self.north - y) / self.cell - 0.5


class RasterSpec(BaseModel):
    """The specification of a raster. The store creates the raster from it, and exports read it back."""

    model_config = ConfigDict(frozen=True)

    name: str
    shape: tuple[int, ...]
    # As text, so that the specification can be stored as JSON with the raster itself.
    dtype: str
    chunk: int
    nodata: float | None = None
    unit: str = ""
    crs: str | None = None
    transform: tuple[float, float, float, float, float, float] | None = None
    readers: tuple[str, ...] | None = None
    """Stages that may read it; None for all. Truth is for `evaluation` only."""
    axes: tuple[str, str] = ("y", "x")
    """Names of the map axes, rows first. Map rasters of one group share them; one on another grid needs names of its own."""
    tags: dict[str, str] = {}
    """What else belongs to its georeference, by name, as text in exported files: the plane in space that its coordinates lie on."""
    # Not in its text, from which fingerprints are made: how a raster is drawn changes no result.
    colours: bool = Field(default=True, repr=False)
    """Whether three or four bands of 8 bits are colours (and opacity); otherwise they measure different things."""

    def same(self, other: "RasterSpec") -> bool:
        """Whether both describe the same raster."""
        # By their text: with == a nodata of NaN is not equal to itself, and every map raster would be created again in every run.
        return repr(self) == repr(other)

    @property
    def chunks(self) -> tuple[int, ...]:
        """(rows, columns) of a stored chunk, and all bands where there are several."""
        # No larger than the raster, as every chunk is stored at its full size; all bands together, as tiles are read with all
        # bands.
        return (min(self.chunk, self.shape[0]), min(self.chunk, self.shape[1]), *self.shape[2:])

    @property
    def full(self) -> Window:
        """The window of all pixels."""
        return Window(0, 0, self.shape[0], self.shape[1])

    def bytes_of(self, window: Window) -> int:
        """Bytes of the pixels of a window, all bands, not compressed."""
        bands = self.shape[2] if len(self.shape) == 3 else 1
        return window.cells * bands * np.dtype(self.dtype).itemsize


def map_raster(
    name: str,
    grid: MapGrid,
    dtype: str,
    crs: str,
    chunk: int,
    nodata: float | None = None,
    unit: str = "",
    bands: int = 0,
    readers: tuple[str, ...] | None = None,
    axes: tuple[str, str] = ("y", "x"),
    colours: bool = True,
) -> RasterSpec:
    """A raster on `grid`, with `bands` bands (0: a plain 2-D array); heights in a system without metres have none either."""
    shape = (*grid.shape, bands) if bands else grid.shape
    return RasterSpec(
        name=name,
        shape=shape,
        dtype=dtype,
        chunk=chunk,
        nodata=nodata,
        unit=NO_UNIT if unit == "m" and NO_UNIT in crs else unit,
        crs=crs,
        transform=grid.transform,
        readers=readers,
        axes=axes,
        colours=colours,
    )


def same_ground(window: Window, spec: RasterSpec, other: RasterSpec) -> Window:
    """The pixels of another raster that the ground of a window touches, both north up on the map; empty where there are none."""
    if spec.transform is None or other.transform is None:
        raise ValueError(f"{spec.name} and {other.name} are not both on the map")
    (a, _, west, _, e, north), (width, _, left, _, height, top) = spec.transform, other.transform
    # Borders that both grids share must not touch the next pixel for the rounding of coordinates of 10^6 m.
    first, last = ((west + col * a - left) / width for col in (window.col, window.col + window.width))
    upper, lower = ((north + row * e - top) / height for row in (window.row, window.row + window.height))
    row, col = floor(upper + ROUNDING), floor(first + ROUNDING)
    return Window(row, col, ceil(lower - ROUNDING) - row, ceil(last - ROUNDING) - col).clipped(other.shape)
