"""GeoTIFFs for the cloud, of a whole raster, of a sheet or part of it, and of parts.

The tiles of every level are compressed by GDAL into a file of that level, and copied into the file as they are, in much less time
than GDAL's own driver for such files takes. A part is a file like any other, with as many levels as the whole has up to one tile a
part; the whole is made of the parts' compressed tiles and of the levels above.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import rasterio
import rasterio.shutil

from orthomill.pipeline.export.geotiff.band_stack import Stack, describe
from orthomill.pipeline.export.geotiff.band_statistics import BandStatistics, none_yet, of_tags, of_tile
from orthomill.pipeline.export.geotiff.cloud_layout import LEVELS, PART, TILE, Level, resized, row_by_row, tiles_in, write_layout
from orthomill.pipeline.export.geotiff.overviews import Pyramid, Shape, level_shapes, valid_in
from orthomill.pipeline.export.geotiff.tiff_directory import LONG, REDUCED, Directory, directories, field
from orthomill.pipeline.export.reference_systems import geotiff_wkt, plan_in_file, with_system
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.raster import Window, tiles_of

_SPARE = 16
"""side of the file from which the description is taken, px"""
_PIXELS = {254, 256, 257, 258, 259, 273, 277, 278, 279, 284, 317, 322, 323, 324, 325, 339}
"""tags that tell how pixels are held; all others tell what they are"""
_OF_ALL_LEVELS = {262, 338, 42113}
"""tags that overviews have as well: colours, transparency, GDAL's of the value of no data"""


def write_image(stack: Stack, store: ReadableStore, window: Window, path: Path, scratch: Path) -> bool:
    """The file of a window of the raster, all of it or a sheet, with its overviews; whether it holds more than what is shown where
    there is no file. Raises OSError, RasterioError."""
    return _write_window(stack, store, window, level_shapes(window.shape), path, scratch)


def write_part(stack: Stack, store: ReadableStore, window: Window, path: Path, scratch: Path) -> None:
    """The file of a window that is joined with others: with the levels that do not need these. Raises OSError, RasterioError."""
    number = min(len(level_shapes(stack.first.full.shape)), LEVELS + 1)
    _write_window(stack, store, window, [_shape_at(window.shape, level) for level in range(number)], path, scratch)


def _write_window(stack: Stack, store: ReadableStore, window: Window, shapes: list[Shape], path: Path, scratch: Path) -> bool:
    gathered, holds = none_yet(stack.bands), False

    def finest(row: int, col: int) -> np.ndarray:
        nonlocal gathered, holds
        values = read(row, col)
        holds = holds or not stack.is_blank(values)
        if not stack.is_picture:
            gathered = gathered.joined(of_tile(values, valid_in(stack, values)))
        return values

    read = _read_once(stack, store, window)
    files = _write_levels(stack, shapes, finest, scratch)
    about = _about(stack, window, gathered, scratch)
    found = [directories(file)[0] for file in files]
    levels = [Level(one, (tiles_in(file, one),)) for file, one in zip(files, found, strict=True)]
    write_layout(path, _described(levels, about))
    return holds


