"""The stage `terrain`: the bare ground of the surface model, and what stands on it."""

from collections.abc import Iterator
from typing import ClassVar, Literal

from orthomill.schemas.job import Export, Job
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import setting
from orthomill.schemas.stage_contract import ProjectView, Stage


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

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """Blocks, their ground, what hiding it tells, bridges, the terrain of the cells, and classes."""
        from orthomill.tasks.terrain.plan.terrain_jobs import TerrainJobs

        return TerrainJobs(view, self).all()
