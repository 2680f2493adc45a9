"""How image coordinates follow from the pixels of a file: what a workflow may say of it."""

from typing import Annotated, Literal

from pydantic import Field

from orthomill.schemas.settings import Settings, setting

PICTURE = (
    "Width and height of the exposed picture about the centre of the marks: scans are cut to it, so that the margin of the film "
    "takes no part. Without it they reach to the outermost marks, or whole."
)


class Digital(Settings):
    """A digital camera: pixels are what the sensor measured."""

    kind: Literal["digital"]

    @property
    def files(self) -> tuple[str, ...]:
        return ()


class FiducialMarks(Settings):
    """Scans with fiducial marks: an affine transformation to their calibrated coordinates."""

    kind: Literal["fiducial_marks"]
    marks_path: str = setting(..., "CSV with the columns mark, x, y: calibrated image coordinates of the marks in mm, y up.")
    measured_path: str = setting(..., "CSV with the columns photo, mark, col, row: where the marks stand in the scans, in pixels.")
    pixel_um: float = setting(
        ...,
        "Side of a pixel of the frame that scans are put into, about that of the scan; c in pixels counts these.",
        "micrometres",
        gt=0,
    )
    picture_mm: tuple[float, float] | None = setting(None, PICTURE, "mm")

    @property
    def files(self) -> tuple[str, ...]:
        return self.marks_path, self.measured_path


class PrincipalPixel(Settings):
    """Scans of which only the principal pixel is known: treated as digital, shifted."""

    kind: Literal["principal_pixel"]
    measured_path: str = setting(..., "CSV with the columns photo, col, row: where lines between opposite marks cross, in pixels.")
    pixel_um: float | None = setting(None, "Side of a pixel of the scan; needed with picture_mm.", "micrometres", gt=0)
    picture_mm: tuple[float, float] | None = setting(None, PICTURE, "mm")

    @property
    def files(self) -> tuple[str, ...]:
        return (self.measured_path,)


ImageCoordinates = Annotated[Digital | FiducialMarks | PrincipalPixel, Field(discriminator="kind")]
