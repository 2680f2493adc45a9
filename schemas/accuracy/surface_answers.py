"""What is measured on a surface: features that a user gives, and the answers with their standard errors."""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window

FeatureKind = Literal["point", "line", "polygon"]


@dataclass(frozen=True)
class DrawnFeature:
    """A point, a line or a polygon (outer ring and holes; the last corner is not the first one again) on the map."""

    name: str
    kind: FeatureKind
    places: np.ndarray
    """(N, 2) X, Y m in the project's system"""
    holes: tuple[np.ndarray, ...] = ()
    """rings (N, 2) of what lies inside of a polygon and is not part of it"""


@dataclass(frozen=True)
class SurfaceCut:
    """A window of a surface: heights, standard errors among neighbours and of the datum (rows, cols) m, measured: bool."""

    height: np.ndarray
    relative: np.ndarray
    datum: np.ndarray
    measured: np.ndarray


class MeasuredSource(Protocol):
    """Where windows of a surface come from."""

    @property
    def grid(self) -> MapGrid:
        """Of the surface."""
        ...

    @property
    def block(self) -> Block | None:
        """Whose photographs made it; None where that is not known."""
        ...

    def read(self, window: Window) -> SurfaceCut:
        """A window inside the grid."""
        ...


class BaseSource(Protocol):
    """What volumes are measured against: another surface on the same cells."""

    @property
    def words(self) -> str:
        """What it is, for the table."""
        ...

    def read(self, window: Window) -> SurfaceCut:
        """A window of the measured surface's grid; standard errors are NaN where it has none."""
        ...


@dataclass(frozen=True)
class MeasureRules:
    """level: m, a level base for volumes, None: another one; base: another surface as base, None with level None: the plane through
    the border; corner: standard error of a coordinate of a corner, m; step: of profiles, m."""

    level: float | None = None
    base: BaseSource | None = None
    corner: float = 0.0
    step: float = 1.0


@dataclass(frozen=True)
class SurfaceAnswer:
    """One answer: its value, unit and standard error with the shares of it; a note where it must be known."""

    feature: str
    quantity: str
    value: float
    sigma: float
    unit: str
    measured_share: float = float("nan")
    """standard errors by cause, in the same unit: correlated errors of matching, ..."""
    estimated_share: float = float("nan")
    """... heights that no photograph measured, ..."""
    datum_share: float = float("nan")
    """... the place of the block, ..."""
    plan_share: float = float("nan")
    """... the corners"""
    note: str = ""


@dataclass(frozen=True)
class ProfilePoint:
    """A height along a line, with its standard error, m; measured by photographs or estimated."""

    feature: str
    along: float
    x: float
    y: float
    height: float
    sigma: float
    measured: bool


@dataclass(frozen=True)
class MeasuredAnswers:
    """All answers, profiles of all lines, and how the correlation of neighbouring errors is known."""

    answers: tuple[SurfaceAnswer, ...]
    profiles: tuple[ProfilePoint, ...]
    correlation: str
