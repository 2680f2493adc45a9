"""A point cloud, from rasters or from tables. LAS 1.4, point format 7 with colour, otherwise 6; coordinates in whole millimetres.

From rasters: every finite cell of the raster "z" becomes a point, chunk by chunk. "rgb" (RGB or RGBA of 8 or 16 bits) may have a
finer or coarser grid that nests in the grid of z: a point takes the mean colour of the opaque pixels of its cell. Every other
raster has the grid of z.

From tables: every row of every table becomes a point, table by table, with the columns x, y and z. Its colour is that of the pixel
of "rgb" above it, whose system of reference is that of the points.

The raster "class" or the column "classification" is the class, by the numbers of ASPRS. Without one the raster or column "code"
becomes the class: 64 + code, since classes from 64 on are the user's own. The column "source" becomes the point source ID.
All others become extra attributes under their own labels.

Source: ASPRS, LAS Specification 1.4 - R15.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path

import laspy
import numpy as np
from laspy.vlrs.known import WktCoordinateSystemVlr
from pyproj.exceptions import CRSError

from orthomill.pipeline.export.reference_systems import las_wkt
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import Columns, Export
from orthomill.schemas.raster import RasterSpec, Window, tiles_of

SCALE = 0.001
"""m; LAS stores integers, and a millimetre is finer than the precision of any point here"""
OWN_CLASSES = 64
"""the first class of LAS that is the user's own; a code becomes the class this much higher"""
_PLACES = ("x", "y", "z")
_CLASSES = ("class", "classification")
_FIELDS = {**dict.fromkeys(_CLASSES, "classification"), "source": "point_source_id"}
"""labels that have a field of their own in LAS"""
Affine = tuple[float, float, float, float, float, float]
"""(a, b, c, d, e, f) of x = a col + b row + c, y = d col + e row + f, in GDAL's corner convention"""
_COLOUR_STEPS = {"uint8": 257, "uint16": 1}
"""LAS colours have 16 bits: times 257 maps 255 to 65535"""


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
    if not nests or rgb.crs != z.crs or len(rgb.shape) != 3 or rgb.shape[2] not in (3, 4) or rgb.dtype not in _COLOUR_STEPS:
        raise StoreError(
            f"The colours {rgb.name} do not fit {z.name}: they must be RGB or RGBA of 8 or 16 bits on a grid that shares its cell "
            "borders."
        )
    return Nesting(rgb, fine, coarse, round(row), round(col))


def write_points(export: Export, store: ReadableStore, path: Path) -> None:
    """Write `export` as LAZ: the rows of its tables, or the cells of its rasters.

    Raises StoreError for cells when "z" is missing or not georeferenced, and for rows when "rgb" is or a column of the place is.
    """
    if export.tables:
        _write_rows(export, store, path)
    else:
        _write_cells(export, store, path)


def _write_cells(export: Export, store: ReadableStore, path: Path) -> None:
    if "z" not in export.rasters:
        raise StoreError(f'{export.path} needs a raster called "z" for the heights; it has {", ".join(export.rasters) or "none"}.')
    specs = {label: store.spec(name) for label, name in export.rasters.items()}
    z = specs.pop("z")
    rgb = specs.pop("rgb", None)
    _check_same_grid(z, specs)
    header = _header(z, {label: (spec.dtype, spec.unit) for label, spec in specs.items()}, coloured=rgb is not None)
    colours = nesting(z, rgb) if rgb is not None else None
    with _opened(path, header) as target:
        part = export.window or z.full
        for tile in tiles_of(part.shape, max(z.chunk, 128)):
            window = replace(tile.window, row=part.row + tile.window.row, col=part.col + tile.window.col)
            _write_tile(target, store, Cloud(z, specs, colours), window)


def _opened(path: Path, header: laspy.LasHeader) -> laspy.LasWriter:
    return laspy.open(path, "w", header=header, do_compress=path.suffix == ".laz", laz_backend=laspy.LazBackend.Lazrs)


def _write_rows(export: Export, store: ReadableStore, path: Path) -> None:
    if "rgb" not in export.rasters:
        raise StoreError(f'{export.path} is made from tables and needs a raster called "rgb" for colours and the reference system.')
    rgb = store.spec(export.rasters["rgb"])
    first = _columns(export, store, 0)
    header = _header(
        rgb, {label: (str(values.dtype), "") for label, values in first.items() if label not in _PLACES}, coloured=True
    )
    with _opened(path, header) as target:
        for number in range(len(export.tables)):
            columns = first if number == 0 else _columns(export, store, number)
            if len(columns["x"]):
                points = _record(target.header, columns)
                _paint(points, _colours_above(store, rgb, columns["x"], columns["y"]), rgb.dtype)
                target.write_points(points)


