"""The jobs of the stage by each of its methods: what is matched, the surface from it, and the report."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from orthomill.schemas.epipolar import PAIRS, EpipolarPair
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import AreaFile, Export, Job, Reading, Table
from orthomill.schemas.observations import GROUND_POINTS
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.project import MapSurface
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.stage_report import StageReport, report_table
from orthomill.schemas.surface import SURFACE, Surface
from orthomill.tasks.densification.line_locus.locus_block import LocusScene
from orthomill.tasks.densification.line_locus.locus_surface import make_line_surface
from orthomill.tasks.densification.plan.difference_jobs import DIFFERENCES, difference_plan
from orthomill.tasks.densification.plan.guided_jobs import GuidedPlan, level_table
from orthomill.tasks.densification.plan.line_jobs import LINE_NODES, LINE_OUTCOME, LINE_PHOTOGRAPHS, LINES, locus_plan
from orthomill.tasks.densification.plan.near_model_jobs import model_plan
from orthomill.tasks.densification.plan.pair_jobs import matching_table, pair_plan
from orthomill.tasks.densification.plan.strategy_jobs import strategy_plan
from orthomill.tasks.densification.plan.surface_jobs import CELLS, TIES, SurfacePlan, SurfaceSource
from orthomill.tasks.densification.plan.volume_jobs import CONFIDENCE, JUDGED_HEIGHT, JUDGEMENT, volume_plan
from orthomill.tasks.densification.plan.water_jobs import WATER, WATER_OUTLINES, WATER_PLACES, outlines_job, place_plan, water_plan
from orthomill.tasks.densification.report.densification_report import report
from orthomill.tasks.densification.report.guided_report import guided_report
from orthomill.tasks.densification.report.line_report import line_report
from orthomill.tasks.densification.settings.guide_settings import GuideFile
from orthomill.tasks.densification.settings.guided_matching import Guided
from orthomill.tasks.densification.settings.pair_strategy_settings import PairStrategy
from orthomill.tasks.densification.stage import DensificationStage, ObjectSpace, VerticalLineLocus
from orthomill.tasks.densification.strategies.assigned_windows import windows_table
from orthomill.tasks.densification.strategies.strategy_block import make_pair_surface
from orthomill.tasks.densification.surface_grid import GridWish, surface_of, window_cells
from orthomill.tasks.densification.surface_tile import SurfaceRules, make_surface
from orthomill.tasks.densification.volume.levels import VolumeScene

_Plan = Iterator[RasterSpec | Job | Export]


def densification_jobs(asked: DensificationStage, view: ProjectView) -> _Plan:
    """The grid of the surface, then the jobs of the method that is asked for."""
    reads: dict[str, Reading] = {"block": BLOCK, "pairs": PAIRS, "points": GROUND_POINTS}
    if file := view.project.grid.area_file:
        reads["wanted"] = AreaFile(file, view.project.crs)
    yield Job(
        stage=asked.kind,
        item="grid",
        function=surface_of,
        reads=reads,
        writes={"surface": SURFACE},
        params={"wish": _wish(asked, view)},
    )
    if asked.water:
        yield outlines_job(asked.water, asked.kind, view.project.crs)
    surface = view.table(SURFACE)
    if isinstance(asked.matching, VerticalLineLocus):
        yield from _lines(asked, view, surface, asked.matching)
    elif isinstance(asked.matching, Guided):
        yield from _guided(asked, view, surface, asked.matching)
    elif isinstance(asked.matching, PairStrategy):
        yield from _pairs_alone(asked, view, surface, asked.matching)
    else:
        yield from _object_space(asked, view, surface, asked.matching)


def _wish(asked: DensificationStage, view: ProjectView) -> GridWish:
    """The grid that project and stage ask for. Raises WorkflowError for two cell sizes."""
    ground = view.project.grid
    cell = None if asked.cell == "auto" else asked.cell
    if not isinstance(ground, MapSurface):
        return GridWish(cell)
    named = None if ground.cell == "auto" else ground.cell
    if cell and named and cell != named:
        raise WorkflowError(
            f"The grid asks for cells of {named:g} m and the stage densification for {cell:g} m; leave one of the two out."
        )
    return GridWish(cell or named, ground.origin, ground.area if isinstance(ground.area, tuple) else None)


def surface_rules(asked: DensificationStage) -> SurfaceRules:
    """The settings that a tile of the surface needs."""
    return SurfaceRules(asked.gridding, asked.fusion, asked.completion, asked.spikes, asked.fill, asked.points)


def _tiles(asked: DensificationStage, view: ProjectView) -> SurfacePlan:
    return SurfacePlan(asked.kind, view.table(BLOCK).crs, view.project.tile, surface_rules(asked))


def _object_space(asked: DensificationStage, view: ProjectView, surface: Surface, matching: ObjectSpace) -> _Plan:
    """The volume, the pairs near it, and the surface from both."""
    pairs = view.table(PAIRS).pairs
    reach = None if matching.reach == "auto" else float(matching.reach)
    scene = VolumeScene(view.table(BLOCK), view.table(PHOTOS), surface, matching.volume, matching.guide, reach)
    yield from volume_plan(scene, matching.confidence, pairs, view.project.tile, asked.kind, view.table(BLOCK).crs)
    for pair in pairs:
        yield from pair_plan(pair, surface, matching.pairs, view.project.tile, asked.kind)
    volume = {"height": JUDGED_HEIGHT, "judgement": JUDGEMENT, "confidence": CONFIDENCE}
    tiles, step = _tiles(asked, view), scene.levels[-1].step
    source = SurfaceSource(make_surface, volume, surface, scene.block.ground_mean, step, matching.pairs.step)
    yield from difference_plan(tiles, source, pairs)
    tables: dict[str, Table[Any]] = {"differences": DIFFERENCES}
    yield from place_plan(surface, bool(asked.water), asked.kind, view.table(BLOCK).crs)
    if asked.water:
        yield from water_plan(view.table(WATER_OUTLINES), surface.grid, asked.kind)
        tables["water"] = WATER
    yield from tiles.jobs(replace(source, tables=tables), pairs)
    yield _report_of_pairs(asked, pairs, {**tables, "places": WATER_PLACES})


def _pairs_alone(asked: DensificationStage, view: ProjectView, surface: Surface, matching: PairStrategy) -> _Plan:
    """The pairs, each by a strategy of its own, and the surface from their nodes."""
    pairs = view.table(PAIRS).pairs
    if isinstance(matching.guide, GuideFile):
        yield from model_plan(matching.guide, surface, asked.kind, view.table(BLOCK).crs)
    for pair in pairs:
        yield from strategy_plan(pair, matching, surface, asked.kind)
    yield from _tiles(asked, view).jobs(_nodes_of_pairs(view, surface, matching.step, matching.window, matching.reach), pairs)
    yield _report_of_pairs(asked, pairs)


def _guided(asked: DensificationStage, view: ProjectView, surface: Surface, matching: Guided) -> _Plan:
    """The levels of points, every pixel of the pairs, and the surface from these."""
    pairs = view.table(PAIRS).pairs
    yield from GuidedPlan(asked.kind, view.table(BLOCK).crs, surface, pairs, matching).jobs()
    source = _nodes_of_pairs(view, surface, matching.pixels.step, matching.pixels.correlation.template)
    yield from _tiles(asked, view).jobs(source, pairs)
    reads = {**_read_of_pairs(pairs), "levels": tuple(level_table(level.number) for level in matching.levels)}
    yield _report(asked, guided_report, reads, settings=matching)


def _lines(asked: DensificationStage, view: ProjectView, surface: Surface, matching: VerticalLineLocus) -> _Plan:
    """Blocks of vertical lines, and the surface from them."""
    scene = LocusScene(view.table(BLOCK), view.table(PHOTOS), surface, matching)
    yield from locus_plan(scene, asked.kind, view.table(BLOCK).crs)
    source = SurfaceSource(
        function=make_line_surface,
        rasters={"nodes": LINE_NODES, "photographs": LINE_PHOTOGRAPHS, "outcome": LINE_OUTCOME},
        surface=surface,
        ground=scene.block.ground_mean,
        step=scene.metres_per_pixel,
        node_step=1,
        window_cells=scene.window_cells,
        reads_nodes=False,
    )
    yield from _tiles(asked, view).jobs(source, view.table(PAIRS).pairs)
    reads: dict[str, Reading] = {"surface": SURFACE, "lines": LINES, "cells": CELLS, "ties": TIES}
    yield _report(asked, line_report, reads)


def _nodes_of_pairs(view: ProjectView, surface: Surface, step: int, window: int, reach: int = 1) -> SurfaceSource:
    """A surface from nothing but nodes, `step` px apart, that windows of `window` px measured; reach: how many wide the ground
    is of which a height may be that of anything."""
    return SurfaceSource(
        function=make_pair_surface,
        rasters={},
        surface=surface,
        ground=view.table(BLOCK).ground_mean,
        step=0.0,
        node_step=step,
        window_cells=reach * window_cells(window, view.table(PAIRS).pairs, surface),
    )


def _report_of_pairs(asked: DensificationStage, pairs: tuple[EpipolarPair, ...], more: Mapping[str, Reading] | None = None) -> Job:
    reads = {**_read_of_pairs(pairs), **(more or {})}
    if isinstance(asked.matching, PairStrategy) and asked.matching.assigned is not None:
        reads["windows"] = tuple(windows_table(pair.name) for pair in pairs)
    return _report(asked, report, reads, wall_blind=isinstance(asked.matching, PairStrategy))


def _report(asked: DensificationStage, function: Callable[..., StageReport], reads: dict[str, Reading], **params: Any) -> Job:
    """The job that reports the surface; params: what else its function takes."""
    writes = {"report": report_table(asked.kind)}
    return Job(stage=asked.kind, item="report", function=function, reads=reads, writes=writes, params=params)


def _read_of_pairs(pairs: tuple[EpipolarPair, ...]) -> dict[str, Reading]:
    """What the report of surfaces from pairs reads."""
    statistics = tuple(matching_table(pair.name) for pair in pairs)
    return {"pairs": PAIRS, "surface": SURFACE, "matching": statistics, "cells": CELLS, "ties": TIES}
