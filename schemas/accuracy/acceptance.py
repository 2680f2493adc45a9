"""What a delivery must keep: profiles of acceptance as settings, and the clauses that come of them.

Every limit is a setting; a profile is a set of defaults, so that a client's own numbers replace those of the standard. A limit of
null is not asked for.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from orthomill.schemas.accuracy.acceptance_record import AcceptanceRecord, StandardWording, SystemNames
from orthomill.schemas.accuracy.accuracy_statement import AccuracyStatement
from orthomill.schemas.accuracy.point_tests import PointTest
from orthomill.schemas.project_paths import ProjectPath
from orthomill.schemas.settings import Settings, setting

Outcome3 = Literal["met", "missed", "not testable"]


class AcceptanceLimits(Settings):
    """The limits that all profiles share."""

    plan: float | None = setting(None, "Root mean square error in plan (radial), survey included, at most.", "m", gt=0)
    plan_pixels: float | None = setting(None, "The same in pixels of the orthoimage.", "px", gt=0)
    height: float | None = setting(None, "Root mean square error in height on open ground, survey included, at most.", "m", gt=0)
    points: int = setting(0, "Check points at least at which each product is tested.", ge=0)
    survey_share: float | None = setting(
        None, "Largest share of the survey's own error in the accuracy that is asked for; 0.5: twice as accurate.", gt=0, le=1
    )
    pixel: float | None = setting(None, "Pixel of the orthoimage at most.", "m", gt=0)
    voids: float | None = setting(None, "Pixels without colour inside the outline of the orthoimage, at most.", "%", ge=0, le=100)
    gaps: float | None = setting(None, "Cells without height inside the outline of the surface, at most.", "%", ge=0, le=100)
    area: ProjectPath | None = setting(None, "File of polygons (GeoPackage, GeoJSON): what was ordered, and has to be covered.")
    covered: float = setting(100.0, "Share of `area` with colour, and with heights, at least.", "%", gt=0, le=100)
    estimated: float | None = setting(None, "Heights that are estimated instead of measured, at most.", "%", ge=0, le=100)
    clipped: float | None = setting(None, "Pixels of which a colour is quite black or quite white, at most.", "%", ge=0, le=100)
    seams: float | None = setting(None, "Mean difference of the colours of photographs at one place, at most.", "grey levels", gt=0)
    earliest: str | None = setting(None, "Photographs taken on this day or later, as 2026-05-31.", pattern=r"^\d{4}-\d\d-\d\d$")
    latest: str | None = setting(None, "Photographs taken on this day or before.", pattern=r"^\d{4}-\d\d-\d\d$")
    plan_stated: bool = setting(False, "Whether the accuracy in plan must be known from independent points, whatever it is.")
    heights_named: bool = setting(False, "Whether the reference system must name what heights refer to.")

    def plan_limit(self, pixel: float | None) -> float | None:
        """What is asked for in plan, m, with this pixel of the orthoimage, m; None: nothing, or pixels of which none is known."""
        return self.plan or (self.plan_pixels * pixel if self.plan_pixels and pixel else None)

    @property
    def asks(self) -> bool:
        """Whether there is a clause at all."""
        of_accuracy = (self.plan, self.plan_pixels, self.height, self.pixel, self.plan_stated or None, self.heights_named or None)
        of_products = (self.voids, self.gaps, self.area, self.estimated, self.clipped, self.seams, self.earliest, self.latest)
        return any(limit is not None for limit in (*of_accuracy, *of_products))


class NoAcceptance(Settings):
    """Nothing was agreed."""

    kind: Literal["none"]


class AsprsAcceptance(AcceptanceLimits):
    """ASPRS Positional Accuracy Standards, edition 2 (2023): 30 check points, surveyed twice as accurately as what is asked for.
    The classes are given as `plan` and `height`, m."""

    kind: Literal["asprs_2023"]
    points: int = setting(30, "Check points at least at which each product is tested.", ge=0)
    survey_share: float | None = setting(0.5, "Largest share of the survey's own error in the accuracy asked for.", gt=0, le=1)

    @model_validator(mode="after")
    def _names_a_class(self) -> Self:
        # The standard names no class for anybody: without one its conditions hold for nothing.
        if self.plan is None and self.plan_pixels is None and self.height is None:
            raise ValueError(
                "the standard leaves the class to those who order; give plan, plan_pixels or height: the root mean square errors "
                "agreed, e.g. plan: 0.05, height: 0.05"
            )
        return self


class AdvAcceptance(AcceptanceLimits):
    """AdV, product standard of digital orthophotos (DOP20, TrueDOP): pixels of 20 cm, 40 cm in plan, no gaps. The 40 cm are from
    memory and not from a copy of the standard: put the number of your own copy there."""

    kind: Literal["adv_truedop"]
    pixel: float | None = setting(0.2, "Pixel of the orthoimage at most.", "m", gt=0)
    plan: float | None = setting(0.4, "Root mean square error in plan (radial), survey included, at most.", "m", gt=0)
    voids: float | None = setting(0.0, "Pixels without colour inside the outline of the orthoimage, at most.", "%", ge=0, le=100)


class InspireAcceptance(AcceptanceLimits):
    """INSPIRE, data specification on orthoimagery (D2.8.II.3, technical guidelines 3.0, 7.1 to 7.3): no pixel missing inside of the
    outline (recommendation 15), and the accuracy in plan stated, whatever it is (recommendation 14): no limit is given for it."""

    kind: Literal["inspire_oi"]
    voids: float | None = setting(0.0, "Pixels without colour inside the outline of the orthoimage, at most.", "%", ge=0, le=100)
    plan_stated: bool = setting(True, "Whether the accuracy in plan must be known from independent points, whatever it is.")


class CustomAcceptance(AcceptanceLimits):
    """A client's own limits."""

    kind: Literal["custom"]

    @model_validator(mode="after")
    def _asks_for_something(self) -> Self:
        if not self.asks:
            raise ValueError("no limit is given, so nothing would be tested; give those that were agreed, e.g. plan: 0.1, voids: 0")
        return self


