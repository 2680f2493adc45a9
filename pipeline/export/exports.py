"""Exports: the products of a run, made from whole rasters block by block.

Every file is written under a temporary name in its folder and renamed when it is complete, so that a file under its own name is
always complete. No more than one chunk of each raster is ever in memory.
"""

import csv
import io
import math
import os
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import fields
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar

import numpy as np
import rasterio
import rasterio.shutil
from lazrs import LazrsError
from pydantic import BaseModel
from rasterio.errors import NotGeoreferencedWarning, RasterioError

from orthomill.pipeline.export.conversions.sheet_index import Sheet, write_sheet_index
from orthomill.pipeline.export.file_parts import (
    COG_OF_PARTS,
    COG_OF_SHEETS,
    COG_PART,
    COG_SHEET,
    LAZ_OF_PARTS,
    LAZ_PART,
    sheet_tiles,
)
from orthomill.pipeline.export.geotiff.band_stack import Stack, describe, stack_of
from orthomill.pipeline.export.geotiff.cloud_geotiff import write_image, write_joined, write_part
from orthomill.pipeline.export.geotiff.virtual_raster import write_virtual
from orthomill.pipeline.export.vectors.geojson import write_geojson
from orthomill.pipeline.export.vectors.geopackage import write_geopackage
from orthomill.pipeline.export.vectors.map_drawing import write_drawing
from orthomill.pipeline.export.vectors.map_features import Layer, TableLines
from orthomill.pipeline.storage.depots.depot import Depot
from orthomill.pipeline.storage.depots.folder import PARTS, PRODUCTS, Folder
from orthomill.pipeline.storage.depots.kept_at import depot_of
from orthomill.pipeline.storage.depots.product_files import SHEET_INDEX, WHOLE
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.errors import ResourceError, StoreError
from orthomill.schemas.job import Columns, Export, FileBytes, Table
from orthomill.schemas.maps.coded_areas import CodedAreas
from orthomill.schemas.maps.map_lines import MapLines
from orthomill.schemas.memory import MIB
from orthomill.schemas.raster import RasterSpec, Window

GDAL_CACHE = 64 * MIB
"""GDAL's block cache, bytes: enough for a row of blocks of 100 thousand columns, and a bound on memory."""

_PASSING = {"compress": "zstd", "zstd_level": 1}
"""Compression of a temporary file: none would be a little faster, but could fill the disk."""

_SCRATCH = ".part"
"""how the names of temporary folders end"""
T = TypeVar("T")


def export(export: Export, store: ReadableStore, place: Path | Depot) -> tuple[str, ...]:
    """Write the file of `export` in the run's folder or depot, complete or not at all; its name there, none of a sheet without
    content, and in a folder the names of what lies beside it: a power cut may take any of it.

    Raises StoreError when its rasters or tables are missing or do not fit together, ResourceError when the disk refuses.
    """
    depot = depot_of(place)
    if export.format not in WRITERS:
        raise StoreError(f"{export.path} asks for the format '{export.format}'; known formats are {', '.join(sorted(WRITERS))}.")
    try:
        with depot.product(export.path) as path:
            WRITERS[export.format](export, store, path)
            left = path.exists()
            # An object store keeps what it has taken, and the list is sent last.
            beside = _tiles_beside(export, path) if left and isinstance(depot, Folder) else ()
        if export.format == "map":
            _remove_stale_tiles(export, store, depot)
        if not left:
            depot.delete(export.path)  # that of an earlier run
        return (export.path, *beside) if left else ()
    except (OSError, RasterioError, LazrsError) as error:
        raise ResourceError(
            f"{depot.address}/{export.path} cannot be written ({_first_line(error)}); make room on the disk or make the folder "
            "writable, then run again."
        ) from error


def _tiles_beside(export: Export, path: Path) -> tuple[str, ...]:
    from orthomill.pipeline.export.viewer.tile_files import tile_files

    return tile_files(export, path)


def _remove_stale_tiles(export: Export, store: ReadableStore, depot: Depot) -> None:
    from orthomill.pipeline.export.viewer.viewer_page import remove_stale

    remove_stale(export, store, depot)


