"""The jobs that compare heights, and where the check could judge, with a reference."""

from collections.abc import Iterator

from orthomill.schemas.job import HeightFile, Job, Raster, Table
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.raster import Tile, tiles_of
from orthomill.schemas.surface import CHECKED_CODE, PRECISION, PROVENANCE, RELATIVE_PRECISION
from orthomill.schemas.truth import TRUTH_BLOCK, TRUTH_BUILDING, TRUTH_GROUND, TRUTH_MATERIAL, TRUTH_SURFACE, TRUTH_VISIBILITY
from orthomill.tasks.evaluation.accuracy import HeightHistogram, HeightSums
from orthomill.tasks.evaluation.classes import HALO as CLASS_HALO
from orthomill.tasks.evaluation.classes import CheckCounts
from orthomill.tasks.evaluation.edges import EdgeCounts
from orthomill.tasks.evaluation.grids import placement
from orthomill.tasks.evaluation.plan.judged_product import JudgedProduct, Reads, pixels_scratch, truth_reads
from orthomill.tasks.evaluation.porous_crowns import CrownCounts
from orthomill.tasks.evaluation.tile_sums import CheckSummary, summarise_check
from orthomill.tasks.evaluation.tiles import check_against_truth, heights_against_file, heights_against_truth


def judge_check(judged: JudgedProduct, parts: dict[str, Table]) -> Iterator[Job]:
    """Where the check could judge, by class; a file as reference knows none."""
    if isinstance(judged.reference, str):
        return
    results = []
    for t in tiles_of(judged.grid.shape, judged.tile):
        place = placement(judged.grid, t.window.grown(CLASS_HALO), judged.reference)
        reads: Reads = {"code": Raster(CHECKED_CODE, t.window), **truth_reads(place, material=TRUTH_MATERIAL)}
        results.append(Table(f"evaluation/check/{t.row}-{t.col}.parquet", CheckCounts))
        params, scratch = {"place": place, "core": t.window}, pixels_scratch(place, 40)
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


def height_job(judged: JudgedProduct, item: str, source: str, t: Tile, writes: dict[str, Raster | Table]) -> Job:
    """The job that compares a tile of the heights in the raster `source` with the truth or with a reference from a file."""
    own = {"height": source, "precision": PRECISION, "provenance": PROVENANCE}
    reads: Reads = {key: Raster(name, t.window) for key, name in own.items()}
    if isinstance(judged.reference, str):
        reads["reference"] = HeightFile(judged.reference, judged.crs, judged.grid, t.window)
        return Job(
            stage="evaluation",
            item=item,
            function=heights_against_file,
            reads=reads,
            writes=writes,
            params={"cell": judged.grid.cell, "sigma": judged.sigma},
            row=t.row,
            col=t.col,
        )
    # the halo of the classes: a building within three cells makes a cell a margin, also from the next tile
    place = placement(judged.grid, t.window.grown(CLASS_HALO), judged.reference)
    reads |= truth_reads(place, surface=TRUTH_SURFACE, ground=TRUTH_GROUND, material=TRUTH_MATERIAL)
    reads |= truth_reads(place, building=TRUTH_BUILDING, visibility=TRUTH_VISIBILITY)
    reads |= {"relative": Raster(RELATIVE_PRECISION, t.window), "block": BLOCK, "true_block": TRUTH_BLOCK}
    params, scratch = {"place": place, "core": t.window}, pixels_scratch(place, 120)
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


def height_results(item: str, t: Tile) -> dict[str, Table]:
    """The tables of a tile of heights."""
    types = {
        "sums": HeightSums,
        "histogram": HeightHistogram,
        "buildings": HeightHistogram,
        "edges": EdgeCounts,
        "crowns": CrownCounts,
    }
    return {key: Table(f"evaluation/{item}/{key}-{t.row}-{t.col}.parquet", type_) for key, type_ in types.items()}
