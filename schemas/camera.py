"""The interior orientation of a camera, and its precision.

Photogrammetric convention: origin at the principal point, x right, y up, in pixels; the camera looks along -z. `x0`, `y0` are the
principal point relative to the image centre ((width - 1) / 2, (height - 1) / 2), y up. Distortion is Brown's model with OpenCV's
coefficients: the radius is in units of c, and the distortion is added to the ideal point to give the observed one.
"""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from orthomill.schemas.job import Table

# Rows of stored covariances carry no names: another order would silently exchange them in existing projects.
INTERIOR = ("c", "x0", "y0", "k1", "k2", "k3", "p1", "p2")
"""Order of the interior parameters in every covariance and every kernel."""


class Camera(BaseModel):
    """One camera: image size, interior orientation and its precision."""

    # Closed, because camera files are also written by hand: a misspelt k1 must not pass as a lens without distortion.
    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    width: int = Field(gt=0, description="px")
    height: int = Field(gt=0, description="px")
    # In pixels, because EXIF states the size of the sensor only roughly or not at all, and the adjustment does not need it.
    c: float = Field(gt=0, description="camera constant, px")
    x0: float = 0.0
    y0: float = 0.0
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    # Not in INTERIOR: digital sensors have square pixels, and all stages after the calibration project with eight parameters.
    affinity: float = 0.0
    """x is scaled by 1 + affinity relative to y. Only a calibration estimates it; the other stages refuse cameras that have it."""
    skew: float = 0.0
    """x grows by skew * y for axes that are not perpendicular; like `affinity`."""
    pixel_um: float | None = None
    """Side of a pixel on the sensor or scan in micrometres, where it is known."""
    source: Literal["file", "exif", "chessboards", "given", "block", "truth"] = "given"
    sigma0: float | None = None
    # The whole matrix: x0 and p2, y0 and p1, c and k1 compensate each other, so that propagating their standard errors alone would
    # misstate the errors of image rays.
    covariance: tuple[tuple[float, ...], ...] | None = None
    """8 x 8 in the order of INTERIOR; zero rows for parameters that were fixed. None: not known."""

    # As a tuple in one fixed order: covariances and kernels address parameters by index.
    @property
    def interior(self) -> tuple[float, ...]:
        """The interior parameters in the order of INTERIOR."""
        return tuple(getattr(self, name) for name in INTERIOR)


class Cameras(BaseModel):
    """All cameras of a project, and the camera of each photograph."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    # By name: photographs with the same camera share one set of unknowns in the adjustment, which equal copies would not express.
    cameras: dict[str, Camera]
    of_photo: dict[str, str]

    def of(self, photo: str) -> Camera:
        """The camera of a photograph."""
        return self.cameras[self.of_photo[photo]]

    def with_k1(self, k1: dict[str, float]) -> "Cameras":
        """A copy with new values of `k1`, given by camera name."""
        # The covariance remains as it is: an approximate k1 only starts the adjustment, it is not an estimate.
        changed = {name: self.cameras[name].model_copy(update={"k1": value}) for name, value in k1.items()}
        return self.model_copy(update={"cameras": {**self.cameras, **changed}})


CAMERAS = Table("calibration/cameras.json", Cameras)
