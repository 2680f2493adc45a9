"""The stage `viewer`: the products of a run as a map that opens in a browser, from the disk and without a network."""

from collections.abc import Iterator
from typing import ClassVar, Literal

from orthomill.schemas.job import Export, Job
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.stage_contract import ProjectView, Stage


class ViewerStage(Stage):
    """Orthoimage, surface, terrain and their accuracy as layers of one map, with the heights of every place."""

    title: ClassVar[str] = "Viewer"

    kind: Literal["viewer"] = "viewer"

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """The page, from what the stages before report; planning waits for their reports."""
        from orthomill.tasks.viewer.plan.viewer_jobs import viewer_jobs

        return viewer_jobs(view)
