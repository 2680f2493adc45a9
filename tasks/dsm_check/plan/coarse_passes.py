"""Passes at coarse levels: where a surface from a file lies, and the second surface."""

from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.job import HeightFile, Job, Raster, Table
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.raster import RasterSpec, Window, map_raster, tiles_of
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.surface import CHECKED_SURFACE
from orthomill.tasks.dsm_check.plan.passes import FAR, NAN, SECOND, Passes, Plan, tile_job
from orthomill.tasks.dsm_check.plan.round_plan import KIND, CheckRound, Reads, coarser
from orthomill.tasks.dsm_check.rounds.coarse_levels import (
    FINER_HALO,
    PAIRED,
    START_HALO,
    START_SIDE,
    Far,
    choose_level_pairs,
    finer_surface,
    finest_surface,
    judge_coarse,
    level_surface,
    start_surface,
)
from orthomill.tasks.dsm_check.surfaces.checked_surface import SurfaceFile
from orthomill.tasks.dsm_check.surfaces.surface_shift import SurfaceShift, further_shift, moved_grid, shift_after
from orthomill.tasks.dsm_check.surfaces.taken_surface import InsideArea, raised


def level_pairs(passes: Passes, level: int) -> Job:
    """The pairs of a level, on its grid."""
    params = {"level": level, "tile": passes.tile, "count": passes.count, "per_place": passes.per_place}
    reads: Reads = {"pairs": PAIRS, "block": BLOCK, "surface": CHECKED_SURFACE}
    return Job(
        stage=KIND,
        item=f"pairs-{level}",
        function=choose_level_pairs,
        reads=reads,
        writes={"checked": passes.pairs_of(level)},
        params=params,
    )