def write_joined(stack: Stack, parts: list[Path], path: Path, scratch: Path) -> None:
    """The file of a whole raster from those of its parts, row by row. Raises OSError, RasterioError."""
    shapes = level_shapes(stack.first.full.shape)
    tiles = list(tiles_of(stack.first.shape, PART))
    found = [directories(part) for part in parts]
    levels = []
    for level in range(LEVELS + 1):
        side = (PART >> level) // TILE
        held = [tiles_in(p, d[level], t.row * side, t.col * side, True) for p, d, t in zip(parts, found, tiles, strict=True)]
        levels.append(Level(resized(found[0][level], shapes[level]), row_by_row(held)))
    across = -(-stack.first.shape[1] // PART)
    with rasterio.Env(GDAL_DISABLE_READDIR_ON_OPEN="EMPTY_DIR"):
        smallest = lambda row, col: _smallest(parts[row * across + col])  # noqa: E731
        files = _write_levels(stack, shapes[LEVELS:], smallest, scratch)[1:]
    above = [(file, directories(file)[0]) for file in files]
    levels += [Level(one, (tiles_in(file, one),)) for file, one in above]
    about = _about(stack, stack.first.full, _statistics(parts), scratch)
    write_layout(path, _described(levels, about))


def _shape_at(shape: Shape, level: int) -> Shape:
    return -(-shape[0] >> level), -(-shape[1] >> level)


def _read_once(stack: Stack, store: ReadableStore, window: Window) -> Callable[[int, int], np.ndarray]:
    """Tiles of a window by row and column, read in blocks as large as chunks: the order of a pyramid leaves a block only when it
    needs it no more."""
    side = TILE
    while side < min(stack.chunk, PART):
        side *= 2
    held: dict[tuple[int, int], np.ndarray] = {}

    def tile(row: int, col: int) -> np.ndarray:
        at = row * TILE // side, col * TILE // side
        if at not in held:
            held.clear()
            place = Window(window.row + at[0] * side, window.col + at[1] * side, side, side)
            held[at] = stack.read(store, place.overlap(window))
        top, left = row * TILE - at[0] * side, col * TILE - at[1] * side
        return held[at][:, top : top + TILE, left : left + TILE]

    return tile


def _write_levels(stack: Stack, shapes: list[Shape], finest: Callable[[int, int], np.ndarray], scratch: Path) -> list[Path]:
    """A file for every level, in which GDAL has compressed its tiles."""
    files = [scratch / f"level{number}.tif" for number in range(len(shapes))]
    with ExitStack() as opened:
        targets = [opened.enter_context(_opened(stack, shape, file)) for shape, file in zip(shapes, files, strict=True)]

        def keep(level: int, row: int, col: int, values: np.ndarray) -> None:
            height, width = values.shape[1:]
            targets[level].write(values, window=rasterio.windows.Window(col * TILE, row * TILE, width, height))

        Pyramid(stack, shapes, finest, keep).make()
    return files


def _opened(stack: Stack, shape: Shape, file: Path, side: int = TILE, **more: object) -> rasterio.io.DatasetWriter:
    profile = {
        "driver": "GTiff",
        "height": shape[0],
        "width": shape[1],
        "count": stack.bands,
        "dtype": stack.dtype,
        "nodata": stack.nodata,
        "tiled": True,
        "blockxsize": side,
        "blockysize": side,
        "interleave": "pixel",
        "compress": "deflate",
        "zlevel": 1,
        # It halves the size of heights. TIFF: 3 is the floating point predictor, 2 horizontal differencing of integers.
        "predictor": 3 if stack.dtype.kind == "f" else 2,
        "bigtiff": "if_safer",
        "endianness": "little",
    }
    if stack.is_picture:
        profile["photometric"] = "rgb"
    return rasterio.open(file, "w", **(profile | more))


def _about(stack: Stack, window: Window, statistics: BandStatistics, scratch: Path) -> Directory:
    """The fields that tell what the pixels are, as GDAL writes them: reference system, place, bands, statistics."""
    told = directories(described_file(stack, window, statistics, scratch))[0]
    return {tag: one for tag, one in told.items() if tag not in _PIXELS}


def described_file(stack: Stack, window: Window, statistics: BandStatistics | None, scratch: Path) -> Path:
    """A small file of no pixels that tells what those of a window are."""
    file, profile = scratch / "about.tif", {"crs": plan_in_file(stack.first.crs)}
    if stack.first.transform is not None:
        a, b, c, d, e, f = stack.first.transform
        profile["transform"] = rasterio.Affine(a, b, c + a * window.col + b * window.row, d, e, f + d * window.col + e * window.row)
    with _opened(stack, (_SPARE, _SPARE), file, _SPARE, **profile) as target:
        describe(target, stack)
        target.update_tags(**stack.first.tags)
        for band, tags in enumerate(statistics.tags(window.cells) if statistics and not stack.is_picture else (), start=1):
            target.update_tags(band, **tags)
    if heights := geotiff_wkt(stack.first.crs):
        rasterio.shutil.copy(with_system(file, heights), file := scratch / "system.tif", driver="GTiff")
    return file


def _described(levels: list[Level], about: Directory) -> list[Level]:
    """The first level with all that is known, the others as reduced images of it."""
    told = [_pixels(level) | about if level is levels[0] else _pixels(level) | _reduced(about) for level in levels]
    return [Level(directory, level.tiles) for directory, level in zip(told, levels, strict=True)]


def _pixels(level: Level) -> Directory:
    return {tag: one for tag, one in level.directory.items() if tag in _PIXELS and tag != REDUCED}


def _reduced(about: Directory) -> Directory:
    return {tag: one for tag, one in about.items() if tag in _OF_ALL_LEVELS} | {REDUCED: field(LONG, 1)}


def _smallest(part: Path) -> np.ndarray:
    with rasterio.open(part, overview_level=LEVELS - 1) as image:
        return np.asarray(image.read())


def _statistics(parts: list[Path]) -> BandStatistics:
    return _joined(of_tags([image.tags(band) for band in image.indexes], image.width * image.height) for image in _images(parts))


def _images(parts: list[Path]) -> Iterator[rasterio.io.DatasetReader]:
    for part in parts:
        with rasterio.open(part) as image:
            yield image


def _joined(found: Iterator[BandStatistics]) -> BandStatistics:
    total = next(found)
    for one in found:
        total = total.joined(one)
    return total
