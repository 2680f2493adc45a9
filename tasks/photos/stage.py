"""The stage `photos`: image files to chunked rasters with pyramids, and a table of what is known about each photograph."""

from collections.abc import Iterator
from typing import ClassVar, Literal

from orthomill.schemas.job import Export, Job
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import setting
from orthomill.schemas.stage_contract import InspectionPart, ProjectView, Stage
from orthomill.tasks.photos.coordinates import Digital, ImageCoordinates


class PhotosStage(Stage):
    """Reads JPEG, TIFF and PNG photographs of 8 or 16 bits, grey or RGB."""

    title: ClassVar[str] = "Photographs"
    inspects: ClassVar[InspectionPart | None] = "cameras"
    kind: Literal["photos"] = "photos"
    coordinates: ImageCoordinates = setting(
        Digital(kind="digital"), "How image coordinates follow from pixels: digital cameras, or scans of film photographs."
    )
    max_megapixels: float = setting(
        400.0, "Photographs with more pixels are refused, as a guard against files included by mistake.", "megapixels", gt=0
    )

    def remarks(self, view: ProjectView) -> Iterator[str]:
        """What is noticed about files, positions and cameras."""
        from orthomill.tasks.photos.report.photos_report import photo_remarks

        yield from photo_remarks(view.table(PHOTOS), view.project.positions.kind, view.project.cameras.kind)

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """The table of photographs first, then their strips, levels and exposure."""
        from orthomill.tasks.photos.plan.photo_jobs import photo_jobs

        return photo_jobs(self, view)
