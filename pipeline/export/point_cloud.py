"""A point cloud from rasters: every finite cell of the raster "z" becomes a point, chunk by chunk.

"rgb" (RGB or RGBA, 8 bit) may have a finer or coarser grid that nests in the grid of z: a point takes the mean colour of the opaque
pixels of its cell. Every other raster has the grid of z and becomes an extra attribute under its own label. LAS 1.4, point format 7
with colour, otherwise 6; coordinates in whole millimetres.

Source: ASPRS, LAS Specification 1.4 - R15.
"""

from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from laspy.vlrs.known import WktCoordinateSystemVlr
from pyproj import CRS
from pyproj.exceptions import CRSError

from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import Export
from orthomill.schemas.raster import RasterSpec, Window, tiles_of

SCALE = 0.001
"""m; LAS stores integers, and a millimetre is finer than the precision of any point here"""
Affine = tuple[float, float, float, float, float, float]
"""(a, b, c, d, e, f) of x = a col + b row + c, y = d col + e row + f, in GDAL's corner convention"""


@dataclass(frozen=True)
class Nesting:
    """The colour grid relative to the grid of heights: a cell has `fine` pixels along a side, or a pixel covers `coarse` cells."""

    spec: RasterSpec
    fine: int
    coarse: int
    row: int
    col: int
    """colour pixel at the upper-left cell of z (in colour pixels)"""

    def window(self, cells: Window) -> Window:
        """Colour pixels of the given cells of z; may extend beyond the colour raster."""
        if self.fine > 1:
            scaled = cells.scaled(self.fine)
            return Window(scaled.row + self.row, scaled.col + self.col, scaled.height, scaled.width)
        top, left = cells.row // self.coarse, cells.col // self.coarse
        bottom, right = -(-(cells.row + cells.height) // self.coarse), -(-(cells.col + cells.width) // self.coarse)
        return Window(top + self.row, left + self.col, bottom - top, right - left)

    def colours(self, store: ReadableStore, cells: Window) -> np.ndarray:
        """(height, width, 3) float mean colour per cell; 0 where there is none."""
        # Transparent pixels are black; averaging them in would darken the points along the edge of the orthoimage.
        pixels = _padded(store, self.spec, self.window(cells)).astype(np.float32)
        opaque = pixels[..., 3:4] > 0 if pixels.shape[2] == 4 else np.ones((*pixels.shape[:2], 1), bool)
        if self.fine > 1:
            return _cell_means(pixels[..., :3] * opaque, opaque, self.fine)
        repeated = np.repeat(np.repeat(pixels[..., :3] * opaque, self.coarse, axis=0), self.coarse, axis=1)
        top, left = cells.row % self.coarse, cells.col % self.coarse
        return repeated[top : top + cells.height, left : left + cells.width]


def _cell_means(values: np.ndarray, opaque: np.ndarray, factor: int) -> np.ndarray:
    rows, cols = values.shape[0] // factor, values.shape[1] // factor
    total = values.reshape(rows, factor, cols, factor, 3).sum(axis=(1, 3))
    count = opaque.reshape(rows, factor, cols, factor, 1).sum(axis=(1, 3))
    return total / np.maximum(count, 1)


def _padded(store: ReadableStore, spec: RasterSpec, window: Window) -> np.ndarray:
    """A window, with 0 where it is outside the raster."""
    out = np.zeros((*window.shape, spec.shape[2]), spec.dtype)
    inside = window.clipped(spec.shape)
    if not inside.empty:
        row, col = inside.row - window.row, inside.col - window.col
        out[row : row + inside.height, col : col + inside.width] = store.read(spec.name, inside)
    return out


def nesting(z: RasterSpec, rgb: RasterSpec) -> Nesting:
    """The place of `rgb` in `z`. Raises StoreError unless the grids share cell borders and the CRS."""
    heights, colours = _affine(z), _affine(rgb)
    ratio = heights[0] / colours[0]
    fine, coarse = max(round(ratio), 1), max(round(1 / ratio), 1)
    col = (heights[2] - colours[2]) / colours[0]
    row = (heights[5] - colours[5]) / colours[4]
    # Coordinates of 10^6 m in float64 over cells of centimetres leave 10^-8 cells of rounding; a thousandth is invisible.
    nests = abs(fine / coarse / ratio - 1) < 1e-9 and max(abs(col - round(col)), abs(row - round(row))) < 1e-3
    if not nests or rgb.crs != z.crs or len(rgb.shape) != 3 or rgb.shape[2] not in (3, 4) or rgb.dtype != "uint8":
        raise StoreError(
            f"The colours {rgb.name} do not fit {z.name}: they must be 8-bit RGB or RGBA on a grid that shares its cell borders."
        )
    return Nesting(rgb, fine, coarse, round(row), round(col))


def write_points(export: Export, store: ReadableStore, path: Path) -> None:
    """Write `export.rasters` as LAZ. Raises StoreError when "z" is missing or not georeferenced."""
    if "z" not in export.rasters:
        raise StoreError(f'{export.path} needs a raster called "z" for the heights; it has {", ".join(export.rasters) or "none"}.')
    specs = {label: store.spec(name) for label, name in export.rasters.items()}
    z = specs.pop("z")
    rgb = specs.pop("rgb", None)
    _check_same_grid(z, specs)
    header = _header(z, specs, coloured=rgb is not None)
    colours = nesting(z, rgb) if rgb is not None else None
    with laspy.open(path, "w", header=header, do_compress=path.suffix == ".laz", laz_backend=laspy.LazBackend.Lazrs) as target:
        for tile in tiles_of(z.shape, max(z.chunk, 128)):
            _write_tile(target, store, Cloud(z, specs, colours), tile.window)


@dataclass(frozen=True)
class Cloud:
    """What a point consists of: its height, its further attributes, its colour."""

    z: RasterSpec
    attributes: dict[str, RasterSpec]
    colours: Nesting | None


def _check_same_grid(z: RasterSpec, attributes: dict[str, RasterSpec]) -> None:
    for spec in attributes.values():
        if spec.shape != z.shape or spec.transform != z.transform:
            raise StoreError(
                f"{spec.name} is not on the grid of {z.name}, so it cannot be an attribute of its points; leave it out."
            )


def _affine(spec: RasterSpec) -> Affine:
    if spec.transform is None:
        raise StoreError(f"{spec.name} is not georeferenced, so its cells are not points on the ground; export it as tiff instead.")
    return spec.transform


def _header(z: RasterSpec, attributes: dict[str, RasterSpec], coloured: bool) -> laspy.LasHeader:
    _, _, west, _, e, north = _affine(z)
    header = laspy.LasHeader(version="1.4", point_format=7 if coloured else 6)
    # No date, so that the same points always give the same bytes.
    header.generating_software, header.system_identifier, header.creation_date = "orthomill", "image matching", None
    header.scales = np.full(3, SCALE)
    # Coordinates are 32-bit integers: relative to a corner, millimetres reach 2000 km; northings are larger.
    header.offsets = np.floor([west, north + e * z.shape[0], 0.0])
    # Names and descriptions of extra dimensions have 32 bytes in the format.
    for label, spec in attributes.items():
        header.add_extra_dim(laspy.ExtraBytesParams(label[:32], spec.dtype, description=f"{label} {spec.unit}"[:32].strip()))
    header.vlrs.append(WktCoordinateSystemVlr(_wkt(z)))
    header.global_encoding.wkt = True
    return header


def _wkt(z: RasterSpec) -> str:
    """WKT 1, which LAS 1.4 requires, where the system can be expressed in it; otherwise WKT 2."""
    try:
        crs = CRS.from_user_input(z.crs)
    except CRSError as error:
        raise StoreError(f"{z.name} has the unknown coordinate system '{z.crs}'; use a known one, such as EPSG:2100.") from error
    return crs.to_wkt("WKT1_GDAL") or crs.to_wkt()


def _write_tile(target: laspy.LasWriter, store: ReadableStore, cloud: Cloud, window: Window) -> None:
    heights = store.read(cloud.z.name, window)
    present = np.isfinite(heights) & (heights != (np.nan if cloud.z.nodata is None else cloud.z.nodata))
    rows, cols = np.nonzero(present)
    if not len(rows):
        return
    a, _, west, _, e, north = _affine(cloud.z)
    points = laspy.ScaleAwarePointRecord.zeros(len(rows), header=target.header)
    points["x"], points["y"] = west + (cols + window.col + 0.5) * a, north + (rows + window.row + 0.5) * e
    points["z"] = heights[present]
    points["return_number"] = points["number_of_returns"] = np.ones(len(rows), np.uint8)
    for label, spec in cloud.attributes.items():
        points[label[:32]] = store.read(spec.name, window)[present]
    if cloud.colours is not None:
        # LAS colours have 16 bits: times 257 maps 255 to 65535.
        colour = np.rint(cloud.colours.colours(store, window)[present]).astype(np.uint16) * 257
        points["red"], points["green"], points["blue"] = colour.T
    target.write_points(points)
