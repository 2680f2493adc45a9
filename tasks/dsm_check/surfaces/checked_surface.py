"""Which surface is checked, and what happens to its place."""

from typing import Annotated, Literal

from pydantic import Field

from orthomill.schemas.project_paths import ProjectPath
from orthomill.schemas.settings import Settings, setting


class DensifiedSurface(Settings):
    """The surface that this project measured."""

    kind: Literal["densification"] = "densification"


class SurfaceFile(Settings):
    """A surface from a file, of any program, in any projected or geographic system and cell size: GeoTIFF, LAS or LAZ."""

    kind: Literal["file"]
    path: ProjectPath = setting(..., "GeoTIFF, LAS or LAZ with heights, relative to the project's root.")
    system: str | None = setting(None, "Reference system of a file that names none, e.g. EPSG:2100+5773.")
    sigma: float = setting(
        0.0,
        "Standard error of its heights; 0 asks whether they are right, that of an earlier survey whether the difference is more.",
        "m",
        ge=0,
    )
    epoch: Literal["same", "earlier"] = setting(
        "same",
        "Whether it shows the ground of the photographs, and differences are errors, or an earlier one, and they are change.",
    )
    shift: Literal["keep", "remove"] = setting(
        "keep",
        "A shift of the whole surface, in height and plan, is found and reported in any case; whether the corrected surface "
        "keeps it. "
        "Errors are given relative to the shift in height.",
    )
    holes: Literal["keep", "fill"] = setting(
        "keep", "Whether holes are filled with what the stage densification, where the workflow has it, measured there."
    )


CheckedSurface = Annotated[DensifiedSurface | SurfaceFile, Field(discriminator="kind")]
