"""The map of a run: `products/index.html` and the tiles beside it."""

import json
import shutil
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from orthomill.pipeline.export.vectors.map_features import line_features
from orthomill.pipeline.export.viewer.painted_tiles import painted
from orthomill.pipeline.export.viewer.point_cloud_script import write_cloud
from orthomill.pipeline.export.viewer.tile_pyramid import TilePyramid
from orthomill.pipeline.export.viewer.value_tiles import SIZE, write_values
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.maps.map_lines import MapLines
from orthomill.schemas.maps.map_page import MapPage
from orthomill.schemas.raster import RasterSpec

FOLDER = "viewer"
"""beside the page"""
MOST_VERTICES = 1_500_000
"""of lines that a browser still draws; more are left to a GIS"""
_TEMPLATES = files("orthomill.pipeline.export.viewer") / "templates"


def write_viewer(path: Path, store: ReadableStore, page: MapPage, lines: tuple[MapLines, ...]) -> str:
    """Write the tiles into the folder beside `path`; returns the text of the page, to be written last.

    Raises StoreError when a raster of the page does not exist.
    """
    folder = path.parent / FOLDER
    shutil.rmtree(folder, ignore_errors=True)
    layers = []
    for number, picture in enumerate(page.pictures):
        source = painted(store, picture)
        pyramid = TilePyramid(source, store, folder / str(number))
        pyramid.write()
        layers.append(
            {
                "title": picture.title,
                "caption": picture.caption,
                "style": picture.style,
                "folder": f"{FOLDER}/{number}",
                "size": pyramid.size,
                "levels": {level: sorted(names) for level, names in pyramid.tiles.items()},
                "legend": asdict(source.legend),
                **_place(source.spec),
            }
        )
    data: dict[str, Any] = {"project": page.project, "system": page.system, "layers": layers}
    data["cameras"] = [camera.model_dump() for camera in page.cameras]
    if page.values:
        grid = store.spec(page.values[0].rasters["height"])
        tiles = write_values(folder / "values", store, page.values, grid)
        layered = [layer.model_dump(exclude={"rasters"}) for layer in page.values]
        data["values"] = {"folder": f"{FOLDER}/values", "size": SIZE, "tiles": [f"{r}-{c}" for r, c in tiles], "layers": layered}
        data["values"] |= _place(grid)
    data["lines"] = _write_lines(folder, lines)
    cloud = None if page.cloud is None else write_cloud(folder, store, page.cloud)
    data["cloud"] = cloud and f"{FOLDER}/{cloud}"
    return page_text(data)


def _place(spec: RasterSpec) -> dict[str, float | int]:
    """Where a raster lies: its outer upper-left corner and cell, m, and its size."""
    assert spec.transform is not None, "maps only"
    cell, _, west, _, _, north = spec.transform
    return {"west": west, "north": north, "cell": cell, "rows": spec.shape[0], "cols": spec.shape[1]}


def _write_lines(folder: Path, lines: tuple[MapLines, ...]) -> str | None:
    """A script that hands the lines to the page: its path, None where there are none or too many."""
    drawn = [table for table in lines if len(table)]
    if not drawn or sum(map(len, drawn)) > MOST_VERTICES:
        return None
    west, south = (float(np.floor(min(getattr(table, name).min() for table in drawn))) for name in ("x", "y"))
    rows = []
    for feature in (feature for table in drawn for feature in line_features(table)):
        # Whole centimetres from a corner, one after the other: half the size of coordinates in full.
        centimetres = np.rint((feature.places[:, :2] - (west, south)) * 100).astype(np.int64)
        steps = np.diff(centimetres, axis=0, prepend=np.zeros((1, 2), np.int64)).ravel().tolist()
        rows.append([round(float(feature.places[0, 2]), 3), int(feature.dashed), feature.text, steps])
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "lines.js").write_text(f"omLines({west},{south},{json.dumps(rows, separators=(',', ':'))});\n")
    return f"{FOLDER}/lines.js"


def page_text(data: dict[str, Any]) -> str:
    """The page with what it shows, as one file."""
    # A closing tag inside the data would end the script that holds it.
    text = json.dumps(data, separators=(",", ":")).replace("</", "<\\/")
    page = (_TEMPLATES / "page.html").read_text("utf-8")
    for name in ("leaflet.css", "viewer.css", "leaflet.js", "viewer.js", "space.js"):
        page = page.replace(f"/*{name}*/", (_TEMPLATES / name).read_text("utf-8"))
    return page.replace("/*data*/", text).replace("/*project*/", str(data["project"]))
