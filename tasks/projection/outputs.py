"""What the surface is projected onto, as a workflow says it; `projection_frames.py` makes frames of it."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from orthomill.schemas.project import StatedLens
from orthomill.schemas.settings import Settings, refuse_ignored, setting
from orthomill.tasks.projection.lines.sections import NoSection, Point, Section

Pixel = Annotated[float, Field(gt=0)] | Literal["auto"]
_NAME = "Name of its files and of its chapter in the report."
_PIXEL = "Side of a pixel. auto: that of the photographs on the surface, as a round number."
_SECTION = "What is cut away before the surface is shown; photographs still see all of it."
_ONLY = "Name of the one photograph that it shows, with holes where that sees nothing; for comparison. None: all, blended."
_NAMED = r"^[a-z][a-z0-9_]*$"


def is_rotation(rows: tuple[Point, Point, Point]) -> bool:
    """Whether three rows are perpendicular unit vectors, right-handed, to six digits."""
    dots = [sum(a * b for a, b in zip(one, other, strict=True)) for one in rows for other in rows]
    (a, b, c), (d, e, f), (g, h, i) = rows
    turned = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return all(abs(dot - (n in (0, 4, 8))) < 1e-6 for n, dot in enumerate(dots)) and turned > 0


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
    only: str | None = setting(None, _ONLY)
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
    towards: Point | None = setting(
        None, "Direction towards the viewer of an oblique parallel projection, of any length. None: across the plane."
    )
    only: str | None = setting(None, _ONLY)
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


class PerspectiveOutput(StatedLens):
    """The picture of a camera that was never there."""

    kind: Literal["perspective"]
    name: str = setting("view", _NAME, pattern=_NAMED)
    position: Point = setting(..., "The projection centre.", "m")
    target: Point | None = setting(None, "What is in the middle of the picture; or angles or rotation say where it looks.", "m")
    roll: float = setting(
        0.0, "By how much the camera is turned clockwise about its axis from upright, with a target.", "degrees", ge=-180, le=180
    )
    omega_phi_kappa: Point | None = setting(None, "Rotation by angles, instead of a target.", "degrees")
    rotation: tuple[Point, Point, Point] | None = setting(
        None, "Rows of the rotation matrix from world to image (x right, y up, looking along -z), instead of a target."
    )
    width: int = setting(1600, "Width of the picture.", "px", ge=16, le=60000)
    height: int = setting(1200, "Height of the picture.", "px", ge=16, le=60000)
    c: float = setting(1600.0, "Camera constant.", "px", gt=0)
    x0: float = setting(0.0, "Principal point, right of the middle of the picture.", "px")
    y0: float = setting(0.0, "Principal point, above the middle of the picture.", "px")
    section: Section = setting(NoSection(), _SECTION)

    @model_validator(mode="after")
    def _looks_somewhere(self) -> "PerspectiveOutput":
        ways = [name for name in ("target", "omega_phi_kappa", "rotation") if getattr(self, name) is not None]
        if len(ways) != 1:
            found = " and ".join(ways) if ways else "none of them"
            raise ValueError(f"a view needs either a target, or omega_phi_kappa, or a rotation; there is {found}")
        if self.target is None:
            refuse_ignored(self, ("roll",), ways[0], "remove the line, or give a target")
        if self.rotation is not None and not is_rotation(self.rotation):
            raise ValueError("the rotation is no rotation matrix: its rows must be perpendicular unit vectors, right-handed")
        return self


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
