"""The stage `calibration`: the interior orientation of every camera of the project.

One job, except for chessboards: there each photograph gives its corners in a job of its own, and one job adjusts them all.
Chessboard photographs are taken as their files are, not turned upright: the sensor is what is calibrated.
"""

from collections.abc import Iterator
from typing import Any, ClassVar, Literal

from schemas.camera import CAMERAS
from schemas.errors import WorkflowError
from schemas.job import Export, Job, PhotoHeader, PhotoPixels, Region, Table, TextFile
from schemas.photo import PHOTOS
from schemas.raster import RasterSpec, Window
from schemas.report import report_table
from schemas.settings import setting
from schemas.stage import ProjectView, Stage
from schemas.workflow import CameraFromChessboards
from tasks.calibration.boards import Corners, photo_corners
from tasks.calibration.cameras import (
    BoardCalibration,
    BoardPhotos,
    as_given,
    from_chessboards,
    from_exif,
    from_file,
    index_board_photos,
)

BOARD_PHOTOS = Table("calibration/chessboards.json", BoardPhotos)
_LENSES: dict[str, tuple[str, ...]] = {
    "radial": ("c", "x0", "y0", "k1", "k2"),
    "brown": ("c", "x0", "y0", "k1", "k2", "p1", "p2"),
    "brown_k3": ("c", "x0", "y0", "k1", "k2", "k3", "p1", "p2"),
}

_SEARCH_MEMORY = 120 * 2**20
"""bytes that the search for boards takes on its reduced images, measured"""


def corners_table(name: str) -> Table[Corners]:
    """Where the chessboard corners of a photograph are stored."""
    return Table(f"calibration/corners/{name}.parquet", Corners)


class CalibrationStage(Stage):
    """Finds the interior orientation from the source that the project names."""

    title: ClassVar[str] = "Interior orientation"
    kind: Literal["calibration"] = "calibration"
    lens: Literal["radial", "brown", "brown_k3"] = setting(
        "brown",
        "Distortion that chessboards determine: radial (k1, k2), brown (with p1, p2), brown_k3 (with k3 for very wide angles).",
    )

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """One job for what is known already; corners per photograph and an adjustment for chessboards."""
        source = view.project.cameras
        if source.kind == "chessboards":
            yield from self._chessboard_jobs(view, source)
        elif source.kind == "file":
            yield self._job(from_file, {"text": TextFile(source.path)}, {"path": source.path})
        elif source.kind == "given":
            yield self._job(as_given, {}, {"given": source})
        else:
            yield self._job(from_exif, {}, {})

    def _job(self, function: Any, reads: dict[str, Region | tuple[Region, ...]], params: dict[str, Any]) -> Job:
        return Job(
            stage=self.kind, item="cameras", function=function, reads={"photos": PHOTOS, **reads},
            writes={"cameras": CAMERAS, "report": report_table(self.kind)}, params=params,
        )  # fmt: skip

    def _chessboard_jobs(self, view: ProjectView, source: CameraFromChessboards) -> Iterator[Job]:
        _check_board(source)
        headers = tuple(PhotoHeader(path) for path in view.image_files(source.photographs, simulated_folder="chessboards"))
        yield Job(
            stage=self.kind,
            item="chessboards",
            function=index_board_photos,
            reads={"headers": headers},
            writes={"boards": BOARD_PHOTOS},
        )
        boards = view.table(BOARD_PHOTOS)
        width, height = boards.size
        whole = Window(0, 0, height, width)
        for path, name in zip(boards.paths, boards.names, strict=True):
            yield Job(
                stage=self.kind, item=f"corners {name}", function=photo_corners, reads={"pixels": PhotoPixels(path, whole)},
                writes={"corners": corners_table(name)}, params={"corners": source.corners},
                scratch=3 * width * height + _SEARCH_MEMORY,
            )  # fmt: skip
        found = tuple(corners_table(name) for name in boards.names)
        settings = BoardCalibration(source.square, _LENSES[self.lens])
        yield self._job(from_chessboards, {"boards": BOARD_PHOTOS, "corners": found}, {"settings": settings})


def _check_board(source: CameraFromChessboards) -> None:
    """A board must have an unambiguous origin and enough corners. Raises WorkflowError."""
    columns, rows = source.corners
    if columns == rows or min(columns, rows) < 3:
        raise WorkflowError(
            f"The chessboard has {columns} x {rows} inner corners; the two numbers must differ and be 3 at least, "
            "so that a board has one long side and can be oriented."
        )
