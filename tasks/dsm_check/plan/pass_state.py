"""What a pass at full resolution leaves for the next one, and where that one looks again."""

from collections.abc import Iterator

from orthomill.schemas.job import Job, Raster, Table
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import RasterSpec, Tile, Window
from orthomill.tasks.dsm_check.plan.passes import Passes, of_round
from orthomill.tasks.dsm_check.plan.round_plan import KIND, CheckRound, Reads, coarser, node_halo
from orthomill.tasks.dsm_check.rounds.round_state import LookAgain, RoundCounts, look_again, state_table


def state_rasters(passes: Passes, number: int, disputed: bool = False) -> Iterator[RasterSpec]:
    """The rasters that pass `number` leaves; `disputed`: those of the first pass among them."""
    for name in ("height", "residual", "precision"):
        yield passes.raster(of_round(number, name))
    yield passes.raster(of_round(number, "last"), "uint8")
    if disputed:
        yield passes.raster(of_round(number, "disputed"), "uint8")
    size, shape = passes.blocks()
    yield RasterSpec(name=of_round(number, "asks"), shape=shape, dtype="uint16", chunk=passes.tile // size)
    yield RasterSpec(name=of_round(number, "active"), shape=shape, dtype="uint8", chunk=max(shape))


def state_after(passes: Passes, number: int, tile: Tile) -> dict[str, Raster | Table]:
    """What a job writes that ends pass `number` in a tile."""
    names = ("height", "residual", "precision", "last")
    return {
        **{name: Raster(of_round(number, name), tile.window) for name in names},
        "asks": Raster(of_round(number, "asks"), coarser(tile.window, passes.blocks()[0])),
        "changes": _changes(number, tile),
    }


def look_again_job(passes: Passes, number: int) -> Job:
    """Where the pass after `number` looks, from what was corrected."""
    size, shape = passes.blocks()
    small = passes.tile if passes.everywhere else passes.small()
    how = passes.comparing()
    factor = passes.pairs.pixels_per_cell
    again = CheckRound(prefix=KIND, scene=passes.scene, surface=passes.surface, pairs=passes.pairs, heights="", tile=small, how=how)
    where = LookAgain(
        block=size,
        tile=small,
        shape=passes.surface.grid.shape,
        around=passes.around,
        nodes=again.nodes.halo * how.step,
        seen=node_halo(how, factor) + 1,
        everywhere=passes.everywhere,
    )
    reads: Reads = {
        "asks": Raster(of_round(number, "asks"), Window(0, 0, *shape)),
        "counts": tuple(_changes(number, tile) for tile in passes.tiles()),
    }
    writes: dict[str, Raster | Table] = {
        "active": Raster(of_round(number, "active"), Window(0, 0, *shape)),
        "state": state_table(number),
    }
    return Job(
        stage=KIND,
        item=f"rounds/{number}-state",
        function=look_again,
        reads=reads,
        writes=writes,
        params={"where": where},
        scratch=array_bytes(64, shape),
    )


def _changes(number: int, tile: Tile) -> Table[RoundCounts]:
    return Table(f"dsm_check/rounds/{number}/{tile.row}-{tile.col}.json", RoundCounts)
