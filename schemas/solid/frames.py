"""What a surface is projected onto: a plane in space (a map is one), an unrolled cylinder, or the picture of a camera.

A frame gives every pixel a ray from the viewer, and so the point of the surface that it shows. Pixels are (col, row), the centre of
the upper left one is (0, 0). Coordinates are those of the project, m.
"""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from orthomill.schemas.camera import Camera
from orthomill.schemas.raster import MapGrid

Vector = tuple[float, float, float]


class _FrameShape(BaseModel):
    model_config = ConfigDict(frozen=True)

    name: str
    rows: int
    cols: int
    without: tuple[str, ...] = ()
    """photographs that must not take part"""

    @property
    def shape(self) -> tuple[int, int]:
        return self.rows, self.cols


class FlatFrame(_FrameShape):
    """Parallel projection onto a plane. `corner` is the outer corner of the upper left pixel; `right`, `up` and `normal` (towards
    the viewer) are unit vectors."""

    kind: Literal["plane"] = "plane"
    corner: Vector
    right: Vector
    up: Vector
    normal: Vector
    pixel: float
    """m"""
    level: bool = False
    """The plane is that of the map: X to the right, Y up."""
    oblique: Vector | None = None
    """unit vector towards the viewer where this is not the normal"""

    @property
    def towards(self) -> Vector:
        """Unit vector towards the viewer."""
        return self.oblique or self.normal

    @property
    def grid(self) -> MapGrid:
        """The map grid, or that of the plane with its lower left corner at (0, 0)."""
        west, north = self.corner[:2] if self.level else (0.0, self.rows * self.pixel)
        return MapGrid(west=west, north=north, cell=self.pixel, rows=self.rows, cols=self.cols)

    @property
    def tags(self) -> dict[str, str]:
        """The plane, for files: a place (x, y) of the picture is origin + x right + y up, in the project's system, m."""
        low = self.rows * self.pixel
        origin = (c - low * u for c, u in zip(self.corner, self.up, strict=True))
        named = {"ORIGIN": tuple(origin), "RIGHT": self.right, "UP": self.up, "NORMAL": self.normal}
        vectors = {f"PLANE_{name}": " ".join(f"{v:.12g}" for v in values) for name, values in named.items()}
        oblique = {"PLANE_TOWARDS": " ".join(f"{v:.12g}" for v in self.oblique)} if self.oblique else {}
        return {**vectors, **oblique, "PIXEL_M": f"{self.pixel:.9g}", "PAPER_SCALE_AT_0.1_MM": f"1:{self.pixel / 0.0001:.6g}"}


class CylinderFrame(_FrameShape):
    """A cylinder, unrolled: columns follow its circumference, rows its axis."""

    kind: Literal["cylinder"] = "cylinder"
    foot: Vector
    """a point of the axis"""
    axis: Vector
    """unit vector, upwards"""
    middle: Vector
    """unit vector, perpendicular to the axis, to the middle column"""
    radius: float
    """m, at which a pixel is `pixel` wide"""
    reach: float
    """m from the radius up to which the surface is shown"""
    top: float
    """m along the axis from `foot` to the upper edge"""
    outside: bool
    """seen from outside (a column) or from the axis (an apse)"""
    pixel: float


class ViewFrame(_FrameShape):
    """The picture of a camera, whose size is that of the frame."""

    kind: Literal["view"] = "view"
    camera: Camera
    omega_phi_kappa: Vector
    """degrees"""
    centre: Vector


OutputFrame = Annotated[FlatFrame | CylinderFrame | ViewFrame, Field(discriminator="kind")]
AnyFrame = FlatFrame | CylinderFrame | ViewFrame


class OutputFrames(BaseModel):
    """All frames of a run, in the order of the workflow."""

    model_config = ConfigDict(frozen=True)

    frames: tuple[OutputFrame, ...]
    pixel: float
    """median side of a pixel of the photographs on the surface, m"""
