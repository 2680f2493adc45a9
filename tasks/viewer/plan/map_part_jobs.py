"""The parts of the map, which are made side by side: image tiles of every layer, values, points in space, contours."""

from collections.abc import Iterator
from pathlib import PurePosixPath

from orthomill.schemas.job import Export, Job, Table
from orthomill.schemas.maps.map_page import MAP_PAGE, CloudLayer, ValueLayer
from orthomill.schemas.maps.map_parts import (
    CLOUD_FILE,
    LEVELS,
    PART,
    RIM,
    MapLayer,
    first_levels,
    layer_table,
    parts_at,
    shades_file,
    tiles_file,
    values_file,
)
from orthomill.schemas.raster import Tile, Window, tiles_of
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.stage_report import Picture

FINER = 1 << LEVELS
"""parts of the level below along a part"""


def map_parts(
    view: ProjectView,
    pictures: tuple[Picture, ...],
    values: tuple[ValueLayer, ...],
    cloud: CloudLayer | None,
    lines: dict[str, tuple[Table, ...]],
) -> Iterator[Job | Export]:
    """All of them; what others are made of comes first. `lines`: tables of lines by the file of their script."""
    for number, picture in enumerate(pictures):
        rows, cols = view.raster(picture.raster).shape[:2]
        yield from _layer(MapLayer(number=number, picture=picture, rows=rows, cols=cols))
    if values:
        yield from _values(view, values)
    if cloud is not None:
        rasters = {key: name for key in ("height", "code", "colours") if (name := getattr(cloud, key))}
        yield Export("viewer", "points", CLOUD_FILE, "map points", rasters, (MAP_PAGE,))
    for path, tables in lines.items():
        yield Export("viewer", PurePosixPath(path).stem, path, "map lines", {}, tables)


def told(layer: MapLayer) -> MapLayer:
    """What the parts of a layer are told, as a table."""
    return layer


def _layer(layer: MapLayer) -> Iterator[Job | Export]:
    shape = layer.rows, layer.cols
    for level in first_levels(shape):
        params = {"layer": layer.model_copy(update={"level": level})}
        writes = {"told": layer_table(layer.number, level)}
        item = f"layer{layer.number}-{level}"
        yield Job(stage="viewer", item=item, function=told, reads={}, writes=writes, params=params)
    yield from _finest(layer, shape)
    for level in first_levels(shape)[1:]:
        for part in parts_at(shape, level):
            yield _tiles(layer, level, part, {}, None, tuple(_finer(layer.number, shape, level, part)))


def _finest(layer: MapLayer, shape: tuple[int, int]) -> Iterator[Export]:
    """What is made of the raster itself."""
    shades, rasters = shades_file(layer.number), {"layer": layer.picture.raster}
    yield Export("viewer", f"layer{layer.number}-shades", shades, "map shades", rasters, (layer_table(layer.number, 0),))
    for part in parts_at(shape, 0):
        yield _tiles(layer, 0, part, rasters, part.window.grown(RIM).clipped(shape), (shades,))


def _tiles(
    layer: MapLayer, level: int, part: Tile, rasters: dict[str, str], window: Window | None, files: tuple[str, ...]
) -> Export:
    number, at = layer.number, (part.row, part.col)
    tables = (layer_table(number, level),)
    place = tiles_file(number, level, *at)
    item = f"layer{number}-tiles{level}"
    return Export("viewer", item, place, "map tiles", rasters, tables, window=window, files=files, row=at[0], col=at[1])


def _finer(number: int, shape: tuple[int, int], level: int, part: Tile) -> Iterator[str]:
    """The lists of the parts that a part above the finest level is made of."""
    below = level - LEVELS
    rows, cols = (-(-side // (PART << below)) for side in shape)
    for row in range(part.row * FINER, min(part.row * FINER + FINER, rows)):
        for col in range(part.col * FINER, min(part.col * FINER + FINER, cols)):
            yield tiles_file(number, below, row, col)


def _values(view: ProjectView, values: tuple[ValueLayer, ...]) -> Iterator[Export]:
    rasters = {f"{layer.name}.{key}": name for layer in values for key, name in layer.rasters.items()}
    for part in tiles_of(view.raster(next(iter(rasters.values()))).shape, PART):
        place = values_file(part.row, part.col)
        yield Export("viewer", "values", place, "map values", rasters, window=part.window, row=part.row, col=part.col)
