"""A stage with a product that is large enough to be made in parts."""

from typing import ClassVar, Literal

import numpy as np

from orthomill.schemas.job import Export, Job, MapHeader, Raster, Table
from orthomill.schemas.raster import MapGrid, Window, map_raster, tiles_of
from orthomill.schemas.stage_contract import Stage

GRID = MapGrid(west=409000.0, north=4357000.0, cell=0.5, rows=5000, cols=1000)
EXTENT = Table("surface/extent.json", MapGrid)


def slope(window: Window) -> np.ndarray:
    """(H, W) that rises by a centimetre a row."""
    return np.add.outer(
        np.arange(window.row, window.row + window.height, dtype=np.float32) * 0.01, np.zeros(window.width, np.float32)
    )


def extent_of(file: MapGrid) -> MapGrid:
    """What was read of a file."""
    return file


class SurfaceStage(Stage):
    """A raster of 5000 x 1000 px as GeoTIFF, which a job reads."""

    title: ClassVar[str] = "Surface"
    kind: Literal["surface"] = "surface"

    def plan(self, view):
        spec = map_raster("surface/z", GRID, "float32", "EPSG:2100", 1000)
        yield spec
        for tile in tiles_of(spec.shape, 1000):
            writes, params = {"z": Raster(spec.name, tile.window)}, {"window": tile.window}
            yield Job(stage="surface", item="z", function=slope, reads={}, writes=writes, params=params, row=tile.row, col=tile.col)
        yield Export("surface", "file", "products/z.tif", "cog", {"z": spec.name})
        reads = {"file": MapHeader(view.run_file("products/z.tif"), "EPSG:2100")}
        yield Job(stage="surface", item="extent", function=extent_of, reads=reads, writes={"extent": EXTENT})
