"""The answer of a check, tile by tile, after the last pass."""

from orthomill.schemas.job import Job, Raster, Table
from orthomill.schemas.raster import Tile
from orthomill.tasks.dsm_check.correction_map import TOGETHER
from orthomill.tasks.dsm_check.plan.passes import FAR, FILLED, Passes, counts_table, of_round, tile_job
from orthomill.tasks.dsm_check.plan.round_plan import Reads
from orthomill.tasks.dsm_check.rounds.finish import Finish, finish


def answer_job(
    passes: Passes, tile: Tile, number: int, twice: bool, writes: dict[str, Raster | Table], how: Finish, level: bool = False
) -> Job:
    """The answer in a tile after pass `number`; twice: whether there is a second surface; level: whether the trend is taken out
    of the corrected surface."""
    # Whether a cell stands alone is seen by the cells around the tile.
    wide = tile.window.grown(TOGETHER - 1).clipped(passes.surface.grid.shape)
    reads: Reads = {
        "given": Raster("dsm_check/input", wide),
        **{name: Raster(of_round(number, name), wide) for name in ("height", "residual", "precision")},
        "disputed": Raster(of_round(1, "disputed"), tile.window),
        "counts": counts_table(tile),
        **passes.codes(tile.window),
    }
    if twice:
        reads["far"] = Raster(FAR, tile.window)
    if level:
        reads |= passes.of_trend
    if not passes.measured:
        reads["filled"] = Raster(FILLED, tile.window)
    params = {"window": tile.window, "wide": wide, "how": how}
    return tile_job(item="answer", function=finish, reads=reads, writes=writes, params=params, tile=tile)
