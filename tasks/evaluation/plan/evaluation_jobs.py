"""The jobs of the stage: heights, orthoimage and orientation against their references, and the report."""

from collections.abc import Iterator
from typing import Literal

from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Job, Raster, Table
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.raster import MapGrid, RasterSpec, map_raster, tiles_of
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import CORRECTED, HEIGHT, ORTHO, SURFACE
from orthomill.schemas.truth import TRUTH_BLOCK, TRUTH_GRID
from orthomill.tasks.evaluation.grids import grid_of
from orthomill.tasks.evaluation.orthoimage_accuracy import GreySums, OrthoCounts, Shifts, fit_grey
from orthomill.tasks.evaluation.plan.ground_comparison_jobs import GROUND_SUMMARY, ground_jobs
from orthomill.tasks.evaluation.plan.height_comparison_jobs import height_job, height_results, judge_check
from orthomill.tasks.evaluation.plan.judged_product import DIFFERENCES, JudgedProduct, Reads
from orthomill.tasks.evaluation.plan.orthoimage_comparison_jobs import FIT, difference_raster, ortho_job, sums_job
from orthomill.tasks.evaluation.plan.point_comparison_jobs import POINTS_SUMMARY, PointsFile, point_jobs
from orthomill.tasks.evaluation.report.evaluation_report import EvaluationFacts, evaluation_report
from orthomill.tasks.evaluation.report.orthoimage_section import ORTHO_DIFFERENCE
from orthomill.tasks.evaluation.stage import EvaluationStage, FileReference
from orthomill.tasks.evaluation.tile_sums import (
    HeightsSummary,
    OrientationSummary,
    OrthoSummary,
    summarise_heights,
    summarise_orientation,
    summarise_ortho,
)


def evaluation_jobs(asked: EvaluationStage, view: ProjectView) -> Iterator[RasterSpec | Job]:
    """The comparisons that the reference and the stages of the workflow allow, and their report."""
    # the sentence about a missing simulation comes at planning, before anything has run
    _check(asked, view)
    parts: dict[str, Table] = {}
    for compare in (_orientation, _heights, _points, _terrain, _ortho):
        yield from compare(asked, view, parts)
    facts = EvaluationFacts(asked.reference.kind, tuple(parts))
    reads: Reads = {**parts}
    yield Job(
        stage="evaluation",
        item="report",
        function=evaluation_report,
        reads=reads,
        writes={"report": report_table("evaluation")},
        params={"facts": facts},
    )


def _check(asked: EvaluationStage, view: ProjectView) -> None:
    """Raises WorkflowError when there is no truth to compare with."""
    if asked.reference.kind == "truth" and not view.has_stage("simulation"):
        raise WorkflowError(
            "The stage 'evaluation' compares with the truth of a simulation, but the workflow has no stage 'simulation'; "
            "set reference to {kind: file, ...} or {kind: none}."
        )


def _orientation(asked: EvaluationStage, view: ProjectView, parts: dict[str, Table]) -> Iterator[Job]:
    if asked.reference.kind != "truth" or not view.has_stage("orientation"):
        return
    table = Table("evaluation/orientation.json", OrientationSummary)
    parts["orientation"] = table
    yield Job(
        stage="evaluation",
        item="orientation",
        function=summarise_orientation,
        reads={"block": BLOCK, "truth": TRUTH_BLOCK},
        writes={"summary": table},
    )


def _file_of(asked: EvaluationStage, product: Literal["dsm", "ortho"]) -> str | None:
    """The reference file of a product; None where it is compared with the truth, or not at all."""
    return getattr(asked.reference, product) if isinstance(asked.reference, FileReference) else None


def _judged(asked: EvaluationStage, view: ProjectView, grid: MapGrid, product: Literal["dsm", "ortho"]) -> JudgedProduct:
    reference = _file_of(asked, product) or view.table(TRUTH_GRID)
    sigma = asked.reference.sigma if isinstance(asked.reference, FileReference) else 0.0
    return JudgedProduct(grid, view.table(BLOCK).crs, view.project.tile, reference, sigma)


def _compares(asked: EvaluationStage, view: ProjectView, product: Literal["dsm", "ortho"], stage: str) -> bool:
    known = asked.reference.kind == "truth" or _file_of(asked, product) is not None
    return known and view.has_stage(stage)