def placing(passes: Passes, view: ProjectView, source: SurfaceFile, look: int, level: int, up: float, before: SurfaceShift) -> Plan:
    """The shift of a surface from a file, raised by `up` m, from one pass at a coarse level over the surface moved back by
    what is known of it."""
    prefix = f"dsm_check/placing-{look}"
    coarse = level_surface(passes.surface, level)
    there = moved_grid(coarse.grid, before)
    yield map_raster(f"{prefix}/height", coarse.grid, "float32", passes.scene.crs, passes.tile, nodata=NAN, unit="m")
    for tile in tiles_of(coarse.grid.shape, passes.tile):
        given = HeightFile(source.path, passes.scene.crs, there, tile.window, source.system)
        out: dict[str, Raster | Table] = {"height": Raster(f"{prefix}/height", tile.window)}
        how = {"up": up - before.up, "inside": InsideArea(passes.surface.wanted, coarse.grid, tile.window)}
        yield tile_job(item=f"placing-{look}-height", function=raised, reads={"heights": given}, writes=out, params=how, tile=tile)
    yield from _coarse(passes, view, prefix, level, f"{prefix}/height")
    rows, cols = (-(-side // PAIRED) for side in coarse.grid.shape)
    whole = Raster(f"{prefix}/coarse", Window(0, 0, rows, cols))
    params = {"side": PAIRED << level, "before": before}
    yield Job(
        stage=KIND,
        item=f"placing-{look}-shift",
        function=further_shift,
        reads={"coarse": whole},
        writes={"shift": shift_after(look)},
        params=params,
    )


def second_surface(passes: Passes, view: ProjectView, top: int) -> Plan:
    """The second surface, from level `top` to the first; the result is `SECOND`."""
    yield from _start(passes, top)
    for level in range(top, 0, -1):
        yield from _coarse(passes, view, f"dsm_check/level-{level}", level, f"dsm_check/level-{level}/height")
        yield from _finer(passes, level) if level > 1 else _finest(passes, view)


def _start(passes: Passes, level: int) -> Plan:
    coarse, side = level_surface(passes.surface, level), 2**level
    yield _level_heights(passes, level)
    for tile in tiles_of(coarse.grid.shape, passes.tile):
        given = tile.window.grown(START_HALO).clipped(coarse.grid.shape)
        fine = Raster("dsm_check/input", given.scaled(side).clipped(passes.surface.grid.shape))
        out: dict[str, Raster | Table] = {"height": Raster(f"dsm_check/level-{level}/height", tile.window)}
        params = {"window": tile.window, "given": given, "level": level}
        scratch = array_bytes(40, given, side**2 + START_SIDE**2)
        yield Job(
            stage=KIND,
            item=f"level-{level}-start",
            function=start_surface,
            reads={"heights": fine},
            writes=out,
            params=params,
            row=tile.row,
            col=tile.col,
            scratch=scratch,
        )


def _finer(passes: Passes, level: int) -> Plan:
    finer = level_surface(passes.surface, level - 1)
    yield _level_heights(passes, level - 1)
    for tile in tiles_of(finer.grid.shape, passes.tile):
        given, reads = _from_level(passes, level, tile.window)
        out: dict[str, Raster | Table] = {"heights": Raster(f"dsm_check/level-{level - 1}/height", tile.window)}
        params = {"window": tile.window, "given": given}
        what = f"level-{level}-finer"
        yield tile_job(item=what, function=finer_surface, reads=reads, writes=out, params=params, tile=tile)


def _finest(passes: Passes, view: ProjectView) -> Plan:
    pixel_height = view.table(passes.pairs_of(1)).pixel_height
    rule = Far.of(passes.significance, passes.how.matching.search.reach, pixel_height)
    yield passes.raster(SECOND)
    yield passes.raster(FAR, "uint8")
    for tile in passes.tiles():
        given, reads = _from_level(passes, 1, tile.window)
        reads |= {"sigma": Raster("dsm_check/level-1/precision", given), "under_test": Raster("dsm_check/input", tile.window)}
        out: dict[str, Raster | Table] = {"second": Raster(SECOND, tile.window), "far": Raster(FAR, tile.window)}
        params = {"window": tile.window, "given": given, "rule": rule}
        yield tile_job(item="level-1-finest", function=finest_surface, reads=reads, writes=out, params=params, tile=tile)


def _level_heights(passes: Passes, level: int) -> RasterSpec:
    grid = level_surface(passes.surface, level).grid
    return map_raster(f"dsm_check/level-{level}/height", grid, "float32", passes.scene.crs, passes.tile, nodata=NAN, unit="m")


def _from_level(passes: Passes, level: int, window: Window) -> tuple[Window, Reads]:
    """The cells of a level that a finer window needs, and what is known there."""
    given = window.reduced(2).grown(FINER_HALO).clipped(level_surface(passes.surface, level).grid.shape)
    return given, {"heights": Raster(f"dsm_check/level-{level}/height", given), "dh": Raster(f"dsm_check/level-{level}/dh", given)}


def _coarse(passes: Passes, view: ProjectView, prefix: str, level: int, heights: str) -> Plan:
    """One pass at a coarse level: dh, precision and coarse below `prefix`."""
    coarse, pairs = level_surface(passes.surface, level), view.table(passes.pairs_of(level))
    one = CheckRound(
        prefix=prefix,
        scene=passes.scene,
        surface=coarse,
        pairs=pairs,
        heights=heights,
        tile=passes.tile,
        how=passes.how,
        coarse=True,
    )
    yield from one.jobs()
    for name in ("dh", "precision"):
        yield map_raster(f"{prefix}/{name}", coarse.grid, "float32", passes.scene.crs, passes.tile, nodata=NAN, unit="m")
    rows, cols = (-(-side // PAIRED) for side in coarse.grid.shape)
    yield RasterSpec(name=f"{prefix}/coarse", shape=(rows, cols, 5), dtype="float32", chunk=passes.tile // PAIRED)
    for tile in tiles_of(coarse.grid.shape, passes.tile):
        windows, near = one.near(tile.window)
        reads: Reads = {"heights": Raster(heights, tile.window), "nodes": near}
        writes: dict[str, Raster | Table] = {n: Raster(f"{prefix}/{n}", tile.window) for n in ("dh", "precision")}
        writes["coarse"] = Raster(f"{prefix}/coarse", coarser(tile.window, PAIRED))
        params = {"window": tile.window, "pairs": windows, "grid": one.nodes, "cell": coarse.grid.cell}
        yield tile_job(item=f"{one.item}judge", function=judge_coarse, reads=reads, writes=writes, params=params, tile=tile)
