"""Exports: the products of a run, made from whole rasters block by block.

Every file is written under a temporary name in its folder and renamed when it is complete, so that a file under its own name is
always complete. A COG is written first as a tiled GeoTIFF, one chunk at a time, and then copied by GDAL's COG driver: less time and
memory than writing the COG directly. No more than one chunk of each raster is ever in memory.
"""

import csv
import io
import math
import os
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import rasterio
import rasterio.shutil
from lazrs import LazrsError
from pydantic import BaseModel
from rasterio.enums import ColorInterp
from rasterio.errors import NotGeoreferencedWarning, RasterioError

from orthomill.pipeline.export.point_cloud import write_points
from orthomill.pipeline.export.reference_systems import geotiff_wkt, plan_in_file, with_system
from orthomill.pipeline.export.vectors.geojson import write_geojson
from orthomill.pipeline.export.vectors.geopackage import write_geopackage
from orthomill.pipeline.export.vectors.map_drawing import write_drawing
from orthomill.pipeline.export.vectors.map_features import Layer, line_features
from orthomill.pipeline.storage.depots.depot import Depot
from orthomill.pipeline.storage.depots.kept_at import depot_of
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.errors import ResourceError, StoreError
from orthomill.schemas.job import Columns, Export, FileBytes, Table
from orthomill.schemas.maps.coded_areas import CodedAreas
from orthomill.schemas.maps.map_lines import MapLines
from orthomill.schemas.memory import MIB
from orthomill.schemas.raster import RasterSpec, Window, tiles_of

GDAL_CACHE = 64 * MIB
"""GDAL's block cache, bytes: enough for a row of blocks of 100 thousand columns, and a bound on memory."""

_PASSING = {"compress": "zstd", "zstd_level": 1}
"""Compression of a temporary file: none would be a little faster, but could fill the disk."""

_SCRATCH = ".part"
"""how the names of temporary folders end"""
T = TypeVar("T")

COLOURS = {3: ("red", "green", "blue"), 4: ("red", "green", "blue", "alpha")}


def export(export: Export, store: ReadableStore, place: Path | Depot) -> None:
    """Write the file of `export` in the run's folder or depot, complete or not at all.

    Raises StoreError when its rasters or tables are missing or do not fit together, ResourceError when the disk refuses.
    """
    depot = depot_of(place)
    if export.format not in WRITERS:
        raise StoreError(f"{export.path} asks for the format '{export.format}'; known formats are {', '.join(sorted(WRITERS))}.")
    try:
        with depot.product(export.path) as path:
            WRITERS[export.format](export, store, path)
        if export.format == "map":
            _remove_stale_tiles(export, store, depot)
    except (OSError, RasterioError, LazrsError) as error:
        raise ResourceError(
            f"{depot.address}/{export.path} cannot be written ({_first_line(error)}); make room on the disk or make the folder "
            "writable, then run again."
        ) from error


def _remove_stale_tiles(export: Export, store: ReadableStore, depot: Depot) -> None:
    from orthomill.pipeline.export.viewer.viewer_page import remove_stale

    remove_stale(export, store, depot)


def sweep_products(folder: Path) -> None:
    """Remove what exports left that were killed; nothing may be writing in the run's `folder` now."""
    for scratch in list((folder / "products").rglob(f".*{_SCRATCH}")):
        shutil.rmtree(scratch, ignore_errors=True)


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]


@contextmanager
def _renamed_when_whole(path: Path) -> Iterator[Path]:
    """A temporary path next to `path`, renamed to it at the end; a failure leaves nothing behind."""
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.", suffix=_SCRATCH) as scratch:
        temporary = Path(scratch) / path.name
        yield temporary
        os.replace(temporary, path)


@contextmanager
def _gdal() -> Iterator[None]:
    """GDAL with a bounded cache and without warnings about photographs, which are not georeferenced."""
    with rasterio.Env(GDAL_CACHEMAX=GDAL_CACHE), warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        yield


