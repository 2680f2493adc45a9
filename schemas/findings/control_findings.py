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


ControlFinding = Annotated[
    HeightsNotTransformed | ControlElsewhere | HeightsAllZero | PhotographsAbsent | MeasurementsOfOriginals,
    Field(discriminator="code"),
]
