"""Measurements in photographs and on the ground."""

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.findings.control_findings import ControlFinding, ControlRead
from orthomill.schemas.job import Columns, Table

NO_HEIGHT = 300.0
"""m: standard error of a surveyed height that is unknown; its pull on the block stays below a hundredth of that of any receiver"""


@dataclass(frozen=True)
class TiePoints(Columns):
    """One row per image measurement of a tie point; sorted by track, then photo."""

    track: np.ndarray
    """int32: number of the tie point"""
    photo: np.ndarray
    """int32: number of the photograph in `Photos`"""
    col: np.ndarray
    row: np.ndarray
    """float64: pixel coordinates as observed (distorted), centre of the upper-left pixel is (0, 0)"""
    # Each measurement has its own: features of coarse pyramid levels are located less precisely than those of the full image.
    sigma: np.ndarray
    """float32: standard error of a coordinate, px"""


class TiePointCounts(BaseModel):
    """How much there is to adjust."""

    model_config = ConfigDict(frozen=True)

    points: int
    rays: int
    """image measurements of tie points"""


@dataclass(frozen=True)
class GroundPoints(Columns):
    """Tie points on the ground, from the block adjustment."""

    track: np.ndarray
    # float64: the steps of float32 are 0.5 m at a northing of 4 400 000 m. Standard errors need no more than float32.
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    """float64, m"""
    sigma_x: np.ndarray
    sigma_y: np.ndarray
    sigma_z: np.ndarray
    """float32, m"""
    rays: np.ndarray
    """int16: photographs that measured it"""
    residual: np.ndarray
    """float32: root mean square of its image residuals, px"""


class ControlPoint(BaseModel):
    """A point known on the ground, with its image measurements. A check point never takes part in the adjustment."""

    model_config = ConfigDict(frozen=True)

    name: str
    role: str
    """control, check, or tie: known by its measurements in photographs only (`xyz` and `sigma` are meaningless)"""
    xyz: tuple[float, float, float]
    sigma: tuple[float, float, float]
    """m"""
    # A standard error for each photograph, because a target seen obliquely is measured less precisely than one seen from above.
    measurements: dict[str, tuple[float, float, float]]
    """photo -> (col, row, sigma), px"""
    line: int | None = None
    """the first that gives its coordinates in the file; None: no line does"""


class Distance(BaseModel):
    """A distance measured between two points of `Control`, m."""

    model_config = ConfigDict(frozen=True)

    first: str
    second: str
    length: float
    sigma: float
    measured: float | None = None
    """m: on the ground, as the file states it; None where `length` is not put on a map"""

    @property
    def on_ground(self) -> "Distance":
        """As it was measured: what a file of distances holds."""
        return self if self.measured is None else self.model_copy(update={"length": self.measured, "measured": None})


class Control(BaseModel):
    """All ground control and check points of a project, and measured distances (empty when there are none)."""

    model_config = ConfigDict(frozen=True)

    points: tuple[ControlPoint, ...] = ()
    distances: tuple[Distance, ...] = ()
    findings: tuple[ControlFinding, ...] = ()
    """what could not be used, and about the reference system; the report puts them into words"""
    read: ControlRead | None = None
    """the files that it comes from; None without control, and for targets of scans"""


TIE_POINT_COUNTS = Table("tie_points/counts.json", TiePointCounts)
TIE_POINTS = Table("tie_points/tie_points.parquet", TiePoints)
GROUND_POINTS = Table("orientation/points.parquet", GroundPoints)
CONTROL = Table("orientation/control.json", Control)


@dataclass(frozen=True)
class ImageResiduals(Columns):
    """One row per image measurement of tie points and control in the block adjustment; sorted by track."""

    # One column serves both kinds: surveyed points have negative numbers, which tie points never have.
    track: np.ndarray
    """int32: number of the tie point; -1 - i for point i of `Control`"""
    photo: np.ndarray
    """int32: number of the photograph in `Photos`"""
    col: np.ndarray
    row: np.ndarray
    """float64: as observed, px"""
    # The sign of least squares, observation + residual = computed value; other programs often use the opposite one.
    v_col: np.ndarray
    v_row: np.ndarray
    """float32: computed minus observed, px"""
    # Not v / sigma: a residual is more precise than its observation, by the root of the redundancy number.
    standardised: np.ndarray
    """float32: the larger of the two residuals in units of its own standard error; NaN where the ray was rejected"""
    used: np.ndarray
    """bool"""


IMAGE_RESIDUALS = Table("orientation/image_residuals.parquet", ImageResiduals)


@dataclass(frozen=True)
class RegisteredPoints(Columns):
    """Targets of scans in the project's system, from their joint registration."""

    name: np.ndarray
    role: np.ndarray
    """str: control or check, where they were surveyed, else tie"""
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    """float64, m"""
    sigma_x: np.ndarray
    sigma_y: np.ndarray
    sigma_z: np.ndarray
    """float64, m: that of the registration included"""
    cov_xy: np.ndarray
    cov_xz: np.ndarray
    cov_yz: np.ndarray
    """float64, m^2"""
    scans: np.ndarray
    """int16: scans that measured it"""


REGISTERED_POINTS = Table("registration/points.parquet", RegisteredPoints)
