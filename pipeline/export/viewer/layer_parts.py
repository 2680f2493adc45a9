"""What a layer of the map is made of: its shades, of the whole raster, and its image tiles, part by part."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from orthomill.pipeline.export.viewer.painted_tiles import painted, shades_of
from orthomill.pipeline.export.viewer.tile_pyramid import TilePyramid, pixels_of
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.job import Export
from orthomill.schemas.maps.map_parts import FOLDER, TILE, MapLayer, Shades, WrittenTiles, shades_file
from orthomill.schemas.raster import Window


def write_shades(export: Export, store: ReadableStore, path: Path) -> None:
    """The `Shades` of the layer that the export's table tells of."""
    layer = _layer(export, store)
    write_whole(path, shades_of(store, layer.picture).model_dump_json().encode())


def write_tiles(export: Export, store: ReadableStore, path: Path) -> None:
    """The tiles of a part, beside the folder of `path`, and their names with those of the finer parts in it."""
    layer = _layer(export, store)
    finer = [WrittenTiles.model_validate_json(store.file(file)) for file in export.files if file != shades_file(layer.number)]
    source = _of_files(layer, store, finer) if layer.level else _of_raster(layer, store)
    pyramid = TilePyramid(layer, source, path.parents[1])
    pyramid.write(export.row, export.col)
    names = {level: list(found) for level, found in pyramid.names.items()}
    for part in finer:
        for level, found in part.names.items():
            names.setdefault(level, []).extend(found)
    written = WrittenTiles(names={level: tuple(sorted(names[level])) for level in sorted(names)})
    write_whole(path, written.model_dump_json().encode())


def _layer(export: Export, store: ReadableStore) -> MapLayer:
    (table,) = export.tables
    layer = store.table(table)
    assert isinstance(layer, MapLayer)
    return layer


def _of_raster(layer: MapLayer, store: ReadableStore) -> Callable[[int, int], np.ndarray]:
    """Tiles of the raster itself, by row and column."""
    raster = painted(store, layer.picture, Shades.model_validate_json(store.file(shades_file(layer.number))))

    def tile(row: int, col: int) -> np.ndarray:
        window = Window(row * TILE, col * TILE, TILE, TILE).clipped(raster.spec.shape)
        out = np.zeros((TILE, TILE, 4), np.uint8)
        out[: window.height, : window.width] = raster.tile(store, window)
        return out

    return tile


def _of_files(layer: MapLayer, store: ReadableStore, finer: list[WrittenTiles]) -> Callable[[int, int], np.ndarray]:
    """Tiles of the level below that finer parts have written, by row and column."""
    below = layer.level - 1
    files = {Path(name).stem: f"{FOLDER}/{layer.number}/{below}/{name}" for part in finer for name in part.names.get(below, ())}

    def tile(row: int, col: int) -> np.ndarray:
        name = files.get(f"{row}-{col}")
        return np.zeros((TILE, TILE, 4), np.uint8) if name is None else pixels_of(store.file(name))

    return tile
