"""The stage `evaluation`: surface model, orthoimage and orientation against the truth of a simulation or against files."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Job, MapFile, Raster, Region, Table
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.project_paths import ProjectMap
from orthomill.schemas.raster import MapGrid, RasterSpec, Tile, map_raster, tiles_of
from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import (
    CHECKED_CODE,
    CORRECTED,
    HEIGHT,
    HEIGHT_SOURCE,
    ORTHO,
    PRECISION,
    PROVENANCE,
    RELATIVE_PRECISION,
    SURFACE,
)
from orthomill.schemas.truth import (
    TRUTH_BELOW,
    TRUTH_BLOCK,
    TRUTH_BUILDING,
    TRUTH_GRID,
    TRUTH_MATERIAL,
    TRUTH_ORTHO,
    TRUTH_SURFACE,
    TRUTH_VISIBILITY,
)
from orthomill.tasks.evaluation.accuracy import HeightHistogram, HeightSums
from orthomill.tasks.evaluation.classes import HALO as CLASS_HALO
from orthomill.tasks.evaluation.classes import CheckCounts
from orthomill.tasks.evaluation.edges import EdgeCounts
from orthomill.tasks.evaluation.grids import Placement, grid_of, placement, readable
from orthomill.tasks.evaluation.heights_section import DH
from orthomill.tasks.evaluation.orthoimage_accuracy import HALO, GreyFit, GreySums, OrthoCounts, Shifts, fit_grey
from orthomill.tasks.evaluation.orthoimage_section import ORTHO_DIFFERENCE
from orthomill.tasks.evaluation.porous_crowns import CrownCounts
from orthomill.tasks.evaluation.report import EvaluationFacts, evaluation_report
from orthomill.tasks.evaluation.tile_sums import (
    CheckSummary,
    HeightsSummary,
    OrientationSummary,
    OrthoSummary,
    summarise_check,
    summarise_heights,
    summarise_orientation,
    summarise_ortho,
)
from orthomill.tasks.evaluation.tiles import (
    OrthoPlace,
    OrthoTruthPlace,
    check_against_truth,
    heights_against_file,
    heights_against_truth,
    ortho_against_file,
    ortho_against_truth,
    sums_against_file,
    sums_against_truth,
)

Reads = dict[str, Region | tuple[Region, ...]]

DIFFERENCES = {"heights": DH, "heights_before_check": "evaluation/dh_before_check"}
FIT = Table("evaluation/grey_fit.json", GreyFit)
ORTHO_AXES = ("ortho_y", "ortho_x")
"""The orthoimage has smaller cells than the height differences in the same group."""


class TruthReference(Settings):
    """The truth of a simulated scene."""

    kind: Literal["truth"] = "truth"


class FileReference(Settings):
    """Georeferenced raster files from another source; they are taken to be free of error."""

    kind: Literal["file"]
    dsm: ProjectMap | None = setting(None, "Raster file with heights, relative to the project's root.")
    ortho: ProjectMap | None = setting(None, "RGB raster file, relative to the project's root.")


class NoReference(Settings):
    """There is no reference."""

    kind: Literal["none"]


@dataclass(frozen=True)
class _Judged:
    """A product under evaluation: its map grid in tiles of `tile`, its `crs`, and its reference."""

    grid: MapGrid
    crs: str
    tile: int
    reference: MapGrid | str
    """grid of the truth, or path of the reference file"""


class EvaluationStage(Stage):
    """Surface model, orthoimage and orientation against truth or a reference: figures, maps, and shares within n sigma."""

    title: ClassVar[str] = "Accuracy evaluation"

    kind: Literal["evaluation"] = "evaluation"
    reference: Annotated[TruthReference | FileReference | NoReference, Field(discriminator="kind")] = setting(
        TruthReference(), "What the results are compared with."
    )
    parallax_sigma: float = setting(
        0.5,
        "Error of a parallax from which the expected precision of heights is computed: (H/B) times the ground pixel times this.",
        "px",
        gt=0,
    )

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job]:
        # the sentence about a missing simulation comes at planning, before anything has run
        self._check(view)
        parts: dict[str, Table] = {}
        for jobs in (self._orientation(view, parts), self._heights(view, parts), self._ortho(view, parts)):
            yield from jobs
        facts = EvaluationFacts(self.reference.kind, tuple(parts))
        reads: Reads = {**parts}
        yield Job(
            stage="evaluation",
            item="report",
            function=evaluation_report,
            reads=reads,
            writes={"report": report_table("evaluation")},
            params={"facts": facts},
        )

    def _check(self, view: ProjectView) -> None:
        """Raises WorkflowError when there is no truth to compare with."""
        if self.reference.kind == "truth" and not view.has_stage("simulation"):
            raise WorkflowError(
                "The stage 'evaluation' compares with the truth of a simulation, but the workflow has no stage 'simulation'; "
                "set reference to {kind: file, ...} or {kind: none}."
            )

    def _orientation(self, view: ProjectView, parts: dict[str, Table]) -> Iterator[Job]:
        if self.reference.kind != "truth" or not view.has_stage("orientation"):
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

    def _file_of(self, product: Literal["dsm", "ortho"]) -> str | None:
        """The reference file of a product; None where it is compared with the truth, or not at all."""
        return getattr(self.reference, product) if isinstance(self.reference, FileReference) else None

    def _judged(self, view: ProjectView, grid: MapGrid, product: Literal["dsm", "ortho"]) -> _Judged:
        reference = self._file_of(product) or view.table(TRUTH_GRID)
        return _Judged(grid, view.table(BLOCK).crs, view.project.tile, reference)

    def _compares(self, view: ProjectView, product: Literal["dsm", "ortho"], stage: str) -> bool:
        known = self.reference.kind == "truth" or self._file_of(product) is not None
        return known and view.has_stage(stage)

    def _heights(self, view: ProjectView, parts: dict[str, Table]) -> Iterator[RasterSpec | Job]:
        if not self._compares(view, "dsm", "densification"):
            return
        judged = self._judged(view, view.table(SURFACE).grid, "dsm")
        pairs: Reads = {"pairs": PAIRS} if view.has_stage("epipolar") else {}
        if not view.has_stage("dsm_check"):
            yield from self._judge_heights(judged, HEIGHT, "heights", pairs, parts)
            return
        # Both surfaces: what the check improved or spoiled shows only in comparison with its input.
        yield from self._judge_heights(judged, CORRECTED, "heights", pairs, parts)
        yield from self._judge_heights(judged, HEIGHT, "heights_before_check", pairs, parts)
        yield from _judge_check(judged, parts)

    def _judge_heights(
        self, judged: _Judged, source: str, item: str, pairs: Reads, parts: dict[str, Table]
    ) -> Iterator[RasterSpec | Job]:
        dh = DIFFERENCES[item]
        yield map_raster(dh, judged.grid, "float32", judged.crs, judged.tile, nodata=float("nan"), unit="m")
        results = []
        for t in tiles_of(judged.grid.shape, judged.tile):
            results.append(_height_results(item, t))
            yield _height_job(judged, item, source, t, {"dh": Raster(dh, t.window), **results[-1]})
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
        params = {"cell": judged.grid.cell, "parallax_sigma": self.parallax_sigma}
        yield Job(
            stage="evaluation",
            item=f"{item}_summary",
            function=summarise_heights,
            reads=reads,
            writes={"summary": parts[item]},
            params=params,
        )

    def _ortho(self, view: ProjectView, parts: dict[str, Table]) -> Iterator[RasterSpec | Job]:
        if not self._compares(view, "ortho", "texture"):
            return
        judged = self._judged(view, grid_of(view.raster(ORTHO)), "ortho")
        yield _difference_raster(judged)
        tiles = list(tiles_of(judged.grid.shape, judged.tile))
        sums = [Table(f"evaluation/ortho/sums-{t.row}-{t.col}.json", GreySums) for t in tiles]
        for t, table in zip(tiles, sums, strict=True):
            yield _sums_job(judged, t, table)
        # One fit for the whole image, so one job that waits for all tiles: a fit per tile would hide differences between tiles.
        yield Job(stage="evaluation", item="grey_fit", function=fit_grey, reads={"parts": tuple(sums)}, writes={"fit": FIT})
        counts = [Table(f"evaluation/ortho/counts-{t.row}-{t.col}.json", OrthoCounts) for t in tiles]
        moved = [Table(f"evaluation/ortho/shifts-{t.row}-{t.col}.parquet", Shifts) for t in tiles]
        for t, count, shift in zip(tiles, counts, moved, strict=True):
            yield _ortho_job(judged, t, {"counts": count, "shifts": shift, "difference": Raster(ORTHO_DIFFERENCE, t.window)})
        parts["ortho"] = Table("evaluation/ortho.json", OrthoSummary)
        reads: Reads = {"counts": tuple(counts), "shifts": tuple(moved), "fit": FIT}
        yield Job(
            stage="evaluation", item="ortho_summary", function=summarise_ortho, reads=reads, writes={"summary": parts["ortho"]}
        )


def _judge_check(judged: _Judged, parts: dict[str, Table]) -> Iterator[Job]:
    """Where the check could judge, by class; a file as reference knows none."""
    if isinstance(judged.reference, str):
        return
    results = []
    for t in tiles_of(judged.grid.shape, judged.tile):
        place = placement(judged.grid, t.window.grown(CLASS_HALO), judged.reference)
        reads: Reads = {"code": Raster(CHECKED_CODE, t.window), **_truth(place, material=TRUTH_MATERIAL)}
        results.append(Table(f"evaluation/check/{t.row}-{t.col}.parquet", CheckCounts))
        params, scratch = {"place": place, "core": t.window}, _scratch(place, 40)
        yield Job(
            stage="evaluation",
            item="check",
            function=check_against_truth,
            reads=reads,
            writes={"counts": results[-1]},
            params=params,
            row=t.row,
            col=t.col,
            scratch=scratch,
        )
    parts["check"] = Table("evaluation/check.json", CheckSummary)
    yield Job(
        stage="evaluation",
        item="check_summary",
        function=summarise_check,
        reads={"counts": tuple(results)},
        writes={"summary": parts["check"]},
    )


def _difference_raster(judged: _Judged) -> RasterSpec:
    nan = float("nan")
    return map_raster(
        ORTHO_DIFFERENCE, judged.grid, "float32", judged.crs, judged.tile, nodata=nan, unit="grey levels", axes=ORTHO_AXES
    )


def _height_job(judged: _Judged, item: str, source: str, t: Tile, writes: dict[str, Raster | Table]) -> Job:
    own = {"height": source, "precision": PRECISION, "provenance": PROVENANCE}
    reads: Reads = {key: Raster(name, t.window) for key, name in own.items()}
    if isinstance(judged.reference, str):
        reads["reference"] = MapFile(judged.reference, judged.crs, judged.grid, t.window)
        return Job(
            stage="evaluation",
            item=item,
            function=heights_against_file,
            reads=reads,
            writes=writes,
            params={"cell": judged.grid.cell},
            row=t.row,
            col=t.col,
        )
    # the halo of the classes: a building within three cells makes a cell a margin, also from the next tile
    place = placement(judged.grid, t.window.grown(CLASS_HALO), judged.reference)
    reads |= _truth(place, surface=TRUTH_SURFACE, below=TRUTH_BELOW, material=TRUTH_MATERIAL)
    reads |= _truth(place, building=TRUTH_BUILDING, visibility=TRUTH_VISIBILITY)
    reads |= {"relative": Raster(RELATIVE_PRECISION, t.window), "block": BLOCK, "true_block": TRUTH_BLOCK}
    params, scratch = {"place": place, "core": t.window}, _scratch(place, 120)
    return Job(
        stage="evaluation",
        item=item,
        function=heights_against_truth,
        reads=reads,
        writes=writes,
        params=params,
        row=t.row,
        col=t.col,
        scratch=scratch,
    )


def _sums_job(judged: _Judged, t: Tile, table: Table[GreySums]) -> Job:
    reads: Reads = {"ortho": Raster(ORTHO, t.window)}
    if isinstance(judged.reference, str):
        reads["reference"] = MapFile(judged.reference, judged.crs, judged.grid, t.window, bands=3)
        return Job(
            stage="evaluation",
            item="grey_sums",
            function=sums_against_file,
            reads=reads,
            writes={"sums": table},
            params={},
            row=t.row,
            col=t.col,
        )
    place = placement(judged.grid, t.window, judged.reference)
    reads |= _truth(place, truth=TRUTH_ORTHO)
    scratch = _scratch(place, 80)
    return Job(
        stage="evaluation",
        item="grey_sums",
        function=sums_against_truth,
        reads=reads,
        writes={"sums": table},
        params={"place": place},
        row=t.row,
        col=t.col,
        scratch=scratch,
    )


def _ortho_job(judged: _Judged, t: Tile, writes: dict[str, Raster | Table]) -> Job:
    # the halo: windows of the matching and the way to the nearest roof reach beyond the tile
    window = t.window.grown(HALO).clipped(judged.grid.shape)
    reads: Reads = {"ortho": Raster(ORTHO, window), "height_source": Raster(HEIGHT_SOURCE, window), "fit": FIT}
    if isinstance(judged.reference, str):
        reads["reference"] = MapFile(judged.reference, judged.crs, judged.grid, window, bands=3)
        params = {"where": OrthoPlace(judged.grid, t.window, window)}
        return Job(
            stage="evaluation",
            item="ortho",
            function=ortho_against_file,
            reads=reads,
            writes=writes,
            params=params,
            row=t.row,
            col=t.col,
        )
    place = placement(judged.grid, window, judged.reference)
    reads |= _truth(place, truth=TRUTH_ORTHO, material=TRUTH_MATERIAL, visibility=TRUTH_VISIBILITY, surface=TRUTH_SURFACE)
    reads |= {"block": TRUTH_BLOCK, "adjusted": BLOCK}
    params = {"where": OrthoTruthPlace(judged.grid, t.window, window, place)}
    return Job(
        stage="evaluation",
        item="ortho",
        function=ortho_against_truth,
        reads=reads,
        writes=writes,
        params=params,
        row=t.row,
        col=t.col,
        scratch=_scratch(place, 250),
    )


def _height_results(item: str, t: Tile) -> dict[str, Table]:
    """The tables of a tile of heights."""
    types = {
        "sums": HeightSums,
        "histogram": HeightHistogram,
        "buildings": HeightHistogram,
        "edges": EdgeCounts,
        "crowns": CrownCounts,
    }
    return {key: Table(f"evaluation/{item}/{key}-{t.row}-{t.col}.parquet", type_) for key, type_ in types.items()}


def _truth(place: Placement, **names: str) -> Reads:
    """The truth rasters of a placement, as reads under the given names."""
    return {key: Raster(name, readable(place)) for key, name in names.items()}


def _scratch(place: Placement, bytes_per_pixel: int) -> int:
    return place.window.height * place.window.width * bytes_per_pixel
