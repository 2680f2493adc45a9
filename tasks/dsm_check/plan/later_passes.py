"""Later passes, over the places where something was corrected."""

from orthomill.schemas.job import Job, Raster, Table
from orthomill.schemas.raster import RasterSpec, Tile, tiles_of
from orthomill.tasks.dsm_check.areas import block_size
from orthomill.tasks.dsm_check.joint_correction import BENDS
from orthomill.tasks.dsm_check.plan.pass_state import look_again_job, state_after, state_rasters
from orthomill.tasks.dsm_check.plan.passes import Passes, Plan, of_round, tile_job
from orthomill.tasks.dsm_check.plan.round_plan import CheckRound, Reads, coarser
from orthomill.tasks.dsm_check.rounds.carried import carry
from orthomill.tasks.dsm_check.rounds.round_state import MergeRule, RoundState, judge_again, least_change, merge, precise_enough


def later_pass(passes: Passes, number: int, state: RoundState) -> Plan:
    """A later pass over the tiles that `state` names."""
    small = passes.tile if passes.everywhere else passes.small()
    before = number - 1
    prefix = f"dsm_check/rounds/{number}"
    yield from _carried(passes, before)
    again = CheckRound(
        prefix=prefix,
        scene=passes.scene,
        surface=passes.surface,
        pairs=passes.pairs,
        heights=of_round(before, "carried"),
        tile=small,
        how=passes.comparing(),
        again=state,
    )
    yield from again.jobs()
    for name in ("dh", "sigma"):
        yield replace_chunk(passes.raster(f"{prefix}/{name}"), small)
    block, judged = block_size(passes.surface.grid.shape), set(state.judged)
    for tile in tiles_of(passes.surface.grid.shape, small):
        if (tile.row, tile.col) in judged:
            windows, near = again.near(tile.window)
            active = Raster(of_round(before, "active"), coarser(tile.window, block))
            out: dict[str, Raster | Table] = {
                "dh": Raster(f"{prefix}/dh", tile.window),
                "precision": Raster(f"{prefix}/sigma", tile.window),
            }
            params = {"window": tile.window, "pairs": windows, "grid": again.nodes, "block": block}
            what = f"{again.item}judge"
            yield tile_job(
                item=what,
                function=judge_again,
                reads={"active": active, "nodes": near, "bends": BENDS, **passes.of_trend},
                writes=out,
                params=params,
                tile=tile,
            )
    yield from state_rasters(passes, number)
    for tile in passes.tiles():
        yield _merge(passes, number, tile, small, judged)
    yield look_again_job(passes, number)


def _carried(passes: Passes, number: int) -> Plan:
    """The heights with which the pass after `number` begins."""
    name = of_round(number, "carried")
    yield passes.raster(name)
    for tile in passes.tiles():
        wide = tile.window.grown(passes.around).clipped(passes.surface.grid.shape)
        reads: Reads = {
            "heights": Raster(of_round(number, "height"), wide),
            "given": Raster("dsm_check/input", wide),
            "residual": Raster(of_round(number, "residual"), wide),
        }
        params = {"window": tile.window, "wide": wide, "reach": passes.around}
        out: dict[str, Raster | Table] = {"heights": Raster(name, tile.window)}
        yield tile_job(item=f"rounds/{number}-carry", function=carry, reads=reads, writes=out, params=params, tile=tile)


def _merge(passes: Passes, number: int, tile: Tile, small: int, judged: set[tuple[int, int]]) -> Job:
    inside = [t for t in tiles_of(passes.surface.grid.shape, small) if (t.row, t.col) in judged and _holds(tile, t)]
    parts = tuple(t.window for t in inside)
    prefix, before = f"dsm_check/rounds/{number}", number - 1
    reads: Reads = {
        **{
            argument: Raster(of_round(before, name), tile.window)
            for argument, name in (("heights", "carried"), *((n, n) for n in ("residual", "precision", "last")))
        },
        **passes.codes(tile.window),
    }
    if parts:
        reads["dh"] = tuple(Raster(f"{prefix}/dh", part) for part in parts)
        reads["sigma"] = tuple(Raster(f"{prefix}/sigma", part) for part in parts)
    pixel, size = passes.pairs.pixel_height, block_size(passes.surface.grid.shape)
    rule = MergeRule(passes.apply, passes.significance, size, number, least_change(pixel), precise_enough(pixel))
    params = {"window": tile.window, "parts": parts, "rule": rule}
    return tile_job(
        item=f"rounds/{number}-merge",
        function=merge,
        reads=reads,
        writes=state_after(passes, number, tile),
        params=params,
        tile=tile,
    )


def _holds(tile: Tile, other: Tile) -> bool:
    window, part = tile.window, other.window
    inside_rows = window.row <= part.row < window.row + window.height
    return inside_rows and window.col <= part.col < window.col + window.width


def replace_chunk(spec: RasterSpec, chunk: int) -> RasterSpec:
    """The raster in other chunks."""
    return spec.model_copy(update={"chunk": chunk})