def _columns(export: Export, store: ReadableStore, number: int) -> dict[str, np.ndarray]:
    """The columns of one table of an export. Raises StoreError when it has no place."""
    table = store.table(export.tables[number])
    columns = _fields_of(table)
    if export.beside:
        columns |= _fields_of(store.table(export.beside[number]))
    if missing := [name for name in _PLACES if name not in columns]:
        raise StoreError(
            f"{export.path} cannot be written from {export.tables[number].path}: it has no column {', '.join(missing)}."
        )
    return columns


def _fields_of(table: object) -> dict[str, np.ndarray]:
    return {f.name: getattr(table, f.name) for f in fields(table)} if isinstance(table, Columns) else {}


def _field_of(label: str, labels: Iterable[str]) -> str | None:
    """The field of LAS for a label among others; None for an extra attribute."""
    return "classification" if label == "code" and not set(labels) & set(_CLASSES) else _FIELDS.get(label)


def _colours_above(store: ReadableStore, rgb: RasterSpec, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(N, 3) colours, as stored, of the pixels that contain places (N,); 0 outside the raster and where it is transparent."""
    a, _, west, _, e, north = _affine(rgb)
    col, row = (np.floor(values).astype(np.int64) for values in ((x - west) / a, (y - north) / e))
    window = Window(int(row.min()), int(col.min()), int(row.max() - row.min()) + 1, int(col.max() - col.min()) + 1)
    pixels = _padded(store, rgb, window)[row - window.row, col - window.col]
    return pixels[:, :3] * (pixels[:, 3:] > 0) if pixels.shape[1] == 4 else pixels


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


def _header(place: RasterSpec, attributes: Mapping[str, tuple[str, str]], coloured: bool) -> laspy.LasHeader:
    """The header of points at the place of a raster; attributes: dtype and unit by label."""
    _, _, west, _, e, north = _affine(place)
    header = laspy.LasHeader(version="1.4", point_format=7 if coloured else 6)
    # No date, so that the same points always give the same bytes.
    header.generating_software, header.system_identifier, header.creation_date = "orthomill", "image matching", None
    header.scales = np.full(3, SCALE)
    # Coordinates are 32-bit integers: relative to a corner, millimetres reach 2000 km; northings are larger.
    header.offsets = np.floor([west, north + e * place.shape[0], 0.0])
    # Names and descriptions of extra dimensions have 32 bytes in the format.
    for label, (dtype, unit) in attributes.items():
        if _field_of(label, attributes) is None:
            header.add_extra_dim(laspy.ExtraBytesParams(label[:32], dtype, description=f"{label} {unit}"[:32].strip()))
    header.vlrs.append(WktCoordinateSystemVlr(_wkt(place)))
    header.global_encoding.wkt = True
    return header


def _record(header: laspy.LasHeader, columns: Mapping[str, np.ndarray]) -> laspy.ScaleAwarePointRecord:
    """Points from their places and attributes (N,) by label."""
    points = laspy.ScaleAwarePointRecord.zeros(len(columns["z"]), header=header)
    for label, values in columns.items():
        field = _field_of(label, columns)
        points[field or label[:32]] = _class(values) if field and label == "code" else values
    points["return_number"] = points["number_of_returns"] = np.ones(len(points), np.uint8)
    return points


def _class(codes: np.ndarray) -> np.ndarray:
    # In wide integers: in its own eight bits a large code would wrap round to a class that means something else.
    classes = codes.astype(np.int64) + OWN_CLASSES
    if len(classes) and (classes.min() < OWN_CLASSES or classes.max() > 255):
        raise StoreError(f"Codes of points must be between 0 and {255 - OWN_CLASSES}, so that each has a class of its own.")
    return classes.astype(np.uint8)


def _paint(points: laspy.ScaleAwarePointRecord, colours: np.ndarray, dtype: str) -> None:
    """Gives the points their colours (N, 3), of the range of `dtype`."""
    points["red"], points["green"], points["blue"] = (np.rint(colours).astype(np.uint16) * _COLOUR_STEPS[dtype]).T


def _wkt(z: RasterSpec) -> str:
    try:
        return las_wkt(str(z.crs))
    except CRSError as error:
        raise StoreError(f"{z.name} has the unknown coordinate system '{z.crs}'; use a known one, such as EPSG:2100.") from error


def _write_tile(target: laspy.LasWriter, store: ReadableStore, cloud: Cloud, window: Window) -> None:
    heights = store.read(cloud.z.name, window)
    present = np.isfinite(heights) & (heights != (np.nan if cloud.z.nodata is None else cloud.z.nodata))
    rows, cols = np.nonzero(present)
    if not len(rows):
        return
    a, _, west, _, e, north = _affine(cloud.z)
    x, y = west + (cols + window.col + 0.5) * a, north + (rows + window.row + 0.5) * e
    attributes = {label: store.read(spec.name, window)[present] for label, spec in cloud.attributes.items()}
    points = _record(target.header, {"x": x, "y": y, "z": heights[present], **attributes})
    if cloud.colours is not None:
        _paint(points, cloud.colours.colours(store, window)[present], cloud.colours.spec.dtype)
    target.write_points(points)