def _heights(asked: EvaluationStage, view: ProjectView, parts: dict[str, Table]) -> Iterator[RasterSpec | Job]:
    if not _compares(asked, view, "dsm", "densification"):
        return
    judged = _judged(asked, view, view.table(SURFACE).grid, "dsm")
    pairs: Reads = {"pairs": PAIRS} if view.has_stage("epipolar") else {}
    if not view.has_stage("dsm_check"):
        yield from _judge_heights(asked.parallax_sigma, judged, HEIGHT, "heights", pairs, parts)
        return
    # Both surfaces: what the check improved or spoiled shows only in comparison with its input.
    yield from _judge_heights(asked.parallax_sigma, judged, CORRECTED, "heights", pairs, parts)
    yield from _judge_heights(asked.parallax_sigma, judged, HEIGHT, "heights_before_check", pairs, parts)
    yield from judge_check(judged, parts)


def _points(asked: EvaluationStage, view: ProjectView, parts: dict[str, Table]) -> Iterator[Job]:
    reference = asked.reference
    if not isinstance(reference, FileReference) or reference.points is None or not view.has_stage("densification"):
        return
    parts["points"] = POINTS_SUMMARY
    source = CORRECTED if view.has_stage("dsm_check") else HEIGHT
    file = PointsFile(reference.points, view.project.crs, reference.sigma)
    yield from point_jobs(file, source, view.table(SURFACE).grid, view.project.tile)


def _terrain(asked: EvaluationStage, view: ProjectView, parts: dict[str, Table]) -> Iterator[Job]:
    # A file of heights shows what stands on the ground, so that only the truth tells of the ground itself.
    if asked.reference.kind != "truth" or not view.has_stage("terrain"):
        return
    parts["terrain"] = GROUND_SUMMARY
    yield from ground_jobs(view.table(SURFACE).grid, view.table(TRUTH_GRID), view.project.tile)


def _judge_heights(
    parallax_sigma: float, judged: JudgedProduct, source: str, item: str, pairs: Reads, parts: dict[str, Table]
) -> Iterator[RasterSpec | Job]:
    dh = DIFFERENCES[item]
    yield map_raster(dh, judged.grid, "float32", judged.crs, judged.tile, nodata=float("nan"), unit="m")
    results = []
    for t in tiles_of(judged.grid.shape, judged.tile):
        results.append(height_results(item, t))
        yield height_job(judged, item, source, t, {"dh": Raster(dh, t.window), **results[-1]})
    parts[item] = Table(f"evaluation/{item}.json", HeightsSummary)
    reads: Reads = {
        "sums": tuple(r["sums"] for r in results),
        "histograms": tuple(r["histogram"] for r in results),
        "buildings": tuple(r["buildings"] for r in results),
        "edges": tuple(r["edges"] for r in results),
        "crowns": tuple(r["crowns"] for r in results),
        "block": BLOCK,
        **pairs,
    }
    params = {"cell": judged.grid.cell, "parallax_sigma": parallax_sigma}
    yield Job(
        stage="evaluation",
        item=f"{item}_summary",
        function=summarise_heights,
        reads=reads,
        writes={"summary": parts[item]},
        params=params,
    )


def _ortho(asked: EvaluationStage, view: ProjectView, parts: dict[str, Table]) -> Iterator[RasterSpec | Job]:
    if not _compares(asked, view, "ortho", "texture"):
        return
    judged = _judged(asked, view, grid_of(view.raster(ORTHO)), "ortho")
    yield difference_raster(judged)
    tiles = list(tiles_of(judged.grid.shape, judged.tile))
    sums = [Table(f"evaluation/ortho/sums-{t.row}-{t.col}.json", GreySums) for t in tiles]
    for t, table in zip(tiles, sums, strict=True):
        yield sums_job(judged, t, table)
    # One fit for the whole image, so one job that waits for all tiles: a fit per tile would hide differences between tiles.
    yield Job(stage="evaluation", item="grey_fit", function=fit_grey, reads={"parts": tuple(sums)}, writes={"fit": FIT})
    counts = [Table(f"evaluation/ortho/counts-{t.row}-{t.col}.json", OrthoCounts) for t in tiles]
    moved = [Table(f"evaluation/ortho/shifts-{t.row}-{t.col}.parquet", Shifts) for t in tiles]
    for t, count, shift in zip(tiles, counts, moved, strict=True):
        yield ortho_job(judged, t, {"counts": count, "shifts": shift, "difference": Raster(ORTHO_DIFFERENCE, t.window)})
    parts["ortho"] = Table("evaluation/ortho.json", OrthoSummary)
    reads: Reads = {"counts": tuple(counts), "shifts": tuple(moved), "fit": FIT}
    yield Job(stage="evaluation", item="ortho_summary", function=summarise_ortho, reads=reads, writes={"summary": parts["ortho"]})
