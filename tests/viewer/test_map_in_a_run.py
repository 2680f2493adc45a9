"""The map as the engine makes it: the same files in a folder and in an object store, and parts anew where something changed."""

import os
from typing import ClassVar, Literal

import numpy as np
import pytest

from orthomill.pipeline.records.verification import examine
from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.depots.kept_at import keep_in
from orthomill.schemas.job import Export, Job, Raster
from orthomill.schemas.maps.map_page import MAP_PAGE, MapPage, ValueLayer
from orthomill.schemas.maps.map_parts import PAGE
from orthomill.schemas.raster import MapGrid, Window, map_raster, tiles_of
from orthomill.schemas.stage_contract import Stage
from orthomill.schemas.stage_report import Picture
from orthomill.tasks.viewer.plan.map_part_jobs import map_parts
from orthomill.tasks.viewer.plan.viewer_jobs import last_files
from tests.support.engine.toy_stages import run_in

GRID = MapGrid(west=407000.0, north=4357300.0, cell=1.0, rows=4300, cols=100)
HEIGHT = "source/height"
PICTURES = (Picture(title="Ramp", raster=HEIGHT, style="ramp", unit="m", low=0.0, high=4500.0),)
VALUES = (ValueLayer(name="surface", title="Surface", rasters={"height": HEIGHT}),)


def slope(window: Window, lift: float) -> np.ndarray:
    row, col = np.mgrid[window.slices]
    return (row + col + lift).astype(np.float32)


def one_page() -> MapPage:
    return MapPage(project="toy", pictures=PICTURES, values=VALUES, cameras=(), system="EPSG:2100")


class MappedStage(Stage):
    """A slope and its map; `lift` raises the last tile."""

    title: ClassVar[str] = "mapping"
    kind: Literal["source"] = "source"
    lift: float = 0.0

    def plan(self, view):
        spec = map_raster(HEIGHT, GRID, "float32", "EPSG:2100", 512)
        yield spec
        tiles = list(tiles_of(spec.shape, 512))
        for tile in tiles:
            params = {"window": tile.window, "lift": self.lift if tile == tiles[-1] else 0.0}
            writes = {"height": Raster(HEIGHT, tile.window)}
            yield Job(stage="source", item="tile", function=slope, reads={}, writes=writes, params=params, row=tile.row)
        yield Job(stage="viewer", item="page", function=one_page, reads={}, writes={"page": MAP_PAGE})
        parts = list(map_parts(view, PICTURES, VALUES, None, {}))
        yield from parts
        yield Export("viewer", "map", PAGE, "map", tables=(MAP_PAGE,), files=last_files(parts))


def test_the_map_is_the_same_in_an_object_store(tmp_path):
    pytest.importorskip("obstore")
    from orthomill.pipeline.storage.depots.bucket import bucket_of

    keep_in(tmp_path / "there/runs/toy", "memory://mapped")
    here, there = (run_in(tmp_path / place, MappedStage()) for place in ("here", "there"))
    assert not here.failures and not there.failures
    folder, store = Folder(tmp_path / "here/runs/toy"), bucket_of("memory://mapped/toy")
    names = list(folder.names("products"))
    assert names == list(store.names("products")) and any(name.startswith("products/viewer/0/4/0-0.") for name in names)
    assert all(folder.get(name) == store.get(name) for name in names)


def test_a_changed_tile_makes_the_parts_anew_that_lie_on_it(tmp_path):
    assert not run_in(tmp_path, MappedStage()).failures
    assert not run_in(tmp_path, MappedStage()).done
    again = run_in(tmp_path, MappedStage(lift=5.0))
    tiles = {key[2] for key in again.done if key[1] == "layer0-tiles0"}
    values = {key[2] for key in again.done if key[1] == "values"}
    # The shades are of the whole raster, and all tiles have their colours from them; values lie on their own part alone.
    assert not again.failures and tiles == {0, 1} and values == {1}


def test_tiles_that_a_power_cut_took_are_found_and_made_again(tmp_path):
    run_in(tmp_path, MappedStage())
    folder = tmp_path / "runs/toy"
    products = {path: path.read_bytes() for path in (folder / "products").rglob("*") if path.is_file()}
    image, values = folder / "products/viewer/0/1/0-0.webp", folder / "products/viewer/values/2-0.js"
    image = image if image.exists() else image.with_suffix(".jpg")
    before = image.stat()
    image.write_bytes(bytes(before.st_size))
    os.utime(image, ns=(before.st_atime_ns, before.st_mtime_ns))
    values.unlink()
    lost = examine(folder).damaged
    assert lost == {image.relative_to(folder).as_posix(): "damaged", values.relative_to(folder).as_posix(): "missing"}
    again = run_in(tmp_path, MappedStage())
    assert {key[1] for key in again.done} >= {"layer0-tiles0", "values"} and not again.failures
    assert {path: path.read_bytes() for path in products} == products
