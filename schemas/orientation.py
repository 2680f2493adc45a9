"""The exterior orientation of photographs and the result of the block adjustment."""

from pydantic import BaseModel, ConfigDict

from schemas.camera import Camera
from schemas.job import Table


class ExteriorOrientation(BaseModel):
    """Where a photograph was taken and which way it looked. R = R3(kappa) R2(phi) R1(omega), world to image."""

    model_config = ConfigDict(frozen=True)

    photo: str
    centre: tuple[float, float, float]
    """X, Y, Z, m"""
    omega_phi_kappa: tuple[float, float, float]
    """degrees"""
    covariance: tuple[tuple[float, ...], ...] | None = None
    """6 x 6 of (X, Y, Z, omega, phi, kappa) in m and radians"""
    observations: int = 0
    residual_px: float | None = None
    """root mean square of its image residuals"""


class Unoriented(BaseModel):
    """A photograph that did not join the block, and why."""

    model_config = ConfigDict(frozen=True)

    photo: str
    reason: str


class Block(BaseModel):
    """Photographs oriented together in the project's CRS."""

    model_config = ConfigDict(frozen=True)

    crs: str
    cameras: dict[str, Camera]
    of_photo: dict[str, str]
    """photo -> camera"""
    photos: tuple[ExteriorOrientation, ...]
    unoriented: tuple[Unoriented, ...] = ()
    datum: str
    """control, gnss or free, as one sentence"""
    sigma0_px: float
    redundancy: int
    iterations: int
    ground_low: float
    ground_high: float
    """robust range of tie point heights, m"""

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(photo.photo for photo in self.photos)

    def of(self, name: str) -> ExteriorOrientation:
        return next(photo for photo in self.photos if photo.photo == name)

    def camera_of(self, name: str) -> Camera:
        return self.cameras[self.of_photo[name]]


BLOCK = Table("orientation/block.json", Block)
