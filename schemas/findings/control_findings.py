"""Findings from reading the control of a project that a reader must know: codes with names and numbers."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from orthomill.schemas.errors import some_of
from orthomill.schemas.findings.finding import SpokenFinding, two_digits
from orthomill.schemas.maps.compound_systems import with_vertical

GEOGRAPHIC = "EPSG:4326"


class _OfControl(SpokenFinding):
    @property
    def grave(self) -> bool:
        """Whether the block lacks what its user relies on; measurements of points that others measure as well are no such loss."""
        return True


# Geoid undulations reach tens of metres: heights that silently changed or kept their datum would shift the block by as much.
class HeightsNotTransformed(_OfControl):
    """Heights kept their values, because only one of the two reference systems has a vertical datum."""

    code: Literal["heights_not_transformed"] = "heights_not_transformed"
    crs: str
    """the system with a vertical datum"""

    @property
    def sentence(self) -> str:
        return f"Heights of control points were not transformed: only {self.crs} defines a vertical datum."


class ControlElsewhere(_OfControl):
    """Surveyed points lie far from the positions of the photographs and are not used."""

    code: Literal["control_elsewhere"] = "control_elsewhere"
    points: int
    crs: str
    """the reference system in which the points were read"""
    # A median, so that one mistyped coordinate does not report the whole file as being elsewhere.
    distance_m: float
    """median horizontal distance from the median position of the photographs"""
    fits: str | None = None
    """the reference system in which they would lie at the photographs; None: none of the usual ones"""
    # EPSG defines many systems with the northing or latitude first, while most files have the easting or longitude first.
    exchanged: bool = False
    """whether that requires exchanging their first two coordinates"""

    @property
    def sentence(self) -> str:
        return (
            f"The {self.points} control points, read as {self.crs}, are {self.distance_m / 1000:.0f} km from where the "
            f"photographs were taken; {self._advice()}. They were set aside and took no part in the adjustment."
        )

    def _advice(self) -> str:
        if self.fits is None:
            return "check whether the list is of this site, and the reference system, the order of the axes and the zone"
        system = "" if self.fits == self.crs else f"in {self.fits}"
        # In degrees people exchange latitude and longitude, on a map X and Y.
        axes = "latitude before longitude" if self.fits == GEOGRAPHIC else "X and Y exchanged"
        there = " ".join(word for word in ("they would be there", system, f"with {axes}" if self.exchanged else "") if word)
        return f"{there}: state it (control > crs)" if system else there


# Lists made from a map have plan coordinates only, and 0 where the format asks for a height.
class HeightsAllZero(_OfControl):
    """All surveyed points have the height 0."""

    code: Literal["heights_all_zero"] = "heights_all_zero"
    points: int
    freed: bool = False
    """whether they were taken as unknown, because positions give the block its heights"""

    @property
    def sentence(self) -> str:
        if self.freed:
            return (
                f"All {self.points} surveyed points have the height 0, which was taken as unknown: they hold the block in plan, "
                "the positions of the photographs hold it in height. Give their heights; points at sea level get them as 0.001."
            )
        return (
            f"All {self.points} surveyed points have the height 0. Unless they lie at sea level, their heights are missing, and "
            "the block is tilted and put to heights that are not its own. Give them, or NaN where they are unknown."
        )


# Users drop photographs and keep the control file; what that costs must be known before the block is believed.
class PhotographsAbsent(_OfControl):
    """Measurements in photographs that the project does not have were skipped."""

    code: Literal["photographs_absent"] = "photographs_absent"
    measurements: int
    """how many were skipped"""
    photos: tuple[str, ...]
    """the absent photographs, as the file names them"""
    lost: tuple[str, ...] = ()
    """control and check points that are measured in absent photographs only, and were left out"""

    @property
    def sentence(self) -> str:
        are = "is" if len(self.lost) == 1 else "are"
        lost = f"; {some_of(self.lost)} {are} measured in no other and left out" if self.lost else ""
        were = "measurement of control points was" if self.measurements == 1 else "measurements of control points were"
        return (
            f"{self.measurements} {were} skipped, as the project does not have the photographs {some_of(self.photos)}{lost}. "
            "Set absent: refuse below control if no photograph may be missing."
        )

    @property
    def grave(self) -> bool:
        return bool(self.lost)


class ChecksUnmarked(_OfControl):
    """Check points that are marked in no photograph: heights of products are tested at them, and nothing else."""

    code: Literal["checks_unmarked"] = "checks_unmarked"
    points: tuple[str, ...]

    @property
    def sentence(self) -> str:
        are, they = ("is", "It tests") if len(self.points) == 1 else ("are", "They test")
        return (
            f"{some_of(self.points)} {are} marked in no photograph. {they} the heights of the products, as under vegetation, but "
            "neither the block nor the orthoimage."
        )

    @property
    def grave(self) -> bool:
        return False


class TargetsNotFound(_OfControl):
    """Points of which no coded target was found in any photograph."""

    code: Literal["targets_not_found"] = "targets_not_found"
    points: tuple[str, ...]

    @property
    def sentence(self) -> str:
        were = "point was" if len(self.points) == 1 else "points were"
        return (
            f"The coded targets of {len(self.points)} {were} found in no photograph: {some_of(self.points)}. Names must be those "
            "of the codes (orthomill inspect targets PHOTO lists them), and a code must be 20 pixels wide or more."
        )

    @property
    def grave(self) -> bool:
        return False


class TargetsTwice(_OfControl):
    """Photographs show the same code at several places."""

    code: Literal["targets_twice"] = "targets_twice"
    codes: tuple[str, ...]
    photos: tuple[str, ...]

    @property
    def sentence(self) -> str:
        return (
            f"More than one target with the code {some_of(self.codes)} is in {some_of(self.photos)}; it was not used there, and "
            "elsewhere nothing tells which of the targets is meant. Take one of them away, or mark the points by hand."
        )


# People reduce photographs and keep the list that was measured in the originals.
class MeasurementsOfOriginals(_OfControl):
    """Control measurements were read as pixels of the photographs before these were reduced."""

    code: Literal["measurements_of_originals"] = "measurements_of_originals"
    measurements: int
    outside: int
    """how many of them lie outside of the photographs as they are"""
    original: tuple[int, int]
    reduced: tuple[int, int]
    """width and height of one of the photographs before and after, px"""

    @property
    def sentence(self) -> str:
        (width, height), (now_width, now_height) = self.original, self.reduced
        return (
            f"{self.outside} of {self.measurements} control measurements lie outside of the photographs, but all of them "
            f"inside of the originals, which were reduced ({width} x {height} to {now_width} x {now_height} px by their tags): "
            "they were read as pixels of the originals. Compare one with its photograph."
        )

    @property
    def grave(self) -> bool:
        return False


# Tags are lost when photographs are reduced, and nothing else tells by how much.
class MeasurementsReduced(_OfControl):
    """Control measurements were divided by one factor, because only so do all of them lie inside of the photographs."""

    code: Literal["measurements_reduced"] = "measurements_reduced"
    measurements: int
    outside: int
    """how many of them lie outside of the photographs as they are"""
    factor: float

    @property
    def sentence(self) -> str:
        return (
            f"{self.outside} of {self.measurements} control measurements lie outside of the photographs, but all inside, "
            f"some near the border, when they are divided by {self.factor:.4g}: they were read as pixels of photographs that "
            "were reduced by this factor since. Compare one with its photograph."
        )

    @property
    def grave(self) -> bool:
        return False


# EPSG defines northing or latitude first for many systems, and so do the files of some programs.
class ControlExchanged(_OfControl):
    """The first two coordinates of surveyed points were exchanged, because only so are they where the photographs were taken."""

    code: Literal["control_exchanged"] = "control_exchanged"
    points: int
    crs: str

    @property
    def sentence(self) -> str:
        return (
            f"The northing (or latitude) of the {self.points} surveyed points comes first in their file: they were read so, "
            f"because only then are they where the photographs were taken, in {self.crs}."
        )

    @property
    def grave(self) -> bool:
        return False


class ControlInDegrees(_OfControl):
    """Surveyed points were read as longitude and latitude, which nothing but their numbers tells."""

    code: Literal["control_in_degrees"] = "control_in_degrees"
    points: int

    @property
    def sentence(self) -> str:
        return (
            f"The coordinates of the {self.points} surveyed points are degrees, and were read as longitude and latitude "
            "(EPSG:4326); name the system if it is another (control > crs)."
        )

    @property
    def grave(self) -> bool:
        return False


class HeightsUnknown(_OfControl):
    """Surveyed points without heights: used in plan only."""

    code: Literal["heights_unknown"] = "heights_unknown"
    points: tuple[str, ...]
    zero: bool = False
    """whether their height is 0, where others have real ones, or all of them have it"""
    left_out: tuple[str, ...] = ()
    """check points, which check nothing without a height"""
    numbers: tuple[float, ...] = ()
    """what stands in their place, where a program has written numbers for no height"""
    alone: bool = False
    """whether no other point has a height, nor any photograph a position"""
    lines: tuple[int, ...] = ()
    """of the points in the file `path`; empty: they come from no lines"""
    path: str = ""

    @property
    def sentence(self) -> str:
        why = "have the height 0 among others that are far from it" if self.zero else "have no height"
        if self.numbers:
            numbers = " or ".join(f"{number:.0f}" for number in self.numbers)
            why = f"have the height {numbers}, as programs write it where they know none,"
        if self.alone:
            return (
                f"All surveyed points {why.rstrip(',')}, and nothing else holds the block in height: they were put to the height "
                "0, and the block is tilted and put to heights that are not its own. Give their heights."
            )
        lost = f" {some_of(self.left_out)}, as check points, were left out." if self.left_out else ""
        real = " A height that is real is taken with its decimals, as 9999.01." if self.numbers else ""
        named = [f"{name} (line {line})" for name, line in zip(self.points, self.lines, strict=False)] or self.points
        where = f" of {self.path}" if self.path else ""
        return f"Surveyed points that {why} are used in plan only: {some_of(named)}{where}.{lost}{real}"

    @property
    def grave(self) -> bool:
        return bool(self.left_out) or self.alone


class HeightsInFeet(_OfControl):
    """Heights of surveyed points that are, or may be, in feet."""

    code: Literal["heights_in_feet"] = "heights_in_feet"
    crs: str
    unit_m: float
    converted: bool
    """True: as the plan is in feet; False: they lie above all cameras, and would not if they were in feet"""

    @property
    def sentence(self) -> str:
        if self.converted:
            return (
                f"{self.crs} is in feet, and the heights of the surveyed points were taken as feet, too ({self.unit_m:.7f} m). "
                "If they are metres, name a system with a vertical part in metres (control > crs), as "
                f"{with_vertical(self.crs, 5703)}."
            )
        return (
            "The surveyed points lie above all cameras as metres, and below them as feet: their heights seem to be in feet. "
            f"Convert them, or name a system with a vertical part in feet (control > crs), as {with_vertical(self.crs, 6360)}."
        )

    @property
    def grave(self) -> bool:
        return not self.converted


class DatumApart(_OfControl):
    """Surveyed points lie beside where their photographs were taken, by what another datum explains."""

    code: Literal["datum_apart"] = "datum_apart"
    crs: str
    fits: str
    """the reference system in which they would lie amid their photographs"""
    distance_m: float

    @property
    def sentence(self) -> str:
        return (
            f"The surveyed points, read as {self.crs}, lie {self.distance_m:.0f} m beside the photographs that show them; in "
            f"{self.fits} they would lie amid them. If that is what they were surveyed in, state it (control > crs)."
        )


class HeightsOfTwoSystems(_OfControl):
    """Heights of control and of positions refer to different surfaces."""

    code: Literal["heights_of_two_systems"] = "heights_of_two_systems"
    control: str
    positions: str
    shift_m: float | None
    """by how much the heights of control were raised to those of the positions; None: PROJ lacks the grid, nothing was done"""
    crs: str
    """the crs with which the project would have the heights of the control"""

    @property
    def sentence(self) -> str:
        if self.shift_m is None:
            return (
                f"Heights of control are {self.control}, those of the positions are above {self.positions}: they differ by tens "
                f"of metres and could not be brought together. State crs: {self.crs} and install the grid that PROJ asks for, or "
                "give both in one system."
            )
        return (
            f"Heights of control ({self.control}) were raised by {self.shift_m:.2f} m to those of the positions, above "
            f"{self.positions}, which are the heights of all products. For heights of the control state crs: {self.crs}."
        )

    @property
    def grave(self) -> bool:
        return self.shift_m is None


class CoordinatesRounded(_OfControl):
    """Coordinates of surveyed points are written more coarsely than their standard errors, which were enlarged."""

    code: Literal["coordinates_rounded"] = "coordinates_rounded"
    points: int
    plan_m: float | None
    height_m: float | None
    """the step to which they are written (m); None: finely enough"""

    @property
    def sentence(self) -> str:
        steps = ((self.plan_m, "coordinates"), (self.height_m, "heights"))
        said = " and ".join(f"{what} to {two_digits(step)} m" for step, what in steps if step)
        return (
            f"The {self.points} surveyed points are rounded, {said}: their standard errors were enlarged by what that takes away. "
            "Give them as they were measured; spreadsheets show fewer digits than they hold."
        )

    @property
    def grave(self) -> bool:
        return False


class ControlRead(BaseModel):
    """The files of the control as they were read; not a finding, but what one wants to know."""

    model_config = ConfigDict(frozen=True)

    format: str
    points: int
    measurements: int
    crs: str
    checks: int = 0
    """check points among the points"""
    skipped: int = 0
    """lines without coordinates or without a measurement"""
    corner: bool = False
    """pixels were counted from the corner of the upper-left one, half a pixel more than from its centre"""
    encoding: str = "UTF-8"
    steps: tuple[float, float] = (0.0, 0.0)
    """to which coordinates in plan and heights are written, in their unit (0: finely)"""

    @property
    def sentence(self) -> str:
        """Which format the control has, how much of it there is, and what was assumed."""
        points = f"{self.points} points{f' ({self.checks} of them check points)' * bool(self.checks)}"
        said = [f"Control: {self.format}, {points}, {self.measurements} measurements, in {self.crs[:60]}."]
        if self.skipped:
            said.append(f"{self.skipped} points without coordinates were skipped.")
        if self.corner:
            said.append("Its pixels count from the corner of the upper-left one: half a pixel was taken off.")
        if self.encoding == "Windows-1252":
            said.append("It is not in UTF-8 and was read as Windows-1252; check names with letters beyond A to Z.")
        return " ".join(said)


ControlFinding = Annotated[
    HeightsNotTransformed
    | ControlElsewhere
    | HeightsAllZero
    | PhotographsAbsent
    | ChecksUnmarked
    | TargetsNotFound
    | TargetsTwice
    | MeasurementsOfOriginals
    | MeasurementsReduced
    | ControlExchanged
    | ControlInDegrees
    | HeightsUnknown
    | HeightsInFeet
    | DatumApart
    | HeightsOfTwoSystems
    | CoordinatesRounded,
    Field(discriminator="code"),
]
