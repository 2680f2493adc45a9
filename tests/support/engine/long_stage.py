"""A stage with a product that is large enough for sheets, where the project's bound is low."""

from typing import ClassVar, Literal

import numpy as np
from surface_stage import slope

from orthomill.schemas.job import Export, Job, Raster
from orthomill.schemas.raster import MapGrid, Window, map_raster, tiles_of
from orthomill.schemas.stage_contract import Stage

GRID = MapGrid(west=409000.0, north=4357000.0, cell=0.5, rows=33000, cols=40)
SHEET_JOBS, JOINED_JOB = [("long", "file-sheets", row, 0) for row in range(3)], ("long", "file", 0, 0)


def strip(window: Window) -> np.ndarray:
    """(H, W) that rises by a centimetre a row, and has nothing in the second sheet."""
    values = slope(window)
    rows = np.arange(window.row, window.row + window.height)
    values[(rows >= 16384) & (rows < 32768)] = np.nan
    return values


class LongStage(Stage):
    """A raster of 33000 x 40 px, three sheets."""

    title: ClassVar[str] = "Long"
    kind: Literal["long"] = "long"
    rows: int = GRID.rows
    tile: int = 2048

    def plan(self, view):
        spec = map_raster("long/z", GRID.model_copy(update={"rows": self.rows}), "float32", "EPSG:2100", self.tile, nodata=np.nan)
        yield spec
        for tile in tiles_of(spec.shape, self.tile):
            writes, params = {"z": Raster(spec.name, tile.window)}, {"window": tile.window}
            yield Job(stage="long", item="z", function=strip, reads={}, writes=writes, params=params, row=tile.row, col=tile.col)
        yield Export("long", "file", "products/z.tif", "cog", {"z": spec.name})
