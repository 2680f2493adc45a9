"""Findings from reading the control of a project that a reader must know: codes with names and numbers."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field


# Geoid undulations reach tens of metres: heights that silently changed or kept their datum would shift the block by as much.
class HeightsNotTransformed(BaseModel):
    """Heights kept their values, because only one of the two reference systems has a vertical datum."""

    model_config = ConfigDict(frozen=True)

    code: Literal["heights_not_transformed"] = "heights_not_transformed"
    crs: str
    """the system with a vertical datum"""


class ControlElsewhere(BaseModel):
    """Surveyed points lie far from the positions of the photographs and are not used."""

    model_config = ConfigDict(frozen=True)

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


# Lists made from a map have plan coordinates only, and 0 where the format asks for a height.
class HeightsAllZero(BaseModel):
    """All surveyed points have the height 0."""

    model_config = ConfigDict(frozen=True)

    code: Literal["heights_all_zero"] = "heights_all_zero"
    points: int
    freed: bool = False
    """whether they were taken as unknown, because positions give the block its heights"""


# Users drop photographs and keep the control file; what that costs must be known before the block is believed.
class PhotographsAbsent(BaseModel):
    """Measurements in photographs that the project does not have were skipped."""

    model_config = ConfigDict(frozen=True)

    code: Literal["photographs_absent"] = "photographs_absent"
    measurements: int
    """how many were skipped"""
    photos: tuple[str, ...]
    """the absent photographs, as the file names them"""
    lost: tuple[str, ...] = ()
    """control and check points that are measured in absent photographs only, and were left out"""


# People reduce photographs and keep the list that was measured in the originals.
class MeasurementsOfOriginals(BaseModel):
    """Control measurements were read as pixels of the photographs before these were reduced."""

    model_config = ConfigDict(frozen=True)

    code: Literal["measurements_of_originals"] = "measurements_of_originals"
    measurements: int
    outside: int
    """how many of them lie outside of the photographs as they are"""
    original: tuple[int, int]
    reduced: tuple[int, int]
    """width and height of one of the photographs before and after, px"""


# Tags are lost when photographs are reduced, and nothing else tells by how much.
class MeasurementsReduced(BaseModel):
    """Control measurements were divided by one factor, because only so do all of them lie inside of the photographs."""

    model_config = ConfigDict(frozen=True)

    code: Literal["measurements_reduced"] = "measurements_reduced"
    measurements: int
    outside: int
    """how many of them lie outside of the photographs as they are"""
    factor: float


# EPSG defines northing or latitude first for many systems, and so do the files of some programs.
class ControlExchanged(BaseModel):
    """The first two coordinates of surveyed points were exchanged, because only so are they where the photographs were taken."""

    model_config = ConfigDict(frozen=True)

    code: Literal["control_exchanged"] = "control_exchanged"
    points: int
    crs: str


class ControlInDegrees(BaseModel):
    """Surveyed points were read as longitude and latitude, which nothing but their numbers tells."""

    model_config = ConfigDict(frozen=True)

    code: Literal["control_in_degrees"] = "control_in_degrees"
    points: int


class HeightsUnknown(BaseModel):
    """Surveyed points without heights: used in plan only."""

    model_config = ConfigDict(frozen=True)

    code: Literal["heights_unknown"] = "heights_unknown"
    points: tuple[str, ...]
    zero: bool = False
    """whether their height is 0, where others have real ones, or all of them have it"""
    left_out: tuple[str, ...] = ()
    """check points, which check nothing without a height"""


class HeightsInFeet(BaseModel):
    """Heights of surveyed points that are, or may be, in feet."""

    model_config = ConfigDict(frozen=True)

    code: Literal["heights_in_feet"] = "heights_in_feet"
    crs: str
    unit_m: float
    converted: bool
    """True: as the plan is in feet; False: they lie above all cameras, and would not if they were in feet"""


class DatumApart(BaseModel):
    """Surveyed points lie beside where their photographs were taken, by what another datum explains."""

    model_config = ConfigDict(frozen=True)

    code: Literal["datum_apart"] = "datum_apart"
    crs: str
    fits: str
    """the reference system in which they would lie amid their photographs"""
    distance_m: float


class HeightsOfTwoSystems(BaseModel):
    """Heights of control and of positions refer to different surfaces."""

    model_config = ConfigDict(frozen=True)

    code: Literal["heights_of_two_systems"] = "heights_of_two_systems"
    control: str
    positions: str
    shift_m: float | None
    """by how much the heights of control were raised to those of the positions; None: PROJ lacks the grid, nothing was done"""
    crs: str
    """the crs with which the project would have the heights of the control"""


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


class CoordinatesRounded(BaseModel):
    """Coordinates of surveyed points are written more coarsely than their standard errors, which were enlarged."""

    model_config = ConfigDict(frozen=True)

    code: Literal["coordinates_rounded"] = "coordinates_rounded"
    points: int
    plan_m: float | None
    height_m: float | None
    """the step to which they are written (m); None: finely enough"""


ControlFinding = Annotated[
    HeightsNotTransformed
    | ControlElsewhere
    | HeightsAllZero
    | PhotographsAbsent
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
