"""The surface under test: the one that the project measured, or one from a file, placed by the photographs."""

from collections.abc import Generator, Iterator
from typing import Any, NamedTuple

from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.job import AreaFile, HeightFile, HeightHeader, Job, Raster, Reading, Table
from orthomill.schemas.observations import GROUND_POINTS
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.project import MapSurface
from orthomill.schemas.raster import MapGrid, RasterSpec, Window, map_raster, tiles_of
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.surface import CHECKED_SURFACE, HEIGHT, PROVENANCE, SURFACE
from orthomill.tasks.dsm_check.plan.coarse_passes import level_pairs, placing
from orthomill.tasks.dsm_check.plan.passes import FILLED, Passes
from orthomill.tasks.dsm_check.plan.round_plan import Reads
from orthomill.tasks.dsm_check.stage import DsmCheckStage
from orthomill.tasks.dsm_check.surfaces.checked_surface import SurfaceFile
from orthomill.tasks.dsm_check.surfaces.foreign_grid import foreign_surface, measured_surface
from orthomill.tasks.dsm_check.surfaces.placing import PLACED, place, places
from orthomill.tasks.dsm_check.surfaces.surface_shift import NO_SHIFT, SurfaceShift, moved_grid, shift_after
from orthomill.tasks.dsm_check.surfaces.taken_surface import InsideArea, take_file
from orthomill.tasks.dsm_check.tile import take_surface

INPUT = "dsm_check/input"
"""float32 m: the surface under test, whatever its source"""
_PLACING_LEVELS = 3, 1
"""halvings of the orthoimages in which the shift of a surface from a file is found: first those that reach far"""
_MOST_LOOKS = 8
"""of which every one moves the surface by what the one before found"""
_PLACING_CELLS = 128
"""cells along the shorter side that tell a shift to centimetres"""


class PlacedSurface(NamedTuple):
    """Where a surface from a file lies: its shift after it was brought to the tie points, and what is added to its heights, m."""

    shift: Table[SurfaceShift]
    found: SurfaceShift
    up: float


def surface_job(asked: DsmCheckStage, view: ProjectView) -> Job:
    """The job that says which surface is checked, where, and in which cells: the project's own or one from a file."""
    writes: dict[str, Raster | Table] = {"surface": CHECKED_SURFACE}
    if not isinstance(asked.surface, SurfaceFile):
        return Job(stage=asked.kind, item="surface", function=measured_surface, reads={"surface": SURFACE}, writes=writes)
    header = HeightHeader(asked.surface.path, view.project.crs, asked.surface.system)
    reads: dict[str, Reading] = {"extent": header, "block": BLOCK, "pairs": PAIRS}
    if view.has_stage("densification"):
        reads["surface"] = SURFACE
    ground = view.project.grid
    if file := ground.area_file:
        reads["wanted"] = AreaFile(file, view.project.crs)
    params = {"asked": ground if isinstance(ground, MapSurface) else None}
    return Job(stage=asked.kind, item="surface", function=foreign_surface, reads=reads, writes=writes, params=params)


def own_surface(asked: DsmCheckStage, view: ProjectView, grid: MapGrid) -> Iterator[RasterSpec | Job]:
    """The surface that the project measured."""
    size = view.project.tile
    yield map_raster(INPUT, grid, "float32", view.table(BLOCK).crs, size, nodata=float("nan"), unit="m")
    for tile in tiles_of(grid.shape, size):
        reads: Reads = {"heights": Raster(HEIGHT, tile.window)}
        writes = {"input": Raster(INPUT, tile.window)}
        yield Job(stage=asked.kind, item="input", function=take_surface, reads=reads, writes=writes, row=tile.row, col=tile.col)


def placed_surface(
    asked: DsmCheckStage, view: ProjectView, passes: Passes, source: SurfaceFile
) -> Generator[RasterSpec | Job, None, PlacedSurface]:
    """Where a surface from a file lies to the photographs."""
    coarse = places(passes.surface.grid)
    given = HeightFile(source.path, view.project.crs, coarse, Window(0, 0, *coarse.shape), source.system)
    reads: Reads = {"heights": given, "block": BLOCK}
    if view.has_stage("orientation"):
        reads["points"] = GROUND_POINTS
    yield Job(
        stage=asked.kind,
        item="place",
        function=place,
        reads=reads,
        writes={"placed": PLACED},
        params={"grid": coarse, "path": source.path},
    )
    rough, fine = (passes.lowest(level, _PLACING_CELLS) for level in _PLACING_LEVELS)
    for one in sorted({rough, fine, *range(1, passes.lowest(asked.most_levels) + 1)}):
        yield level_pairs(passes, one)
    before, found, up, look = None, NO_SHIFT, view.table(PLACED).up, 0
    while look < _MOST_LOOKS and not (before and found.settled(before)):
        look += 1
        yield from placing(passes, view, source, look, fine if before else rough, up, found.certain)
        before, found = found, view.table(shift_after(look))
    if fine:
        # Windows on coarse orthoimages blur roofs: what they find is right to some tenths of a cell of theirs.
        look += 1
        yield level_pairs(passes, 0)
        yield from placing(passes, view, source, look, 0, up, found.certain)
        found = view.table(shift_after(look))
    moved = found.in_plan and source.shift == "remove"
    # To the millimetre: the surface that is given back must not show the digits of an estimate.
    return PlacedSurface(shift_after(look), found, round(up - (found.up if moved else found.level), 3))


def surface_from_file(
    asked: DsmCheckStage, view: ProjectView, passes: Passes, source: SurfaceFile, placed: PlacedSurface
) -> Iterator[RasterSpec | Job]:
    """The surface from a file, in the height system of the photographs."""
    grid = passes.surface.grid
    taken = moved_grid(grid, placed.found) if source.shift == "remove" and placed.found.in_plan else grid
    yield passes.raster(INPUT)
    yield passes.raster(FILLED, "uint8")
    fill = source.holes == "fill" and view.has_stage("densification")
    for tile in tiles_of(grid.shape, view.project.tile):
        reads: Reads = {"heights": HeightFile(source.path, view.project.crs, taken, tile.window, source.system)}
        if fill:
            reads |= {"matched": Raster(HEIGHT, tile.window), "provenance": Raster(PROVENANCE, tile.window)}
        writes: dict[str, Raster | Table] = {"input": Raster(INPUT, tile.window), "filled": Raster(FILLED, tile.window)}
        params: dict[str, Any] = {"up": placed.up, "inside": InsideArea(passes.surface.wanted, grid, tile.window)}
        yield Job(
            stage=asked.kind,
            item="input",
            function=take_file,
            reads=reads,
            writes=writes,
            params=params,
            row=tile.row,
            col=tile.col,
        )