# --- rasters -----------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Stack:
    """Rasters on one grid, stacked as bands of one dtype with one nodata value."""

    specs: dict[str, RasterSpec]
    dtype: np.dtype
    nodata: float | None

    @property
    def first(self) -> RasterSpec:
        """The raster of the first band, whose grid is that of all."""
        return next(iter(self.specs.values()))

    @property
    def chunk(self) -> int:
        """Side of the windows that are written, px."""
        return max(self.first.chunk, 128)

    @property
    def bands(self) -> int:
        """Number of bands of all rasters."""
        return sum(_bands(spec) for spec in self.specs.values())

    @property
    def is_picture(self) -> bool:
        """Whether this is one raster of 3 or 4 unsigned integer bands: red, green, blue and perhaps alpha."""
        return len(self.specs) == 1 and self.bands in COLOURS and self.dtype.kind == "u"

    @property
    def has_codes(self) -> bool:
        """Whether some band holds integer codes, whose mean has no meaning."""
        return not self.is_picture and any(np.dtype(spec.dtype).kind in "ui" for spec in self.specs.values())

    def windows(self) -> Iterator[Window]:
        """The windows that cover the grid."""
        return (tile.window for tile in tiles_of(self.first.shape, self.chunk))

    def read(self, store: ReadableStore, window: Window) -> np.ndarray:
        """(bands, height, width) of a window, in the stack's dtype and nodata."""
        return np.concatenate([self._bands_of(store, spec, window) for spec in self.specs.values()])

    def _bands_of(self, store: ReadableStore, spec: RasterSpec, window: Window) -> np.ndarray:
        values = store.read(spec.name, window)
        bands = values[None] if values.ndim == 2 else np.moveaxis(values, 2, 0)
        converted = bands.astype(self.dtype, copy=False)
        # Bands with different nodata values share NaN; a nodata of NaN needs no replacement, and is not equal to itself.
        if spec.nodata is not None and spec.nodata == spec.nodata and self.nodata != self.nodata:
            converted = np.where(bands == spec.nodata, self.dtype.type(np.nan), converted)
        return converted

    def descriptions(self) -> Iterator[tuple[str, str]]:
        """(description, unit) of every band."""
        for label, spec in self.specs.items():
            names = COLOURS[self.bands] if self.is_picture else _band_names(label, _bands(spec))
            yield from ((f"{name} ({spec.unit})" if spec.unit else name, spec.unit) for name in names)


def _bands(spec: RasterSpec) -> int:
    return spec.shape[2] if len(spec.shape) == 3 else 1


def _band_names(label: str, bands: int) -> list[str]:
    return [label] if bands == 1 else [f"{label} {number + 1}" for number in range(bands)]


def stack_of(export: Export, store: ReadableStore) -> Stack:
    """The rasters of `export` as one stack: their common dtype and nodata, or float32 with NaN where they differ.

    Raises StoreError when there are none or when they are not on one grid.
    """
    specs = {label: store.spec(name) for label, name in export.rasters.items()}
    if not specs:
        raise StoreError(f"{export.path} names no raster; an export as {export.format} needs at least one.")
    first = next(iter(specs.values()))
    for spec in specs.values():
        if (spec.shape[:2], spec.transform, spec.crs) != (first.shape[:2], first.transform, first.crs):
            raise StoreError(
                f"{export.path} combines {first.name} and {spec.name}, which are on different grids; export them to separate files."
            )
    return Stack(specs, *_type_and_nodata(tuple(specs.values())))


def _type_and_nodata(specs: tuple[RasterSpec, ...]) -> tuple[np.dtype, float | None]:
    alike = len({(spec.dtype, str(spec.nodata)) for spec in specs}) == 1
    dtype = np.dtype(specs[0].dtype) if alike else np.dtype(np.float32)
    if not alike and all(np.dtype(spec.dtype).kind == "u" and spec.nodata is None for spec in specs):
        return np.result_type(*(spec.dtype for spec in specs)), None
    if dtype.kind == "f":
        return dtype, specs[0].nodata if alike and specs[0].nodata is not None else math.nan
    return dtype, specs[0].nodata


def _write_cog(export: Export, store: ReadableStore, path: Path) -> None:
    stack = stack_of(export, store)
    with _gdal(), _renamed_when_whole(path) as temporary:
        plain = temporary.with_suffix(".plain.tif")
        profile = {"crs": plan_in_file(stack.first.crs), "nodata": stack.nodata}
        if stack.first.transform is not None:
            profile["transform"] = rasterio.Affine(*stack.first.transform)
        _write_tiled(stack, store, plain, profile | _PASSING)
        heights = geotiff_wkt(stack.first.crs)
        # The predictor halves the size of heights; nearest overviews for codes, since the mean of two codes is a third one.
        rasterio.shutil.copy(
            with_system(plain, heights) if heights else plain,
            temporary,
            driver="COG",
            compress="deflate",
            level=1,
            predictor="yes",
            blocksize=512,
            overview_resampling="nearest" if stack.has_codes else "average",
            bigtiff="if_safer",
            statistics="no" if stack.is_picture else "yes",
        )
    if stack.first.crs is None and stack.first.transform is not None:
        write_whole(path.with_suffix(".tfw"), world_file(stack.first.transform).encode())


