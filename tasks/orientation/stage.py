"""The stage `orientation`: relative orientation pair by pair, then all photographs as one block in the project's system."""

from collections.abc import Iterator
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from orthomill.schemas.job import Export, Job
from orthomill.schemas.observations import CONTROL
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import refuse_ignored, setting
from orthomill.schemas.stage_contract import InspectionPart, Outline, ProjectView, Stage
from orthomill.tasks.adjustment.model.interior_settings import InteriorChoice, NoVariation, VariationChoice, WeightedInterior
from orthomill.tasks.orientation.orientation_settings import Adjusted, ExteriorSource, ForeignSource, Looking, ShiftChoice
from orthomill.tasks.orientation.sources.elevation_model import ElevationFile

OF_THE_ADJUSTMENT = (
    "least_matches",
    "interior",
    "gnss_shift",
    "lever_arm",
    "lever_sigma",
    "looking",
    "vertical_sigma",
    "rejection",
    "variation",
    "elevation",
)
"""Settings that only the block adjustment reads."""


class OrientationStage(Stage):
    """Relative orientation of pairs, then a bundle adjustment with control, GNSS positions and check points."""

    title: ClassVar[str] = "Relative and block orientation"
    inspects: ClassVar[InspectionPart | None] = "cameras"
    kind: Literal["orientation"] = "orientation"
    exterior: ExteriorSource = setting(
        Adjusted(kind="adjusted"),
        "Where the exterior orientation comes from: the block adjustment, or a file of another program, which is fixed or gives "
        "starting values.",
    )
    least_matches: int = setting(15, "Pairs that share fewer tie points are not related.", "tie points", ge=6)
    interior: InteriorChoice = setting(
        WeightedInterior(kind="weighted"), "How the interior orientation takes part in the adjustment."
    )
    gnss_shift: ShiftChoice = setting(
        "auto",
        "Whether constant errors of the GNSS positions are adjusted: auto: of a flight, or of all positions against control, where "
        "the sources contradict each other without; constant: one of all positions, which needs control; none: never.",
    )
    lever_arm: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0),
        "From the projection centre to the GNSS antenna, in the image system: x right, y up, z backwards, away from the ground.",
        "m",
    )
    lever_sigma: float | None = setting(
        None,
        "Standard error of the lever arm, which is then adjusted, that of each drone (by its serial number) for itself; 0: exactly "
        "known, not adjusted; null: 0.05 m for positions that "
        "are more precise than that in plan, else 0.",
        "m",
        ge=0,
    )
    looking: Looking = setting(
        "auto",
        "How photographs without an attitude look: straight down, or level (held upright, as in a hand); auto takes photographs "
        "that look along the line of their positions or to all sides for level. Used only where positions and control lie on one "
        "line and leave the tilt about it undetermined.",
    )
    vertical_sigma: float | None = setting(
        None,
        "Standard error of the mean vertical by attitudes or `looking`; used only where positions and control lie on one line and "
        "leave the tilt about it undetermined. null: 1 for attitudes of gimbals, 3 of aircraft, else 5.",
        "degrees",
        gt=0,
        le=45,
    )
    rejection: float = setting(
        4.0, "Image measurements with a larger standardised residual are rejected.", "standard errors", ge=2.5
    )

    variation: VariationChoice = setting(
        NoVariation(kind="none"),
        "What of the interior orientation varies from photograph to photograph: nothing, the camera constant (zoom), the principal "
        "point (stabilised), or what a rolling shutter does.",
    )

    elevation: ElevationFile | None = setting(
        None,
        "An elevation model of the ground, a source that the heights and the tilt of the block are compared with; it takes no "
        "part in the adjustment.",
    )

    @model_validator(mode="after")
    def _a_fixed_orientation_is_not_adjusted(self) -> Self:
        if self.fixed_source is not None:
            remedy = "leave it out, or adjust the block with `use: start` or `exterior: {kind: adjusted}`"
            refuse_ignored(self, OF_THE_ADJUSTMENT, "an exterior orientation that is fixed (`use: fixed`)", remedy)
        return self

    @property
    def fixed_source(self) -> ForeignSource | None:
        """The file that fixes the exterior orientation; None where the block is adjusted."""
        source = self.exterior
        return source if source.kind != "adjusted" and source.use == "fixed" else None

    def remarks(self, view: ProjectView) -> Iterator[str]:
        """What is noticed about the control, the gravest first, and what was read."""
        control = view.table(CONTROL)
        yield from (finding.sentence for finding in sorted(control.findings, key=lambda finding: not finding.grave))
        if control.read:
            yield control.read.sentence

    def outlines(self, view: ProjectView) -> Iterator[tuple[str, Outline]]:
        """Where the corners of every photograph lie at the mean height of the ground."""
        from orthomill.tasks.geometry.footprint import ground_outline
        from orthomill.tasks.geometry.view import block_view

        block = view.table(BLOCK)
        for name in block.names:
            if outline := ground_outline(block_view(block, name), block.ground_mean):
                yield name, outline

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """Control, pairs, the block, and what is made from it."""
        from orthomill.tasks.orientation.plan.orientation_jobs import orientation_jobs

        return orientation_jobs(self, view)
