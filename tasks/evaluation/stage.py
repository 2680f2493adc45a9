"""The stage `evaluation`: surface model, orthoimage and orientation against the truth of a simulation or against files."""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from schemas.epipolar import PAIRS
from schemas.errors import WorkflowError
from schemas.job import Job, MapFile, Raster, Region, Table
from schemas.orientation import BLOCK, Block
from schemas.raster import MapGrid, RasterSpec, Tile, map_raster, tiles_of
from schemas.report import report_table
from schemas.settings import Settings, setting
from schemas.stage import ProjectView, Stage
from schemas.surface import CORRECTED, HEIGHT, ORTHO, PRECISION, SURFACE, Surface
from schemas.truth import TRUTH_BLOCK, TRUTH_BUILDING, TRUTH_GRID, TRUTH_MATERIAL, TRUTH_ORTHO, TRUTH_SURFACE, TRUTH_VISIBILITY
from tasks.evaluation.accuracy import HeightHistogram, HeightSums
from tasks.evaluation.classes import HALO as CLASS_HALO
from tasks.evaluation.grids import Placement, grid_of, placement, readable
from tasks.evaluation.orthoimage import HALO, GreyFit, GreySums, OrthoCounts, Shifts, fit_grey
from tasks.evaluation.summary import (
    DH,
    ORTHO_DIFFERENCE,
    EvaluationFacts,
    HeightsSummary,
    OrientationSummary,
    OrthoSummary,
    evaluation_report,
    summarise_heights,
    summarise_orientation,
    summarise_ortho,
)
from tasks.evaluation.tiles import (
    OrthoPlace,
    heights_against_file,
    heights_against_truth,
    ortho_against_file,
    ortho_against_truth,
    sums_against_file,
    sums_against_truth,
)

SUMMARIES = {"heights": HeightsSummary, "ortho": OrthoSummary, "orientation": OrientationSummary}
FIT = Table("evaluation/grey_fit.json", GreyFit)


class TruthReference(Settings):
    """The truth of a simulated scene."""

    kind: Literal["truth"] = "truth"


class FileReference(Settings):
    """Georeferenced raster files of somebody else's making; they are taken to be free of error."""

    kind: Literal["file"]
    dsm: str | None = setting(None, "Raster file with heights, relative to the project's root.")
    ortho: str | None = setting(None, "RGB raster file, relative to the project's root.")


class NoReference(Settings):
    """There is nothing to compare with."""

    kind: Literal["none"]


