"""How the interior orientation takes part in an adjustment, and what of it varies from photograph to photograph: the settings."""

from typing import Annotated, Literal, get_args

from pydantic import Field

from orthomill.schemas.camera import InteriorParameter
from orthomill.schemas.settings import Settings, setting


class FixedInterior(Settings):
    """The interior orientation keeps its values."""

    kind: Literal["fixed"]


class WeightedInterior(Settings):
    """The named parameters are unknowns, weighted by the covariance of the calibration (or by wide nominal standard errors for a
    camera from EXIF)."""

    kind: Literal["weighted"]
    parameters: tuple[InteriorParameter, ...] = setting(
        get_args(InteriorParameter), "Interior parameters to be adjusted, of those that the calibration knows.", min_length=1
    )


class FreeInterior(Settings):
    """The named parameters are unknowns without prior weight (self-calibration)."""

    kind: Literal["free"]
    parameters: tuple[InteriorParameter, ...] = setting(
        ("c", "x0", "y0", "k1", "k2"), "Interior parameters to be adjusted.", min_length=1
    )


InteriorChoice = Annotated[FixedInterior | WeightedInterior | FreeInterior, Field(discriminator="kind")]


class NoVariation(Settings):
    """All photographs of a camera share its interior orientation."""

    kind: Literal["none"]


class Zoomed(Settings):
    """The camera constant of every photograph differs from that of its camera: a zoom lens without tags, refocusing."""

    kind: Literal["zoom"]
    sigma: float = setting(0.01, "Standard error of the difference, in units of the camera constant.", gt=0, le=0.5)


class Stabilised(Settings):
    """The principal point of every photograph differs from that of its camera: a lens or sensor that is moved against shaking."""

    kind: Literal["stabilised"]
    sigma: float = setting(10.0, "Standard error of the difference.", "px", gt=0)


class RollingShutter(Settings):
    """The rows of a photograph are read one after another, from the top of the sensor, while the platform moves and turns."""

    kind: Literal["rolling_shutter"]
    readout: float = setting(0.03, "Time from the first row to the last.", "s", gt=0, le=1)
    speed_sigma: float = setting(
        5.0, "Standard error of the speed along each axis, where positions and times do not tell it.", "m/s", gt=0
    )
    turning_sigma: float = setting(1.0, "Standard error of the rate at which photographs turn.", "degrees/s", gt=0)


VariationChoice = Annotated[NoVariation | Zoomed | Stabilised | RollingShutter, Field(discriminator="kind")]
