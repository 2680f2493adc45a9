"""The map of a run: `products/index.html`, of the parts that lie beside it already."""

import json
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path
from typing import Any

from orthomill.pipeline.export.viewer.painted_tiles import legend_of
from orthomill.pipeline.export.viewer.tile_pyramid import runs_of
from orthomill.pipeline.export.viewer.value_tiles import SIZE
from orthomill.pipeline.storage.depots.depot import Depot
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import Export
from orthomill.schemas.maps.map_page import MapPage
from orthomill.schemas.maps.map_parts import (
    CLOUD_FILE,
    EDGES_FILE,
    FOLDER,
    LINES_FILE,
    PAGE,
    TILE,
    VALUES,
    Shades,
    WrittenTiles,
    first_levels,
    last_tiles_file,
    parts_at,
    shades_file,
    tiles_file,
)
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.stage_report import Picture

_BESIDE = str(Path(FOLDER).relative_to(Path(PAGE).parent))
"""the folder of all parts, as the page names it"""
_TEMPLATES = files("orthomill.pipeline.export.viewer") / "templates"


def write_page(export: Export, store: ReadableStore, path: Path) -> None:
    """The page, when all its parts are there. Raises StoreError when one of them, or a raster, is not."""
    (table,) = export.tables
    page = store.table(table)
    if not isinstance(page, MapPage):
        raise StoreError(f"{export.path} is a map, which needs a page as its table.")
    data: dict[str, Any] = {"project": page.project, "system": page.system}
    data["layers"] = [_layer(store, number, picture) for number, picture in enumerate(page.pictures)]
    data["cameras"] = [camera.model_dump() for camera in page.cameras]
    if page.values:
        layered = [layer.model_dump(exclude={"rasters"}) for layer in page.values]
        runs = [run[:3] for run in runs_of(_values(export, store))]
        data["values"] = {"folder": f"{_BESIDE}/{Path(VALUES).name}", "size": SIZE, "tiles": runs, "layers": layered}
        data["values"] |= _place(store.spec(page.values[0].rasters["height"]))
    for key, file in (("lines", LINES_FILE), ("edges", EDGES_FILE), ("cloud", CLOUD_FILE)):
        drawn = file in export.files and store.file(file)
        data[key] = f"{_BESIDE}/{Path(file).name}" if drawn else None
    write_whole(path, page_text(data).encode())


def _layer(store: ReadableStore, number: int, picture: Picture) -> dict[str, Any]:
    spec = store.spec(picture.raster)
    shades = Shades.model_validate_json(store.file(shades_file(number)))
    return {
        "title": picture.title,
        "caption": picture.caption,
        "style": picture.style,
        "folder": f"{_BESIDE}/{number}",
        "size": TILE,
        "levels": {level: list(runs_of(names)) for level, names in _tiles(store, number, spec).items()},
        "legend": asdict(legend_of(picture, spec, shades)),
        **_place(spec),
    }


def _tiles(store: ReadableStore, number: int, spec: RasterSpec) -> dict[int, tuple[str, ...]]:
    return WrittenTiles.model_validate_json(store.file(last_tiles_file(number, spec.shape))).names


def _values(export: Export, store: ReadableStore) -> tuple[str, ...]:
    lists = (store.file(file) for file in export.files if file.startswith(VALUES))
    return tuple(name for found in lists for name in WrittenTiles.model_validate_json(found).names.get(0, ()))


def _place(spec: RasterSpec) -> dict[str, float | int]:
    """Where a raster lies: its outer upper-left corner and cell, m, and its size."""
    assert spec.transform is not None, "maps only"
    cell, _, west, _, _, north = spec.transform
    return {"west": west, "north": north, "cell": cell, "rows": spec.shape[0], "cols": spec.shape[1]}


def remove_stale(export: Export, store: ReadableStore, depot: Depot) -> None:
    """Remove what parts of earlier runs have left beside a page that was just written, one folder of tiles after the other."""
    (table,) = export.tables
    page = store.table(table)
    assert isinstance(page, MapPage)
    for number, picture in enumerate(page.pictures):
        _keep_only(depot, f"{FOLDER}/{number}", _kept(store, number, store.spec(picture.raster)))
    lists = {file for file in export.files if file.startswith(VALUES)}
    _keep_only(depot, VALUES, {"": set(_values(export, store)), "parts": {Path(file).name for file in lists}})
    known = {str(number) for number in range(len(page.pictures))} | {Path(VALUES).name}
    for folder in set(depot.folders(FOLDER)) - known:
        depot.clear(f"{FOLDER}/{folder}")


def _kept(store: ReadableStore, number: int, spec: RasterSpec) -> dict[str, set[str]]:
    """Names of the files of a layer, by folder."""
    lists = {
        Path(tiles_file(number, level, part.row, part.col)).name
        for level in first_levels(spec.shape)
        for part in parts_at(spec.shape, level)
    }
    tiles = {str(level): set(names) for level, names in _tiles(store, number, spec).items()}
    return tiles | {"parts": lists | {Path(shades_file(number)).name}}


def _keep_only(depot: Depot, folder: str, kept: dict[str, set[str]]) -> None:
    for inside in ("", *depot.folders(folder)):
        place = f"{folder}/{inside}" if inside else folder
        for name in {name for name, _ in depot.entries(place)} - kept.get(inside, set()):
            depot.delete(f"{place}/{name}")


def page_text(data: dict[str, Any]) -> str:
    """The page with what it shows, as one file."""
    # A closing tag inside the data would end the script that holds it.
    text = json.dumps(data, separators=(",", ":")).replace("</", "<\\/")
    page = (_TEMPLATES / "page.html").read_text("utf-8")
    for name in ("leaflet.css", "viewer.css", "leaflet.js", "viewer.js", "space.js"):
        page = page.replace(f"/*{name}*/", (_TEMPLATES / name).read_text("utf-8"))
    return page.replace("/*data*/", text).replace("/*project*/", str(data["project"]))
