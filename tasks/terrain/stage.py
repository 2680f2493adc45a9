"""The stage `terrain`: the bare ground of the surface model, and what stands on it."""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from orthomill.schemas.job import Export, Job
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.stage_contract import ProjectView, Stage


class NoContours(Settings):
    """No contours are drawn."""

    kind: Literal["none"]


class DrawContours(Settings):
    """Contours as GeoPackage, DXF and GeoJSON, dashed where the ground was not measured."""

    kind: Literal["draw"] = "draw"
    interval: Annotated[float, Field(gt=0, le=1000)] | Literal["auto"] = setting(
        "auto", "Height between contours; auto: the least round one that the accuracy of the ground bears.", "m"
    )
    index_every: int = setting(5, "Every so many-th contour is an index contour, with its height written on it.", ge=1, le=100)


Contours = Annotated[DrawContours | NoContours, Field(discriminator="kind")]


class TerrainStage(Stage):
    """The bare ground below buildings and plants, with a standard error and a code for every cell, and classes of cells and
    points."""

    title: ClassVar[str] = "Terrain"

    kind: Literal["terrain"] = "terrain"
    widest_object: float = setting(60.0, "Width of the widest building; wider ones are taken for ground.", "m", gt=0, le=1000)
    slope: float = setting(
        0.15, "How much ground rises, at most, over the width of an object, as a ratio: less finds lower objects.", gt=0, le=2
    )
    steepest: float = setting(0.7, "The steepest ground that continues ground beside it, as a ratio.", gt=0, le=5)
    roughness: float = setting(0.1, "How uneven ground is anywhere.", "m", ge=0, le=10)
    max_gap: float = setting(100.0, "How far from measured ground the terrain is continued.", "m", gt=0, le=2000)
    contours: Contours = setting(DrawContours(), "Contours of the terrain.")

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """Blocks, their ground, what hiding it tells, bridges, the terrain of the cells, and classes."""
        from orthomill.tasks.terrain.plan.terrain_jobs import TerrainJobs

        return TerrainJobs(view, self).all()