Acceptance = Annotated[
    NoAcceptance | AsprsAcceptance | AdvAcceptance | InspireAcceptance | CustomAcceptance, Field(discriminator="kind")
]


@dataclass(frozen=True)
class InspectedProducts:
    """Products at surveyed points: what is stated of them, and the test of each point."""

    statement: AccuracyStatement = field(default_factory=AccuracyStatement)
    points: tuple[PointTest, ...] = ()


@dataclass(frozen=True)
class DeliveryFacts:
    """What is known of a delivery; None: nobody can tell."""

    statement: AccuracyStatement = field(default_factory=AccuracyStatement)
    pixel: float | None = None
    """m, of the orthoimage"""
    voids: float | None = None
    gaps: float | None = None
    estimated: float | None = None
    clipped: float | None = None
    """%"""
    covered: tuple[tuple[str, float], ...] = ()
    """(what was delivered, share of the area that was ordered, %)"""
    seams: float | None = None
    """grey levels"""
    first_day: str | None = None
    last_day: str | None = None
    """of the photographs, ISO 8601"""
    crs: str = ""
    systems: SystemNames | None = None
    """of what was delivered by name; None: nothing with heights was"""
    remarks: tuple[str, ...] = ()
    """what was assumed of the points"""
    points: tuple[PointTest, ...] = ()
    """the products at each of them"""
    known: tuple[str, ...] = ()
    """what a run says of itself without surveyed points: agreement, promise"""
    doubts: tuple[str, ...] = ()
    """of its own results"""
    made: str = ""
    """version and time of the run"""


class Clause(BaseModel):
    """One clause with what was asked for and what was found."""

    model_config = ConfigDict(frozen=True)

    clause: str
    found: str
    limit: str
    outcome: Outcome3


class AcceptanceResult(BaseModel):
    """All clauses of a profile."""

    model_config = ConfigDict(frozen=True)

    profile: str
    delivery: str
    clauses: tuple[Clause, ...]
    findings: tuple[str, ...] = ()
    """errors that the check points share, by name"""
    wordings: tuple[StandardWording, ...] = ()
    """the accuracy as the standard words it"""
    record: AcceptanceRecord | None = None
    """what makes it a document; None in those of earlier versions"""

    @property
    def complete(self) -> bool:
        """Whether each clause is met: one that cannot be tested is not."""
        return bool(self.clauses) and all(clause.outcome == "met" for clause in self.clauses)

    @property
    def sentence(self) -> str:
        """The verdict."""
        if self.complete:
            return f"The delivery of {self.delivery} keeps all {len(self.clauses)} clauses of {self.profile}."
        missed, untested = (sum(c.outcome == outcome for c in self.clauses) for outcome in ("missed", "not testable"))
        of = f"{missed} of {len(self.clauses)} clauses missed, {untested} not testable"
        return f"The delivery of {self.delivery} is not complete by {self.profile}: {of}."
