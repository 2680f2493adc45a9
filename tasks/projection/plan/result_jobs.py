"""The jobs about all outputs together: their samples and balance, how wide limits are, their colours; report and products."""

from collections.abc import Iterator
from typing import Literal

from orthomill.schemas.job import Export, Job, Reading, Table
from orthomill.schemas.photo import photo_raster
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.solid.frames import FlatFrame
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.stage_report import report_table
from orthomill.tasks.colouring.blending.colour_rules import ColourRules
from orthomill.tasks.colouring.colour_settings import ColourSettings
from orthomill.tasks.colouring.plan.balance_jobs import balance_job
from orthomill.tasks.colouring.widening.hidden_edges import ChosenWidth, WideningRules
from orthomill.tasks.projection.frames.seen_planes import degrees_before
from orthomill.tasks.projection.lines.sections import NoSection
from orthomill.tasks.projection.plan.model_jobs import ModelJobs
from orthomill.tasks.projection.plan.output_jobs import OutputJobs
from orthomill.tasks.projection.plan.projection_tables import (
    CENSUS,
    FACING,
    FRAMES,
    RADIOMETRY,
    left_out_table,
    output_layer,
    samples_table,
    statistics_table,
)
from orthomill.tasks.projection.plan.widening_jobs import WideningJobs, width_job
from orthomill.tasks.projection.report.output_totals import OutputFacts
from orthomill.tasks.projection.report.projection_report import projection_report
from orthomill.tasks.visibility.mesh_sight import SightTolerance


def sample_jobs(
    view: ProjectView, settings: ColourSettings, outputs: list[OutputJobs], names: tuple[str, ...], tolerance: SightTolerance
) -> Iterator[RasterSpec | Job]:
    """How the photographs `names` see all outputs, samples and the balance."""
    first = 0
    for output in outputs:
        frame = output.frame.frame
        yield from output.sight(tolerance)
        yield from output.samples(settings.sample_spacing(frame.rows * frame.cols * len(outputs)), first)
        first += frame.rows * frame.cols
    tables = [samples_table(output.frame.name, tile) for output in outputs for tile in output.frame.tiles]
    dtypes = [view.raster(photo_raster(name, 0)).dtype for name in names]
    yield balance_job("projection", settings, names, dtypes, tables)


def width_jobs(
    outputs: list[OutputJobs], widening: WideningRules, width: float | Literal["auto"], rules: ColourRules
) -> Iterator[RasterSpec | Job]:
    """The zones next to limits in all outputs, and how many of them are used: `width` px, or what trials tell."""
    every = [WideningJobs(output, widening) for output in outputs]
    for jobs in every:
        yield from jobs.zones()
        if width == "auto":
            yield from jobs.trials(rules)
    yield width_job(every, None if width == "auto" else width)


def report_job(
    outputs: list[OutputJobs],
    proofs: list[OutputJobs],
    model: ModelJobs | None,
    widening: Table[ChosenWidth] | None,
    pictured: tuple[str, ...],
) -> Job:
    """The report; `pictured`: photographs whose depths it shows."""
    reads: dict[str, Reading] = {
        "census": CENSUS,
        "facing": FACING,
        "radiometry": RADIOMETRY,
        "statistics": tuple(statistics_table(output.frame.name, tile) for output in outputs for tile in output.frame.tiles),
        "left_out": tuple(left_out_table(proof.frame.name) for proof in proofs),
        "textures": model.facts() if model else (),
    }
    if widening:
        reads["widening"] = widening
    return Job(
        stage="projection",
        item="report",
        function=projection_report,
        reads=reads,
        writes={"report": report_table("projection")},
        params={
            "outputs": tuple(map(_facts, outputs)),
            "proofs": tuple(proof.frame.name for proof in proofs),
            "pictured": pictured,
            "whole_model": bool(model and model.is_whole),
        },
    )


def _facts(output: OutputJobs) -> OutputFacts:
    frame, block = output.frame, output.basis.block
    centres = [block.of(name).centre for name in output.basis.names]
    return OutputFacts(
        frame=frame.frame,
        tiles=len(frame.tiles),
        pixel=output.pixel,
        before=degrees_before(frame.frame, centres),
        cut=not isinstance(frame.section, NoSection),
        only=_only(output),
    )


def _only(output: OutputJobs) -> str | None:
    """The one photograph that an orthoimage shows because the others were left out of it; None: all of them."""
    frame = output.frame.frame
    shown = [name for name in output.basis.block.names if name not in frame.without]
    return shown[0] if isinstance(frame, FlatFrame) and frame.without and len(shown) == 1 else None


def product_exports(outputs: list[OutputJobs]) -> Iterator[Export]:
    """The outputs, and where they lie."""
    for output in outputs:
        frame = output.frame.frame
        # Only what lies on a plane has coordinates; a view and an unrolled cylinder are pictures.
        mapped = isinstance(frame, FlatFrame)
        kind, path = ("cog", f"products/{frame.name}.tif") if mapped else ("png", f"products/{frame.name}.png")
        yield Export("projection", f"{frame.name}-{kind}", path, kind, {"rgba": output_layer(frame.name, "ortho")})
    yield Export("projection", "frames_json", "products/projections.json", "json", tables=(FRAMES,))
