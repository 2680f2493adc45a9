"""The jobs that compare the orthoimage with a reference."""

from orthomill.schemas.job import Job, MapFile, Raster, Table
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.raster import RasterSpec, Tile, map_raster
from orthomill.schemas.surface import HEIGHT_SOURCE, ORTHO
from orthomill.schemas.truth import TRUTH_BLOCK, TRUTH_MATERIAL, TRUTH_ORTHO, TRUTH_SURFACE, TRUTH_VISIBILITY
from orthomill.tasks.evaluation.grids import placement
from orthomill.tasks.evaluation.orthoimage_accuracy import HALO, GreyFit, GreySums
from orthomill.tasks.evaluation.plan.judged_product import ORTHO_AXES, JudgedProduct, Reads, pixels_scratch, truth_reads
from orthomill.tasks.evaluation.report.orthoimage_section import ORTHO_DIFFERENCE
from orthomill.tasks.evaluation.tiles import (
    OrthoPlace,
    OrthoTruthPlace,
    ortho_against_file,
    ortho_against_truth,
    sums_against_file,
    sums_against_truth,
)

FIT = Table("evaluation/grey_fit.json", GreyFit)


def difference_raster(judged: JudgedProduct) -> RasterSpec:
    """Where the orthoimage differs from the reference, grey levels."""
    nan = float("nan")
    return map_raster(
        ORTHO_DIFFERENCE, judged.grid, "float32", judged.crs, judged.tile, nodata=nan, unit="grey levels", axes=ORTHO_AXES
    )


def sums_job(judged: JudgedProduct, t: Tile, table: Table[GreySums]) -> Job:
    """The job that sums grey values of a tile and of the reference, to which the orthoimage is fitted as a whole."""
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
    reads |= truth_reads(place, truth=TRUTH_ORTHO)
    scratch = pixels_scratch(place, 80)
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


def ortho_job(judged: JudgedProduct, t: Tile, writes: dict[str, Raster | Table]) -> Job:
    """The job that compares a tile of the orthoimage with the reference, after the fit of grey values."""
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
    reads |= truth_reads(place, truth=TRUTH_ORTHO, material=TRUTH_MATERIAL, visibility=TRUTH_VISIBILITY, surface=TRUTH_SURFACE)
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
        scratch=pixels_scratch(place, 250),
    )
