"""Which surface is projected."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from orthomill.schemas.project_paths import ProjectPath
from orthomill.schemas.settings import Settings, setting

Unit = Literal["auto", "m", "cm", "mm", "ft"]


class MeshSurface(Settings):
    """A triangle mesh or a point cloud of any program or scanner, in the system in which the photographs are oriented."""

    kind: Literal["mesh"]
    path: ProjectPath = setting(
        ..., "PLY, STL, OBJ, GLB, OFF or text; a point cloud (LAZ, PLY, XYZ) is triangulated in its best plane."
    )
    unit: Unit = setting(
        "auto", "Unit of its coordinates. auto: metres, and refused where the photographs show that it is another one."
    )
    crs: str = setting("", "Reference system of its coordinates, as EPSG:2100; empty: that of the project.")
    up: Literal["auto", "z", "y"] = setting(
        "auto", "Which of its axes points upwards. auto: y in a GLB, as glTF says, otherwise z."
    )
    shift: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), "Added to its coordinates, where the file holds them relative to an origin.", "m"
    )
    faces: Literal["auto", "outwards", "inwards"] = setting(
        "auto",
        "Which way its triangles face. auto: the way in which the photographs see more of their fronts; backs are never coloured.",
    )

    @property
    def y_up(self) -> bool:
        """Whether Y points upwards in the file."""
        return self.up == "y" or (self.up == "auto" and self.path.lower().endswith(".glb"))


class SimulatedMesh(Settings):
    """The scanned mesh of a simulated scene (`simulation: scene: {kind: portal}`)."""

    kind: Literal["simulated"]

    @property
    def unit(self) -> Unit:
        """Of its coordinates."""
        return "m"

    @property
    def shift(self) -> tuple[float, float, float]:
        """Added to its coordinates, m."""
        return 0.0, 0.0, 0.0

    @property
    def faces(self) -> Literal["auto"]:
        """Which way its triangles face."""
        return "auto"

    crs: ClassVar[str] = ""
    y_up: ClassVar[bool] = False


class HeightModelSurface(Settings):
    """The surface model of this project (`densification`, after its check if there is one), as triangles between its cells."""

    kind: Literal["height_model"]
    every: int = setting(1, "Every so manieth cell in both directions becomes a corner of triangles.", ge=1, le=64)

    unit: ClassVar[Unit] = "m"
    faces: ClassVar[Literal["outwards"]] = "outwards"


SolidSurface = Annotated[MeshSurface | SimulatedMesh | HeightModelSurface, Field(discriminator="kind")]
