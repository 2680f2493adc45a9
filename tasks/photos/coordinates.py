"""How image coordinates follow from the pixels of a file: the settings of digital cameras and of scanned film."""

from typing import Annotated, Literal

from pydantic import Field

from orthomill.schemas.project_paths import ProjectPath
from orthomill.schemas.settings import Settings, setting

# The two kinds of scans share this setting, and the reference prints one sentence for both.
PICTURE = (
    "Width and height of the exposed picture about the centre of the marks; scans are cut to it, so that the margin of the film "
    "is not used. Without it, scans reach to the outermost marks or are used whole."
)


class Digital(Settings):
    """A digital camera: the pixels of the file are those of the sensor."""

    kind: Literal["digital"]

    @property
    def files(self) -> tuple[str, ...]:
        """Files that a job has to read: none."""
        return ()


class FiducialMarks(Settings):
    """Scans with fiducial marks: an affine transformation to the calibrated coordinates of the marks."""

    kind: Literal["fiducial_marks"]
    marks_path: ProjectPath = setting(
        ..., "CSV with the columns mark, x, y: calibrated image coordinates of the marks in mm, y up."
    )
    measured_path: ProjectPath = setting(
        ..., "CSV with the columns photo, mark, col, row: the marks as measured in the scans, in pixels."
    )
    pixel_um: float = setting(
        ...,
        "Side of a pixel of the frame that scans are resampled to, about that of the scan; c in pixels refers to it.",
        "micrometres",
        gt=0,
    )
    picture_mm: tuple[float, float] | None = setting(None, PICTURE, "mm")

    @property
    def files(self) -> tuple[str, ...]:
        return self.marks_path, self.measured_path


class PrincipalPixel(Settings):
    """Scans of which only the principal pixel is known: treated as digital photographs, shifted."""

    kind: Literal["principal_pixel"]
    measured_path: ProjectPath = setting(
        ..., "CSV with the columns photo, col, row: where the lines between opposite marks intersect, in pixels."
    )
    pixel_um: float | None = setting(None, "Side of a pixel of the scan; needed with picture_mm.", "micrometres", gt=0)
    picture_mm: tuple[float, float] | None = setting(None, PICTURE, "mm")

    @property
    def files(self) -> tuple[str, ...]:
        return (self.measured_path,)


ImageCoordinates = Annotated[Digital | FiducialMarks | PrincipalPixel, Field(discriminator="kind")]
