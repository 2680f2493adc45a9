"""Resampling of a reference from its own map grid to the judged cells.

Heights: bilinear between four reference cells of one surface, the nearest one where a wall runs between them. Codes: nearest.
Colours: mean over the judged pixel where the reference is finer, else bicubic. Positions refer to the whole grids, so tiles agree.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from orthomill.schemas.raster import MapGrid, RasterSpec, Window

SAME = 1e-6
"""grids whose cells and offsets differ by less than this share of a cell count as one grid"""
_WALL = 2.0
"""height span of four neighbouring cells, in cells, beyond which a wall runs between them: a slope of 63 degrees"""


@dataclass(frozen=True)
class Placement:
    """Cells `window` of `grid`, and the window `source_window` of the reference's `source` grid that covers them."""

    grid: MapGrid
    window: Window
    source: MapGrid
    source_window: Window

    @property
    def empty(self) -> bool:
        """Whether the reference covers none of the cells."""
        return self.source_window.empty

    def source_pixels(self) -> tuple[np.ndarray, np.ndarray]:
        """Columns (width,) and rows (height,) of the judged cells' centres, in pixels of the source window."""
        x, y = self.grid.centres(self.window)
        col, row = self.source.pixel(x, y)
        return col - self.source_window.col, row - self.source_window.row


def placement(grid: MapGrid, window: Window, source: MapGrid, margin: int = 3) -> Placement:
    """The placement of `window`, empty beyond the reference; `margin` in reference cells."""
    # the margin holds the kernels of all resampling methods, so that tiles do not see their own border
    # first and last centre suffice: both grids are north-up
    x, y = grid.centres(window)
    col, row = source.pixel(x[[0, -1]], y[[0, -1]])
    reach = margin + int(np.ceil(grid.cell / source.cell))
    left, top = int(np.floor(col[0])) - reach, int(np.floor(row[0])) - reach
    right, bottom = int(np.ceil(col[1])) + reach + 1, int(np.ceil(row[1])) + reach + 1
    return Placement(grid, window, source, Window(top, left, bottom - top, right - left).clipped(source.shape))


def _index(places: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nearest indices (clipped) of `places`, and which of them lie inside."""
    nearest = np.floor(places + 0.5).astype(np.int64)
    return np.clip(nearest, 0, max(count - 1, 0)), (nearest >= 0) & (nearest < count)


def codes_on(codes: np.ndarray, place: Placement, outside: int = 0) -> np.ndarray:
    """Codes (rows, cols) of the source window at the judged cells, nearest; `outside` beyond the reference."""
    if place.empty:
        return np.full(place.window.shape, outside, codes.dtype)
    cols, rows = place.source_pixels()
    (col, col_in), (row, row_in) = _index(cols, codes.shape[1]), _index(rows, codes.shape[0])
    return np.where(row_in[:, None] & col_in[None, :], codes[np.ix_(row, col)], outside).astype(codes.dtype)


def heights_on(heights: np.ndarray, place: Placement) -> np.ndarray:
    """Heights (rows, cols) m of the source window at the judged cells, NaN beyond the reference. float32.

    Bilinear, but nearest where four heights span more than two reference cells.
    """
    # Across a wall a bilinear height lies in the air: every DSM, right or wrong, would be judged against a ramp.
    if place.empty:
        return np.full(place.window.shape, np.nan, np.float32)
    cols, rows = place.source_pixels()
    (col, col_in), (row, row_in) = _index(cols, heights.shape[1]), _index(rows, heights.shape[0])
    # the nearest height also where one of the four is missing: gaps of the reference do not grow by resampling
    nearest = heights[np.ix_(row, col)]
    low_c = np.clip(np.floor(cols).astype(np.int64), 0, max(heights.shape[1] - 2, 0))
    low_r = np.clip(np.floor(rows).astype(np.int64), 0, max(heights.shape[0] - 2, 0))
    high_c, high_r = np.minimum(low_c + 1, heights.shape[1] - 1), np.minimum(low_r + 1, heights.shape[0] - 1)
    s, t = np.clip(cols - low_c, 0, 1)[None, :], np.clip(rows - low_r, 0, 1)[:, None]
    four = [heights[np.ix_(r, c)] for r in (low_r, high_r) for c in (low_c, high_c)]
    smooth = (1 - t) * ((1 - s) * four[0] + s * four[1]) + t * ((1 - s) * four[2] + s * four[3])
    span = np.maximum.reduce(four) - np.minimum.reduce(four)
    value = np.where(np.isfinite(smooth) & (span <= _WALL * place.source.cell), smooth, nearest)
    return np.where(row_in[:, None] & col_in[None, :], value, np.nan).astype(np.float32)


def colours_on(colours: np.ndarray, place: Placement) -> np.ndarray:
    """Colours (rows, cols, bands) of the source window at the judged pixels, NaN beyond the reference. float32."""
    bands = colours.shape[2]
    if place.empty:
        return np.full((*place.window.shape, bands), np.nan, np.float32)
    cols, rows = place.source_pixels()
    (col, col_in), (row, row_in) = _index(cols, colours.shape[1]), _index(rows, colours.shape[0])
    ratio = place.grid.cell / place.source.cell
    inside = row_in[:, None] & col_in[None, :]
    # on one grid the colours are copied: no resampling, however good, may count as an error of the orthoimage
    off = max(np.abs(cols - col)[col_in].max(initial=0), np.abs(rows - row)[row_in].max(initial=0))
    if abs(ratio - 1) < SAME and off < SAME:
        return np.where(inside[..., None], colours[np.ix_(row, col)], np.nan).astype(np.float32)
    # a box mean removes what a coarser pixel cannot show; bicubic alone would alias roof tiles into patterns
    order = 1 if ratio > 1.5 else 3
    planes = []
    for band in range(bands):
        plane = colours[..., band].astype(np.float32)
        if ratio > 1.5:
            plane = ndimage.uniform_filter(plane, size=round(ratio), mode="nearest", origin=0)
        grid = np.meshgrid(rows + _even_shift(ratio), cols + _even_shift(ratio), indexing="ij")
        planes.append(ndimage.map_coordinates(plane, grid, order=order, mode="nearest"))
    return np.where(inside[..., None], np.stack(planes, axis=-1), np.nan).astype(np.float32)


def _even_shift(ratio: float) -> float:
    """A box of an even number of cells is centred half a cell before its pixel (scipy's convention)."""
    return 0.5 if ratio > 1.5 and round(ratio) % 2 == 0 else 0.0


def grid_of(spec: RasterSpec) -> MapGrid:
    """The map grid of a raster with a north-up transform. Raises ValueError when it has none."""
    # rotated transforms are not written by any stage; files are resampled by the engine before they arrive
    if spec.transform is None:
        raise ValueError(f"{spec.name} has no map grid; only rasters with a north-up transform can be compared")
    cell, _, west, _, _, north = spec.transform
    return MapGrid(west=west, north=north, cell=cell, rows=spec.shape[0], cols=spec.shape[1])


def readable(place: Placement) -> Window:
    """The window to read for a placement; beyond the reference one corner cell, which is then ignored."""
    # jobs have the same reads everywhere, so a tile beyond the reference needs no other function
    return Window(0, 0, 1, 1) if place.empty else place.source_window
