"""Where the exterior orientation comes from, and what the adjustment is to do: settings without methods."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from orthomill.schemas.project_paths import ProjectPath
from orthomill.schemas.settings import Settings, setting

_PLACED = "project: its coordinates are those of the project; positions: it is fitted to the positions of its photographs."
_USE = "fixed: taken as it is and examined; start: starting values of the block adjustment, which needs the stage tie_points."
_GROUND = "Lowest and highest ground height; needed only where neither tie points nor points of the file determine it."


class Adjusted(Settings):
    """Found from the tie points, and adjusted with control and positions."""

    kind: Literal["adjusted"]


class _Foreign(Settings):
    """What is said of every file of another program."""

    kind: str
    placed: Literal["project", "positions"] = setting("project", _PLACED)
    use: Literal["fixed", "start"] = setting("fixed", _USE)
    ground: tuple[float, float] | None = setting(None, _GROUND, "m")

    @model_validator(mode="after")
    def _everything_is_read(self) -> Self:
        """Raises ValueError for settings that starting values have no use for: the adjustment finds the ground itself."""
        for name in ("ground", "points_path"):
            if self.use == "start" and getattr(self, name, None) is not None:
                raise ValueError(
                    f"{name} is set, but has no effect with `use: start`, where the adjustment determines the height of the "
                    f"ground; leave {name} out, or set `use: fixed`"
                )
        return self


class _ForeignFile(_Foreign):
    """A single file, which each kind describes."""

    path: str

    @property
    def files(self) -> tuple[str, ...]:
        return (self.path,)

    @property
    def described(self) -> str:
        return self.path


class FromAngles(_ForeignFile):
    """A table of X, Y, Z, omega, phi, kappa in metres and degrees; the cameras are those of the calibration."""

    kind: Literal["csv"]
    path: ProjectPath = setting(
        ..., "CSV with the columns photo, x, y, z, omega, phi, kappa (and sigma_x to sigma_kappa where known)."
    )


class FromColmap(_Foreign):
    """COLMAP's text model."""

    kind: Literal["colmap"]
    cameras_path: ProjectPath = setting(..., "COLMAP's cameras.txt.")
    images_path: ProjectPath = setting(..., "COLMAP's images.txt.")
    points_path: ProjectPath | None = setting(
        None, "COLMAP's points3D.txt: gives the height of the ground where there are no tie points."
    )
    placed: Literal["project", "positions"] = setting("positions", _PLACED)

    @property
    def files(self) -> tuple[str, ...]:
        return (self.cameras_path, self.images_path, *((self.points_path,) if self.points_path else ()))

    @property
    def described(self) -> str:
        return self.images_path


class FromOpensfm(_ForeignFile):
    """The reconstruction.json of OpenSfM, OpenDroneMap or WebODM."""

    kind: Literal["opensfm"]
    path: ProjectPath = setting(..., "The file opensfm/reconstruction.json.")
    reference_path: ProjectPath | None = setting(
        None, "OpenSfM's reference_lla.json, where the reconstruction does not contain it."
    )

    @property
    def files(self) -> tuple[str, ...]:
        return (self.path, *((self.reference_path,) if self.reference_path else ()))


class FromMatrices(_ForeignFile):
    """A JSON file of matrices: photograph -> K (px), R_world_to_camera, t (x_camera = R X + t) or centre, width, height."""

    kind: Literal["matrices"]
    path: ProjectPath = setting(..., "The JSON file; photographs are without distortion unless it states k1, k2, k3, p1, p2.")


class FromBlock(_ForeignFile):
    """The cameras.json of another project of orthomill: orientation, cameras and the heights of the ground."""

    kind: Literal["orthomill"]
    path: ProjectPath = setting(..., "The file products/cameras.json.")


ForeignSource = FromAngles | FromColmap | FromOpensfm | FromMatrices | FromBlock
ExteriorSource = Annotated[Adjusted | ForeignSource, Field(discriminator="kind")]


ShiftChoice = Literal["auto", "constant", "none"]
"""Whether positions have constant errors that are adjusted: where the sources demand it, one that is common to all, or never"""


Looking = Literal["auto", "down", "level"]