def world_file(transform: tuple[float, float, float, float, float, float]) -> str:
    """The six lines of a world file, for programs that read no coordinates of a GeoTIFF without a reference system."""
    a, b, c, d, e, f = transform
    # Of the centre of the upper left pixel, where the transform has its corner.
    return "".join(f"{value:.12g}\n" for value in (a, d, b, e, c + 0.5 * (a + b), f + 0.5 * (d + e)))


def _write_tiff(export: Export, store: ReadableStore, path: Path) -> None:
    stack = stack_of(export, store)
    if len(stack.specs) != 1:
        raise StoreError(f"{export.path} is a plain TIFF of {len(stack.specs)} rasters, but it can hold exactly one.")
    with _gdal(), _renamed_when_whole(path) as temporary:
        # TIFF: 3 is the floating point predictor, 2 horizontal differencing of integers.
        predictor = 3 if stack.dtype.kind == "f" else 2
        _write_tiled(stack, store, temporary, {"compress": "deflate", "zlevel": 1, "predictor": predictor})


def _write_png(export: Export, store: ReadableStore, path: Path) -> None:
    stack = stack_of(export, store)
    if not stack.is_picture:
        raise StoreError(f"{export.path} is a picture, which needs one raster of 3 or 4 bands; export it as a GeoTIFF.")
    with _gdal(), _renamed_when_whole(path) as temporary:
        plain = temporary.with_suffix(".plain.tif")
        _write_tiled(stack, store, plain, dict(_PASSING))
        rasterio.shutil.copy(plain, temporary, driver="PNG", zlevel=6)
        # GDAL puts what it knows of the bands beside the picture.
        temporary.with_name(f"{temporary.name}.aux.xml").unlink(missing_ok=True)


def _write_tiled(stack: Stack, store: ReadableStore, path: Path, profile: dict) -> None:
    """A tiled GeoTIFF, one chunk of the store at a time."""
    # Blocks divide the chunks, so that each block is compressed once; a block must be a multiple of 16.
    block = math.gcd(stack.chunk, 512)
    profile = profile | {
        "driver": "GTiff",
        "height": stack.first.shape[0],
        "width": stack.first.shape[1],
        "count": stack.bands,
        "dtype": stack.dtype,
        "tiled": True,
        "blockxsize": max(block, 64),
        "blockysize": max(block, 64),
        "interleave": "pixel",
        "bigtiff": "if_safer",
    }
    if stack.is_picture:
        profile["photometric"] = "rgb"
    with rasterio.open(path, "w", **profile) as target:
        # Descriptions first: GDAL writes the directory before the pixels then, and need not append it again.
        _describe(target, stack)
        target.update_tags(**stack.first.tags)
        for window in stack.windows():
            place = rasterio.windows.Window(window.col, window.row, window.width, window.height)
            target.write(stack.read(store, window), window=place)


def _describe(target: rasterio.io.DatasetWriter, stack: Stack) -> None:
    if stack.is_picture:
        target.colorinterp = [ColorInterp[name] for name in COLOURS[stack.bands]]
    for band, (description, unit) in enumerate(stack.descriptions(), start=1):
        target.set_band_description(band, description)
        target.set_band_unit(band, unit)


def _write_laz(export: Export, store: ReadableStore, path: Path) -> None:
    with _renamed_when_whole(path) as temporary:
        write_points(export, store, temporary)


def _write_xyz(export: Export, store: ReadableStore, path: Path) -> None:
    """X, Y and the first band of the one raster, one line for every cell that has a value, in millimetres."""
    stack = stack_of(export, store)
    if len(stack.specs) != 1 or stack.first.transform is None:
        raise StoreError(f"{export.path} is a list of places, which needs exactly one raster on the map.")
    cell, _, west, _, _, north = stack.first.transform
    with _renamed_when_whole(path) as temporary, temporary.open("w", encoding="ascii", newline="\n") as target:
        for window in stack.windows():
            heights = store.read(stack.first.name, window)
            heights = heights if heights.ndim == 2 else heights[..., 0]
            row, col = np.nonzero(np.isfinite(heights))
            x, y = west + (window.col + col + 0.5) * cell, north - (window.row + row + 0.5) * cell
            np.savetxt(target, np.column_stack([x, y, heights[row, col]]), fmt="%.3f")


# --- tables ------------------------------------------------------------------------------------------------------------------


def _write_gpkg(export: Export, store: ReadableStore, path: Path) -> None:
    with _renamed_when_whole(path) as temporary:
        write_geopackage(temporary, (_line_layer(export, store),), _place_of(export, store).crs)


