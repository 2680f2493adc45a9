"""What reading the control of a project found out that a reader must know: codes with their names and numbers."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field


class HeightsNotTransformed(BaseModel):
    """Heights kept their values, because only one of the two reference systems has a vertical datum."""

    model_config = ConfigDict(frozen=True)

    code: Literal["heights_not_transformed"] = "heights_not_transformed"
    crs: str
    """the system that has one"""


class ControlElsewhere(BaseModel):
    """Surveyed points far from the positions of the photographs were set aside."""

    model_config = ConfigDict(frozen=True)

    code: Literal["control_elsewhere"] = "control_elsewhere"
    points: int
    crs: str
    """the reference system in which the points were read"""
    distance_m: float
    """median distance from the middle of the photographs"""
    fits: str | None = None
    """the reference system in which they would be at the photographs; None: none of the usual ones"""
    exchanged: bool = False
    """whether they would be there with their first two coordinates exchanged"""


ControlFinding = Annotated[HeightsNotTransformed | ControlElsewhere, Field(discriminator="code")]
