"""The stage `calibration`: the interior orientation of every camera of the project.

One job, except for chessboards: there each photograph gives its corners in a job of its own, one job tells the boards apart, each
photograph that lacks boards is looked at again, and one job adjusts them all. Chessboard photographs are taken as their files are,
not turned upright: the sensor is what is calibrated. Without the stage `photos` the calibration stands alone.
"""

from collections.abc import Iterator
from typing import Any, ClassVar, Literal

from orthomill.schemas.camera import CAMERAS
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Export, Job, PhotoHeader, PhotoPixels, Raster, Region, TextFile
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.project import CameraFromChessboards
from orthomill.schemas.raster import RasterSpec, Window
from orthomill.schemas.settings import setting
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.schemas.stage_report import report_table
from orthomill.tasks.calibration.board_tables import (
    ARRANGED,
    BOARD_PHOTOS,
    CALIBRATION,
    CAMERA_FILE,
    RESIDUALS,
    BoardPhotos,
    completed_table,
    corners_table,
    drawing_raster,
    overview_raster,
    search_table,
    text_table,
)
from orthomill.tasks.calibration.cameras.camera_exchange import WRITERS
from orthomill.tasks.calibration.cameras.known_cameras import as_given, from_exif, from_file
from orthomill.tasks.calibration.detection.board_detection import symmetric
from orthomill.tasks.calibration.detection.board_photographs import complete_corners, overview_level, photo_corners
from orthomill.tasks.calibration.reporting.drawing import draw_boards
from orthomill.tasks.calibration.solving.arranging import arrange
from orthomill.tasks.calibration.solving.chessboards import Model, from_chessboards, index_board_photos
from orthomill.tasks.calibration.solving.solving import CalibrationTarget
from orthomill.tasks.imagery.pyramid import level_shape

Parameter = Literal["c", "x0", "y0", "k1", "k2", "k3", "p1", "p2", "affinity", "skew"]

_SEARCH_MEMORY = 160 * 2**20
"""bytes that the search for boards takes on its reduced images, measured"""