def sweep_products(folder: Path) -> None:
    """Remove what exports left that were killed; nothing may be writing in the run's `folder` now."""
    for place in (PRODUCTS, PARTS):
        for scratch in list((folder / place).rglob(f".*{_SCRATCH}")):
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


def _write_cog(export: Export, store: ReadableStore, path: Path) -> None:
    stack = stack_of(export, store)
    with _gdal(), _renamed_when_whole(path) as temporary:
        write_image(stack, store, stack.first.full, temporary, temporary.parent)
    _write_world_file(stack, path)


def _write_cog_part(export: Export, store: ReadableStore, path: Path) -> None:
    stack = stack_of(export, store)
    with _gdal(), _renamed_when_whole(path) as temporary:
        write_part(stack, store, _window_of(export), temporary, temporary.parent)


def _write_cog_sheet(export: Export, store: ReadableStore, path: Path) -> None:
    stack = stack_of(export, store)
    with _gdal(), _renamed_when_whole(path) as temporary:
        holds = write_image(stack, store, _window_of(export), temporary, temporary.parent)
    if not holds:
        path.unlink()


def _window_of(export: Export) -> Window:
    assert export.window is not None, "the planner names the window of every part"
    return export.window


def _write_cog_of_sheets(export: Export, store: ReadableStore, path: Path) -> None:
    stack, folder = stack_of(export, store), PurePosixPath(export.files[0]).parent
    there = set(store.file_names(folder.as_posix()))
    planned = zip(map(PurePosixPath, export.files), sheet_tiles(stack.first), strict=True)
    windows = {file.name: tile.window for file, tile in planned if file.name in there}
    with _gdal(), _renamed_when_whole(path) as temporary:
        write_virtual(stack, {f"{folder.name}/{name}": window for name, window in windows.items()}, temporary)
    index = path.parent / folder.name / SHEET_INDEX
    index.parent.mkdir(exist_ok=True)
    sheets = [Sheet(name.removesuffix(WHOLE), stack.bounds(window)) for name, window in windows.items()]
    with _renamed_when_whole(index) as temporary:
        write_sheet_index(temporary, sheets, WHOLE, stack.first.crs)


def _write_cog_of_parts(export: Export, store: ReadableStore, path: Path) -> None:
    stack = stack_of(export, store)
    with _gdal(), _renamed_when_whole(path) as temporary, ExitStack() as opened:
        parts = [opened.enter_context(store.local(part)) for part in export.files]
        write_joined(stack, parts, temporary, temporary.parent)
    _write_world_file(stack, path)


def _write_world_file(stack: Stack, path: Path) -> None:
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
        describe(target, stack)
        target.update_tags(**stack.first.tags)
        for window in stack.windows():
            place = rasterio.windows.Window(window.col, window.row, window.width, window.height)
            target.write(stack.read(store, window), window=place)


def _write_laz(export: Export, store: ReadableStore, path: Path) -> None:
    with _renamed_when_whole(path) as temporary:
        # Read where it is asked for: laspy brings 23 MiB into the command and into every worker, of which few write point clouds.
        from orthomill.pipeline.export.point_cloud import write_points

        write_points(export, store, temporary)


def _write_laz_of_parts(export: Export, store: ReadableStore, path: Path) -> None:
    with _renamed_when_whole(path) as temporary, ExitStack() as opened:
        parts = [opened.enter_context(store.local(part)) for part in export.files]
        from orthomill.pipeline.export.clouds.joined_cloud import write_joined_cloud

        write_joined_cloud(parts, temporary, temporary.parent)


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
    """The lines of the tables of an export, under the name of its file; one table is in memory at a time."""
    lines = TableLines(len(export.tables), lambda place: _table_of(export, store, export.tables[place], MapLines))
    return Layer(Path(export.path).stem, "line", lines)


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
    COG_PART: _write_cog_part,
    COG_OF_PARTS: _write_cog_of_parts,
    COG_SHEET: _write_cog_sheet,
    COG_OF_SHEETS: _write_cog_of_sheets,
    "tiff": _write_tiff,
    "png": _write_png,
    **dict.fromkeys(("laz", LAZ_PART), _write_laz),
    LAZ_OF_PARTS: _write_laz_of_parts,
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