class EvaluationStage(Stage):
    """Surface model, orthoimage and orientation against truth or a reference: figures, maps, and shares within n sigma."""

    title: ClassVar[str] = "evaluation"

    kind: Literal["evaluation"] = "evaluation"
    reference: Annotated[TruthReference | FileReference | NoReference, Field(discriminator="kind")] = setting(
        TruthReference(), "What the results are compared with."
    )
    parallax_sigma: float = setting(
        0.5, "Error of a parallax that the expected precision of heights is computed from: (H/B) times the ground pixel times this.", "px", gt=0
    )

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job]:
        yield from self._refused(view)
        parts: dict[str, Table] = {}
        waiting = [self._orientation(view, parts), self._heights(view, parts), self._ortho(view, parts)]
        for jobs in waiting:
            yield from jobs
        facts = EvaluationFacts(self.reference.kind, self.parallax_sigma, tuple(parts))
        yield Job("evaluation", "report", evaluation_report, dict(parts), {"report": report_table("evaluation")}, {"facts": facts})

    def _refused(self, view: ProjectView) -> Iterator[Job]:
        """Raises WorkflowError when there is no truth to compare with; yields nothing."""
        if self.reference.kind == "truth" and not view.has_stage("simulation"):
            raise WorkflowError(
                "The stage 'evaluation' is to compare with the truth of a simulation, but the workflow has no stage 'simulation'; "
                "set reference to {kind: file, ...} or {kind: none}."
            )
        yield from ()

    def _orientation(self, view: ProjectView, parts: dict[str, Table]) -> Iterator[Job]:
        if self.reference.kind != "truth" or not view.has_stage("orientation"):
            return
        table = Table("evaluation/orientation.json", OrientationSummary)
        parts["orientation"] = table
        yield Job("evaluation", "orientation", summarise_orientation, {"block": BLOCK, "truth": TRUTH_BLOCK}, {"summary": table})

    def _heights(self, view: ProjectView, parts: dict[str, Table]) -> Iterator[RasterSpec | Job]:
        if self.reference.kind == "none" or not view.has_stage("densification") or (
                self.reference.kind == "file" and self.reference.dsm is None):
            return
        surface, block = view.table(SURFACE), view.table(BLOCK)
        yield map_raster(DH, surface.grid, "float32", block.crs, view.project.tile, nodata=float("nan"), unit="m")
        checked = view.has_stage("dsm_check")
        yield from self._judge_heights(view, CORRECTED if checked else HEIGHT, "heights", DH, parts)
        if checked:
            before = "evaluation/dh_before_check"
            yield map_raster(before, surface.grid, "float32", block.crs, view.project.tile, nodata=float("nan"), unit="m")
            yield from self._judge_heights(view, HEIGHT, "heights_before_check", before, parts)

    def _judge_heights(self, view: ProjectView, source: str, item: str, dh: str, parts: dict[str, Table]) -> Iterator[Job]:
        surface, block = view.table(SURFACE), view.table(BLOCK)
        tiles = list(tiles_of(surface.grid.shape, view.project.tile))
        sums, histograms, buildings = [], [], []
        for t in tiles:
            writes = {
                "dh": Raster(dh, t.window), "sums": Table(f"evaluation/{item}/sums-{t.row}-{t.col}.parquet", HeightSums),
                "histogram": Table(f"evaluation/{item}/histogram-{t.row}-{t.col}.parquet", HeightHistogram),
                "buildings": Table(f"evaluation/{item}/buildings-{t.row}-{t.col}.parquet", HeightHistogram),
            }
            sums.append(writes["sums"])
            histograms.append(writes["histogram"])
            buildings.append(writes["buildings"])
            yield self._height_job(view, item, source, surface, block, t, writes)
        parts[item] = Table(f"evaluation/{item}.json", HeightsSummary)
        reads: dict[str, Region | tuple[Region, ...]] = {
            "sums": tuple(sums), "histograms": tuple(histograms), "buildings": tuple(buildings), "block": BLOCK,
        }
        if view.has_stage("epipolar"):
            reads["pairs"] = PAIRS
        yield Job("evaluation", f"{item}_summary", summarise_heights, reads, {"summary": parts[item]},
                  {"cell": surface.grid.cell, "parallax_sigma": self.parallax_sigma})

    def _height_job(self, view: ProjectView, item: str, source: str, surface: Surface, block: Block, t: Tile,
                    writes: dict[str, Raster | Table]) -> Job:
        own: dict[str, Region] = {"height": Raster(source, t.window), "precision": Raster(PRECISION, t.window)}
        if self.reference.kind == "file":
            reads = {**own, "reference": MapFile(self.reference.dsm, block.crs, surface.grid, t.window)}
            return Job("evaluation", item, heights_against_file, reads, writes, {"cell": surface.grid.cell}, t.row, t.col)
        place = placement(surface.grid, t.window.grown(CLASS_HALO), view.table(TRUTH_GRID))
        truth = _truth(place, surface=TRUTH_SURFACE, material=TRUTH_MATERIAL, building=TRUTH_BUILDING, visibility=TRUTH_VISIBILITY)
        return Job("evaluation", item, heights_against_truth, {**own, **truth}, writes, {"place": place, "core": t.window}, t.row, t.col,
                   scratch=_scratch(place, 60))

    def _ortho(self, view: ProjectView, parts: dict[str, Table]) -> Iterator[RasterSpec | Job]:
        if self.reference.kind == "none" or not view.has_stage("texture") or (
                self.reference.kind == "file" and self.reference.ortho is None):
            return
        spec, tile, crs = view.raster(ORTHO), view.project.tile, view.table(BLOCK).crs
        grid = grid_of(spec)
        yield map_raster(ORTHO_DIFFERENCE, grid, "float32", crs, tile, nodata=float("nan"), unit="grey levels")
        tiles = list(tiles_of(grid.shape, tile))
        sums = [Table(f"evaluation/ortho/sums-{t.row}-{t.col}.json", GreySums) for t in tiles]
        for t, table in zip(tiles, sums, strict=True):
            yield self._sums_job(view, grid, crs, t, table)
        yield Job("evaluation", "grey_fit", fit_grey, {"parts": tuple(sums)}, {"fit": FIT})
        counts = [Table(f"evaluation/ortho/counts-{t.row}-{t.col}.json", OrthoCounts) for t in tiles]
        moved = [Table(f"evaluation/ortho/shifts-{t.row}-{t.col}.parquet", Shifts) for t in tiles]
        for t, count, shift in zip(tiles, counts, moved, strict=True):
            yield self._ortho_job(view, grid, crs, t, {"counts": count, "shifts": shift, "difference": Raster(ORTHO_DIFFERENCE, t.window)})
        parts["ortho"] = Table("evaluation/ortho.json", OrthoSummary)
        yield Job("evaluation", "ortho_summary", summarise_ortho, {"counts": tuple(counts), "shifts": tuple(moved), "fit": FIT},
                  {"summary": parts["ortho"]})

    def _sums_job(self, view: ProjectView, grid: MapGrid, crs: str, t: Tile, table: Table[GreySums]) -> Job:
        own = {"ortho": Raster(ORTHO, t.window)}
        if self.reference.kind == "file":
            reads = {**own, "reference": MapFile(self.reference.ortho, crs, grid, t.window, bands=3)}
            return Job("evaluation", "grey_sums", sums_against_file, reads, {"sums": table}, {}, t.row, t.col)
        place = placement(grid, t.window, view.table(TRUTH_GRID))
        return Job("evaluation", "grey_sums", sums_against_truth, {**own, **_truth(place, truth=TRUTH_ORTHO)}, {"sums": table},
                   {"place": place}, t.row, t.col, scratch=_scratch(place, 80))

    def _ortho_job(self, view: ProjectView, grid: MapGrid, crs: str, t: Tile, writes: dict[str, Raster | Table]) -> Job:
        window = t.window.grown(HALO).clipped(grid.shape)
        own: dict[str, Region] = {"ortho": Raster(ORTHO, window), "fit": FIT}
        where = OrthoPlace(grid, t.window, window)
        if self.reference.kind == "file":
            reads = {**own, "reference": MapFile(self.reference.ortho, crs, grid, window, bands=3)}
            return Job("evaluation", "ortho", ortho_against_file, reads, writes, {"where": where}, t.row, t.col)
        place = placement(grid, window, view.table(TRUTH_GRID))
        truth = _truth(place, truth=TRUTH_ORTHO, material=TRUTH_MATERIAL, visibility=TRUTH_VISIBILITY, surface=TRUTH_SURFACE)
        return Job("evaluation", "ortho", ortho_against_truth, {**own, **truth, "block": TRUTH_BLOCK}, writes,
                   {"place": place, "where": where}, t.row, t.col, scratch=_scratch(place, 250))


def _truth(place: Placement, **names: str) -> dict[str, Region]:
    """The truth rasters of a placement, as reads under the given names."""
    return {key: Raster(name, readable(place)) for key, name in names.items()}


def _scratch(place: Placement, bytes_per_pixel: int) -> int:
    return int(np.prod(place.window.shape)) * bytes_per_pixel