class CalibrationStage(Stage):
    """Finds the interior orientation from the source that the project names."""

    title: ClassVar[str] = "Interior orientation"
    kind: Literal["calibration"] = "calibration"
    parameters: tuple[Parameter, ...] = setting(
        (),
        "Interior parameters that chessboards determine, the others being zero; empty: c, x0, y0, k1, k2, and of k3, p1, p2 what "
        "photographs that take no part speak for.",
    )

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """One job for what is known already; corners per photograph and an adjustment for chessboards."""
        source = view.project.cameras
        if source.kind == "chessboards":
            yield from self._chessboard_jobs(view, source)
        elif source.kind == "file":
            yield self._job(from_file, {"text": TextFile(source.path)}, {"path": source.path, "serves": source.serves})
        elif source.kind == "given":
            yield self._job(as_given, {}, {"given": source})
        else:
            yield self._job(from_exif, {}, {})

    def _job(self, function: Any, reads: dict[str, Region | tuple[Region, ...]], params: dict[str, Any]) -> Job:
        return Job(
            stage=self.kind, item="cameras", function=function, reads={"photos": PHOTOS, **reads},
            writes={"cameras": CAMERAS, "report": report_table(self.kind)}, params=params,
        )  # fmt: skip

    def _chessboard_jobs(self, view: ProjectView, source: CameraFromChessboards) -> Iterator[RasterSpec | Job | Export]:
        _check_board(source)
        model = _model(self.parameters)
        paths = view.image_files(source.photographs, simulated_folder="chessboards")
        headers = tuple(PhotoHeader(path) for path in paths)
        yield Job(
            stage=self.kind, item="chessboards", function=index_board_photos, reads={"headers": headers},
            writes={"boards": BOARD_PHOTOS},
        )  # fmt: skip
        boards = view.table(BOARD_PHOTOS)
        yield from self._searches(boards, source)
        target = CalibrationTarget(boards.size, source.corners, source.square, source.boards, source.arrangement,
                                   source.sigma_in_plane, source.sigma_height)  # fmt: skip
        corners = tuple(corners_table(name) for name in boards.names)
        yield Job(
            stage=self.kind, item="arrangement", function=arrange,
            reads={"boards": BOARD_PHOTOS, "corners": corners, "searches": tuple(search_table(name) for name in boards.names)},
            writes={"arranged": ARRANGED}, params={"target": target},
        )  # fmt: skip
        incomplete = view.table(ARRANGED).incomplete
        yield from self._second_looks(boards, incomplete, source)
        alone = not view.has_stage("photos")
        yield self._adjustment(boards, incomplete, {"target": target, "model": model, "serves": source.serves}, alone)
        yield from self._drawings(boards)
        yield Export(self.kind, "camera file", "products/camera.json", "json", tables=(CAMERA_FILE,))
        yield Export(self.kind, "calibration record", "products/calibration.json", "json", tables=(CALIBRATION,))
        for name in WRITERS:
            yield Export(self.kind, name, f"products/{name}", "text", tables=(text_table(name),))

    def _searches(self, boards: BoardPhotos, source: CameraFromChessboards) -> Iterator[RasterSpec | Job]:
        """One job per photograph."""
        width, height = boards.size
        exact = not source.sigma_in_plane and not source.sigma_height
        for path, name in zip(boards.paths, boards.names, strict=True):
            shape = level_shape((height, width), overview_level(boards.size))
            spec = RasterSpec(name=overview_raster(name), shape=shape, dtype="uint8", chunk=max(shape))
            yield spec
            yield Job(
                stage=self.kind, item=f"corners {name}", function=photo_corners,
                reads={"pixels": PhotoPixels(path, Window(0, 0, height, width))},
                writes={"corners": corners_table(name), "search": search_table(name), "overview": Raster(spec.name, spec.full)},
                params={"photo": name, "corners": source.corners, "boards": source.boards, "exact": exact},
                scratch=3 * width * height + _SEARCH_MEMORY,
            )  # fmt: skip

    def _second_looks(self, boards: BoardPhotos, incomplete: tuple[str, ...], source: CameraFromChessboards) -> Iterator[Job]:
        width, height = boards.size
        path_of = dict(zip(boards.names, boards.paths, strict=True))
        for name in incomplete:
            yield Job(
                stage=self.kind, item=f"second look {name}", function=complete_corners,
                reads={"pixels": PhotoPixels(path_of[name], Window(0, 0, height, width)), "arranged": ARRANGED},
                writes={"corners": completed_table(name)}, params={"photo": name, "corners": source.corners},
                scratch=2 * width * height,
            )  # fmt: skip

    def _adjustment(self, boards: BoardPhotos, incomplete: tuple[str, ...], params: dict[str, Any], alone: bool) -> Job:
        reads: dict[str, Any] = {
            "boards": BOARD_PHOTOS, "arranged": ARRANGED,
            "corners": tuple(corners_table(name) for name in boards.names),
            "completed": tuple(completed_table(name) for name in incomplete),
            "searches": tuple(search_table(name) for name in boards.names),
        }  # fmt: skip
        writes: dict[str, Any] = {
            "cameras": CAMERAS, "report": report_table(self.kind), "camera": CAMERA_FILE, "calibration": CALIBRATION,
            "residuals": RESIDUALS, **{name: text_table(name) for name in WRITERS},
        }  # fmt: skip
        return Job(
            stage=self.kind, item="cameras", function=from_chessboards, reads=reads if alone else {"photos": PHOTOS, **reads},
            writes=writes, params=params, scratch=200 * 2**20,
        )  # fmt: skip

    def _drawings(self, boards: BoardPhotos) -> Iterator[RasterSpec | Job]:
        width, height = boards.size
        rows, cols = level_shape((height, width), overview_level(boards.size))
        for name in boards.names:
            spec = RasterSpec(name=drawing_raster(name), shape=(rows, cols, 3), dtype="uint8", chunk=max(rows, cols))
            yield spec
            yield Job(
                stage=self.kind, item=f"drawing {name}", function=draw_boards,
                reads={"overview": Raster(overview_raster(name), Window(0, 0, rows, cols)), "residuals": RESIDUALS},
                writes={"picture": Raster(spec.name, spec.full)}, params={"photo": name, "size": boards.size},
            )  # fmt: skip


def _model(parameters: tuple[str, ...]) -> Model:
    """The parameters in their order. Raises WorkflowError without c, which nothing else makes up for."""
    if parameters and "c" not in parameters:
        raise WorkflowError("The calibration's parameters must hold c; without it nothing is calibrated.")
    return Model(tuple(name for name in Parameter.__args__ if name in parameters) or None)


def _check_board(source: CameraFromChessboards) -> None:
    """A board must have an unambiguous origin and enough corners. Raises WorkflowError."""
    columns, rows = source.corners
    if symmetric(source.corners) or min(columns, rows) < 3:
        raise WorkflowError(
            f"The chessboard has {columns} x {rows} inner corners; one of the two numbers must be even and the other odd, and "
            f"both 3 at "
            "least: a board that looks the same after half a turn has no first corner, and its images cannot be told apart."
        )