def _write_dxf(export: Export, store: ReadableStore, path: Path) -> None:
    with _renamed_when_whole(path) as temporary:
        write_drawing(temporary, (_line_layer(export, store),))


def _write_geojson(export: Export, store: ReadableStore, path: Path) -> None:
    with _renamed_when_whole(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as target:
        write_geojson(target, (_line_layer(export, store),), _place_of(export, store).crs)


def _write_map(export: Export, store: ReadableStore, path: Path) -> None:
    # Loaded when it is asked for: matplotlib, which no other export needs.
    from orthomill.pipeline.export.viewer.map_writers import MAP_WRITERS

    MAP_WRITERS[export.format](export, store, path)


def _write_areas(export: Export, store: ReadableStore, path: Path) -> None:
    from orthomill.pipeline.export.vectors.area_outlines import area_layer

    codes = export.rasters.get("codes")
    if codes is None:
        raise StoreError(f'{export.path} is made of areas and needs a raster called "codes".')
    layer = area_layer(path.stem, store, codes, _the_table(export, store, CodedAreas))
    with _renamed_when_whole(path) as temporary:
        write_geopackage(temporary, (layer,), store.spec(codes).crs)


def _line_layer(export: Export, store: ReadableStore) -> Layer:
    """The lines of the tables of an export, under the name of its file."""
    tables = (_table_of(export, store, table, MapLines) for table in export.tables)
    return Layer(Path(export.path).stem, "line", tuple(feature for table in tables for feature in line_features(table)))


def _place_of(export: Export, store: ReadableStore) -> RasterSpec:
    if "place" not in export.rasters:
        raise StoreError(f'{export.path} is made from a table and needs a raster called "place" for the reference system.')
    return store.spec(export.rasters["place"])


def _write_json(export: Export, store: ReadableStore, path: Path) -> None:
    write_whole(path, (_the_table(export, store, BaseModel).model_dump_json(indent=2) + "\n").encode())


def _write_csv(export: Export, store: ReadableStore, path: Path) -> None:
    write_whole(path, csv_text(_the_table(export, store, Columns)).encode())


def _write_text(export: Export, store: ReadableStore, path: Path) -> None:
    table = _the_table(export, store, BaseModel)
    text = getattr(table, "text", None)
    if not isinstance(text, str):
        raise StoreError(f"{export.path} is a text, but {export.tables[0].path} has no text; export it as json instead.")
    write_whole(path, text.encode())


def _write_bytes(export: Export, store: ReadableStore, path: Path) -> None:
    write_whole(path, _the_table(export, store, FileBytes).content.tobytes())


def _the_table(export: Export, store: ReadableStore, kind: type[T]) -> T:
    """The one table of an export. Raises StoreError when there is not exactly one, or when it is not of the kind `kind`."""
    if len(export.tables) != 1:
        raise StoreError(f"{export.path} needs exactly one table, but names {len(export.tables)}.")
    return _table_of(export, store, export.tables[0], kind)


def _table_of(export: Export, store: ReadableStore, table: Table, kind: type[T]) -> T:
    """A table of an export. Raises StoreError when it is not of the kind `kind`."""
    value: Any = store.table(table)
    if not isinstance(value, kind):
        raise StoreError(f"{export.path} cannot be written as {export.format} from {table.path}; choose another format.")
    return value


def csv_text(columns: Columns) -> str:
    """A `Columns` as CSV: a header of field names, floats in the fewest digits that read back to the same number."""
    names = [f.name for f in fields(columns)]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(zip(*(_cells(np.asarray(getattr(columns, name))) for name in names), strict=True))
    return out.getvalue()


def _cells(values: np.ndarray) -> list[Any]:
    # str of a float32 gives its own shortest digits; tolist would give those of the nearest float64: 0.10000000149011612.
    return [str(value) for value in values] if values.dtype.kind == "f" else values.tolist()


WRITERS: dict[str, Callable[[Export, ReadableStore, Path], None]] = {
    "cog": _write_cog,
    "tiff": _write_tiff,
    "png": _write_png,
    "laz": _write_laz,
    "json": _write_json,
    "csv": _write_csv,
    "text": _write_text,
    "bytes": _write_bytes,
    "xyz": _write_xyz,
    "gpkg": _write_gpkg,
    "dxf": _write_dxf,
    "geojson": _write_geojson,
    **dict.fromkeys(("map", "map shades", "map tiles", "map values", "map points", "map lines"), _write_map),
    "areas": _write_areas,
}
