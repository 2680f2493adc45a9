"""What the surface is projected onto, as a workflow says it; `projection_frames.py` makes frames of it."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.projection.lines.sections import NoSection, Point, Section

Pixel = Annotated[float, Field(gt=0)] | Literal["auto"]
_NAME = "Name of its files and of its chapter in the report."
_PIXEL = "Side of a pixel. auto: that of the photographs on the surface, as a round number."
_SECTION = "What is cut away before the surface is shown; photographs still see all of it."
_NAMED = r"^[a-z][a-z0-9_]*$"


class ThreePoints(Settings):
    """Through three points, seen from the side from which they run counter-clockwise."""

    kind: Literal["points"]
    points: tuple[Point, Point, Point] = setting(..., "X, Y, Z of the points.", "m")


class PointAndNormal(Settings):
    """Through a point, across a direction."""

    kind: Literal["normal"]
    point: Point = setting(..., "A point of the plane.", "m")
    normal: Point = setting(..., "Towards the viewer; of any length.")

    @model_validator(mode="after")
    def _has_a_direction(self) -> "PointAndNormal":
        if not any(self.normal):
            raise ValueError("the normal of a plane is (0, 0, 0); give the direction towards the viewer")
        return self


class ParallelToEdge(Settings):
    """Upright and parallel to an edge, seen with its first point on the left."""

    kind: Literal["edge"]
    left: Point = setting(..., "The left end of the edge.", "m")
    right: Point = setting(..., "The right end of the edge.", "m")


class BestFit(Settings):
    """The plane that fits the surface best, seen from the photographs; what the photographs do not show has no part in it."""

    kind: Literal["fit"]
    low: Point | None = setting(None, "Lowest X, Y, Z of the part that the plane is fitted to.", "m")
    high: Point | None = setting(None, "Highest X, Y, Z of the part that the plane is fitted to.", "m")


class FacadePlane(Settings):
    """Upright, in the direction in which most of the surface faces, to the nearest degree; seen from the photographs."""

    kind: Literal["facade"] = "facade"


PlaneChoice = Annotated[ThreePoints | PointAndNormal | ParallelToEdge | BestFit | FacadePlane, Field(discriminator="kind")]


class MapOutput(Settings):
    """A true orthoimage on the map, from above."""

    kind: Literal["map"] = "map"
    name: str = setting("map", _NAME, pattern=_NAMED)
    pixel: Pixel = setting("auto", _PIXEL, "m")
    section: Section = setting(NoSection(), _SECTION)


class PlaneOutput(Settings):
    """A true orthoimage on a plane in space: a facade, a wall, a floor."""

    kind: Literal["plane"]
    name: str = setting("front", _NAME, pattern=_NAMED)
    plane: PlaneChoice = setting(FacadePlane(), "Where the plane lies and from which side it is seen.")
    pixel: Pixel = setting("auto", _PIXEL, "m")
    size: tuple[float, float] | None = setting(
        None, "Width and height about the point of the plane (the middle of the edge or of the three points). None: all seen.", "m"
    )
    section: Section = setting(NoSection(), _SECTION)


class CylinderOutput(Settings):
    """An unrolled cylinder: a column from outside, an apse or a shaft from its axis."""

    kind: Literal["cylinder"]
    name: str = setting("unrolled", _NAME, pattern=_NAMED)
    foot: Point = setting(..., "The lower end of the axis.", "m")
    head: Point = setting(..., "The upper end of the axis.", "m")
    radius: float = setting(..., "At which the width of a pixel is true.", "m", gt=0)
    reach: float = setting(0.5, "Surface farther from the radius than this part of it is not shown.", gt=0, lt=1)
    seen_from: Literal["outside", "axis"] = setting("outside", "Whether it is a column or a hollow.")
    pixel: Pixel = setting("auto", _PIXEL, "m")
    section: Section = setting(NoSection(), _SECTION)


class PerspectiveOutput(Settings):
    """The picture of a camera that was never there."""

    kind: Literal["perspective"]
    name: str = setting("view", _NAME, pattern=_NAMED)
    position: Point = setting(..., "The projection centre.", "m")
    target: Point = setting(..., "What is in the middle of the picture.", "m")
    width: int = setting(1600, "Width of the picture.", "px", ge=16, le=60000)
    height: int = setting(1200, "Height of the picture.", "px", ge=16, le=60000)
    c: float = setting(1600.0, "Camera constant.", "px", gt=0)
    k1: float = setting(0.0, "Radial distortion that the picture is to have, second order, as in OpenCV.")
    k2: float = setting(0.0, "Radial distortion that the picture is to have, fourth order.")
    section: Section = setting(NoSection(), _SECTION)


class PhotographOutput(Settings):
    """What one of the photographs shows, from the photographs."""

    kind: Literal["photograph"]
    name: str = setting("photograph", _NAME, pattern=_NAMED)
    photo: str = setting(..., "Name of the photograph.")
    itself: bool = setting(False, "Whether the photograph takes part in its own picture.")
    distortion: Literal["kept", "removed"] = setting("kept", "Whether the picture has the distortion of its lens.")
    section: Section = setting(NoSection(), _SECTION)


Output = Annotated[MapOutput | PlaneOutput | CylinderOutput | PerspectiveOutput | PhotographOutput, Field(discriminator="kind")]
AnyOutput = MapOutput | PlaneOutput | CylinderOutput | PerspectiveOutput | PhotographOutput
