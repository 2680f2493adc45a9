"""The first pass at full resolution, over the whole surface and over the second one."""

from typing import Any

from orthomill.schemas.job import Job, Raster, Table
from orthomill.schemas.raster import RasterSpec, Window
from orthomill.tasks.dsm_check.joint_correction import BENDS
from orthomill.tasks.dsm_check.plan.pass_state import look_again_job, state_after, state_rasters
from orthomill.tasks.dsm_check.plan.passes import SECOND, Passes, Plan, counts_table, of_round, tile_job
from orthomill.tasks.dsm_check.plan.round_plan import KIND, CheckRound, Reads, coarser
from orthomill.tasks.dsm_check.rounds.round_state import judge
from orthomill.tasks.dsm_check.surfaces.surface_shift import TREND, surface_trend
from orthomill.tasks.dsm_check.tile import blocks_of_nodes

_FIRST_BLOCKS = "dsm_check/first_blocks"
"""float32 (rows, cols, 3): `areas.blocks` of the first pass"""


def first_pass(passes: Passes, twice: bool) -> Plan:
    """The first pass over the whole surface, and over the second one."""
    one, other, rule = passes.main("dsm_check/input"), _second_pass(passes), passes.rule()
    yield from one.jobs()
    if twice:
        yield from other.jobs()
    yield from one.bends()
    if not passes.measured:
        yield from _trend(passes, one)
    yield from state_rasters(passes, 1, disputed=True)
    for tile in passes.tiles():
        windows, near = one.near(tile.window)
        params: dict[str, Any] = {"window": tile.window, "pairs": windows, "rule": rule}
        reads: Reads = {"heights": Raster("dsm_check/input", tile.window), "nodes": near, **passes.codes(tile.window)}
        reads |= {"bends": BENDS, **passes.of_trend}
        if twice:
            wide = tile.window.grown(2).clipped(passes.surface.grid.shape)
            reads |= {"heights": Raster("dsm_check/input", wide), "second": Raster(SECOND, wide)}
            reads["second_nodes"] = other.near(tile.window)[1]
            params["wide"] = wide
        writes: dict[str, Raster | Table] = {
            **state_after(passes, 1, tile),
            "disputed": Raster(of_round(1, "disputed"), tile.window),
            "counts": counts_table(tile),
        }
        yield tile_job(item="judge", function=judge, reads=reads, writes=writes, params=params, tile=tile)
    yield look_again_job(passes, 1)


def _trend(passes: Passes, one: CheckRound) -> Plan:
    """What the first pass asks for all over the surface."""
    grid, (size, shape) = passes.surface.grid, passes.blocks()
    yield RasterSpec(name=_FIRST_BLOCKS, shape=(*shape, 3), dtype="float32", chunk=passes.tile // size)
    for tile in passes.tiles():
        windows, near = one.near(tile.window)
        reads: Reads = {"heights": Raster("dsm_check/input", tile.window), "nodes": near, "bends": BENDS}
        out: dict[str, Raster | Table] = {"coarse": Raster(_FIRST_BLOCKS, coarser(tile.window, size))}
        params = {"window": tile.window, "pairs": windows, "grid": one.nodes, "size": size}
        yield tile_job(item="trend-blocks", function=blocks_of_nodes, reads=reads, writes=out, params=params, tile=tile)
    whole = Raster(_FIRST_BLOCKS, Window(0, 0, *shape))
    params = {"grid": grid, "size": size, "pixel_height": passes.pairs.pixel_height}
    yield Job(stage=KIND, item="trend", function=surface_trend, reads={"coarse": whole}, writes={"trend": TREND}, params=params)


def _second_pass(passes: Passes) -> CheckRound:
    return CheckRound(
        prefix="dsm_check/second",
        scene=passes.scene,
        surface=passes.surface,
        pairs=passes.pairs,
        heights=SECOND,
        tile=passes.tile,
        how=passes.how,
    )
