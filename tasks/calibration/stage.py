"""The stage `calibration`: the interior orientation of every camera of the project.

One job, except for chessboards: there one job per photograph measures its corners, one job identifies the boards, photographs that
lack boards are searched again, and one job adjusts them all. Chessboard photographs are used as stored, not turned upright: it is
the sensor that is calibrated. Without the stage `photos` the calibration is run alone.
"""

from collections.abc import Callable, Iterator
from typing import Any, ClassVar, Literal

from orthomill.schemas.camera import CAMERAS, LensKind, lens_parameters
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Export, Job, PhotoHeader, PhotoPixels, Raster, Region, Table, TextFile
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
from orthomill.tasks.calibration.cameras.camera_exchange import FORMATS
from orthomill.tasks.calibration.chessboards import Model, from_chessboards, index_board_photos
from orthomill.tasks.calibration.detection.board_photographs import complete_corners, overview_level, photo_corners
from orthomill.tasks.calibration.detection.board_turns import symmetric
from orthomill.tasks.calibration.known_cameras import KnownCameras, as_given, from_exif, from_file
from orthomill.tasks.calibration.reporting.drawing import draw_boards
from orthomill.tasks.calibration.solving.arranging import arrange
from orthomill.tasks.calibration.solving.solving import CalibrationTarget
from orthomill.tasks.imagery.pyramid import level_shape

Parameter = Literal["c", "x0", "y0", "k1", "k2", "k3", "p1", "p2", "affinity", "skew", "k4", "k5", "k6", "s1", "s2", "s3", "s4"]
LensChoice = Literal["automatic", "brown", "rational", "thin_prism", "fisheye", "division"]

_SEARCH_MEMORY = 160 * 2**20
"""bytes of working memory of the board detection on reduced images, measured"""


class CalibrationStage(Stage):
    """Determines the interior orientation from the source that the project names."""

    title: ClassVar[str] = "Interior orientation"
    kind: Literal["calibration"] = "calibration"
    parameters: tuple[Parameter, ...] = setting(
        (),
        "Interior parameters to estimate from chessboards, the others being zero; empty: those that held-out photographs support.",
    )
    model: LensChoice = setting(
        "automatic",
        "Model of the lens that is calibrated from chessboards; automatic: the one that fits all corners of held-out photographs "
        "best (Brown's where it is as good as any, and for stated parameters).",
    )

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """One job for cameras that are known already; corners per photograph and an adjustment for chessboards."""
        source = view.project.cameras
        if source.kind != "chessboards":
            self._refuse_parameters(source.kind)
        if source.kind == "chessboards":
            yield from self._chessboard_jobs(view, source)
            yield from self._chessboard_exports()
        elif source.kind == "file":
            yield self._job(from_file, {"text": TextFile(source.path)}, {"path": source.path, "serves": source.serves})
        elif source.kind == "given":
            yield self._job(as_given, {}, {"given": source})
        else:
            yield self._job(from_exif, {}, {})

    def _refuse_parameters(self, kind: str) -> None:
        """Raises WorkflowError for parameters that nothing would estimate."""
        if self.parameters or self.model != "automatic":
            what = f"parameters ({', '.join(self.parameters)})" if self.parameters else f"model ({self.model})"
            raise WorkflowError(
                f"The calibration's {what} have no effect with cameras of kind: {kind}, as only "
                "photographs of chessboards estimate them; remove the setting, or calibrate with cameras of kind: chessboards."
            )

    def _job(
        self, function: Callable[..., KnownCameras], reads: dict[str, Region | tuple[Region, ...]], params: dict[str, Any]
    ) -> Job:
        return Job(
            stage=self.kind,
            item="cameras",
            function=function,
            reads={"photos": PHOTOS, **reads},
            writes={"cameras": CAMERAS, "report": report_table(self.kind)},
            params=params,
        )

    def _chessboard_jobs(self, view: ProjectView, source: CameraFromChessboards) -> Iterator[RasterSpec | Job]:
        _check_board(source)
        # Checked before any photograph is searched: a wrong setting must not cost minutes first.
        model = _model(self.parameters, self.model)
        yield self._index(view.image_files(source.photographs, simulated_folder="chessboards"))
        boards = view.table(BOARD_PHOTOS)
        yield from self._searches(boards, source)
        target = _target(boards, source)
        yield self._identification(boards, target)
        # The photographs to be searched again are known once the boards are identified: view.table suspends the plan until then.
        incomplete = view.table(ARRANGED).incomplete
        yield from self._second_searches(boards, incomplete, source)
        params = {"target": target, "model": model, "serves": source.serves}
        yield self._adjustment(boards, incomplete, params, alone=not view.has_stage("photos"))
        yield from self._drawings(boards)

    def _index(self, paths: tuple[str, ...]) -> Job:
        return Job(
            stage=self.kind,
            item="chessboards",
            function=index_board_photos,
            reads={"headers": tuple(PhotoHeader(path) for path in paths)},
            writes={"boards": BOARD_PHOTOS},
        )

    def _searches(self, boards: BoardPhotos, source: CameraFromChessboards) -> Iterator[RasterSpec | Job]:
        """One job per photograph."""
        width, height = boards.size
        exact = not source.sigma_in_plane and not source.sigma_height
        for path, name in zip(boards.paths, boards.names, strict=True):
            shape = level_shape((height, width), overview_level(boards.size))
            spec = RasterSpec(name=overview_raster(name), shape=shape, dtype="uint8", chunk=max(shape))
            yield spec
            yield Job(
                stage=self.kind,
                item=f"corners {name}",
                function=photo_corners,
                reads={"pixels": PhotoPixels(path, Window(0, 0, height, width))},
                writes={"corners": corners_table(name), "search": search_table(name), "overview": Raster(spec.name, spec.full)},
                params={"photo": name, "corners": source.corners, "boards": source.boards, "exact": exact},
                scratch=3 * width * height + _SEARCH_MEMORY,
            )

    def _identification(self, boards: BoardPhotos, target: CalibrationTarget) -> Job:
        reads: dict[str, Region | tuple[Region, ...]] = {
            "boards": BOARD_PHOTOS,
            "corners": tuple(corners_table(name) for name in boards.names),
            "searches": tuple(search_table(name) for name in boards.names),
        }
        return Job(
            stage=self.kind,
            item="arrangement",
            function=arrange,
            reads=reads,
            writes={"arranged": ARRANGED},
            params={"target": target},
        )

    def _second_searches(self, boards: BoardPhotos, incomplete: tuple[str, ...], source: CameraFromChessboards) -> Iterator[Job]:
        width, height = boards.size
        path_of = dict(zip(boards.names, boards.paths, strict=True))
        for name in incomplete:
            yield Job(
                stage=self.kind,
                item=f"second search {name}",
                function=complete_corners,
                reads={"pixels": PhotoPixels(path_of[name], Window(0, 0, height, width)), "arranged": ARRANGED},
                writes={"corners": completed_table(name)},
                params={"photo": name, "corners": source.corners},
                scratch=2 * width * height,
            )

    def _adjustment(self, boards: BoardPhotos, incomplete: tuple[str, ...], params: dict[str, Any], alone: bool) -> Job:
        reads: dict[str, Region | tuple[Region, ...]] = {
            "boards": BOARD_PHOTOS,
            "arranged": ARRANGED,
            "corners": tuple(corners_table(name) for name in boards.names),
            "completed": tuple(completed_table(name) for name in incomplete),
            "searches": tuple(search_table(name) for name in boards.names),
        }
        return Job(
            stage=self.kind,
            item="cameras",
            function=from_chessboards,
            reads=reads if alone else {"photos": PHOTOS, **reads},
            writes=self._adjustment_writes(),
            params=params,
            scratch=200 * 2**20,
        )

    def _adjustment_writes(self) -> dict[str, Raster | Table]:
        return {
            "cameras": CAMERAS,
            "report": report_table(self.kind),
            "camera": CAMERA_FILE,
            "calibration": CALIBRATION,
            "residuals": RESIDUALS,
            **{name: text_table(known.file) for name, known in FORMATS.items()},
        }

    def _drawings(self, boards: BoardPhotos) -> Iterator[RasterSpec | Job]:
        width, height = boards.size
        rows, cols = level_shape((height, width), overview_level(boards.size))
        for name in boards.names:
            spec = RasterSpec(name=drawing_raster(name), shape=(rows, cols, 3), dtype="uint8", chunk=max(rows, cols))
            yield spec
            yield Job(
                stage=self.kind,
                item=f"drawing {name}",
                function=draw_boards,
                reads={"overview": Raster(overview_raster(name), Window(0, 0, rows, cols)), "residuals": RESIDUALS},
                writes={"picture": Raster(spec.name, spec.full)},
                params={"photo": name, "size": boards.size},
            )

    def _chessboard_exports(self) -> Iterator[Export]:
        yield Export(self.kind, "camera file", "products/camera.json", "json", tables=(CAMERA_FILE,))
        yield Export(self.kind, "calibration record", "products/calibration.json", "json", tables=(CALIBRATION,))
        for known in FORMATS.values():
            yield Export(self.kind, known.file, f"products/{known.file}", "text", tables=(text_table(known.file),))


def _target(boards: BoardPhotos, source: CameraFromChessboards) -> CalibrationTarget:
    return CalibrationTarget(
        size=boards.size,
        corners=source.corners,
        square=source.square,
        boards=source.boards,
        arrangement=source.arrangement,
        sigma_in_plane=source.sigma_in_plane,
        sigma_height=source.sigma_height,
        bend=source.bend,
    )


def _model(parameters: tuple[str, ...], lens: LensChoice = "automatic") -> Model:
    """The parameters in their order. Raises WorkflowError without c, and for parameters that the lens lacks."""
    if parameters and "c" not in parameters:
        raise WorkflowError("The calibration's parameters must hold c; without it nothing is calibrated.")
    kind: LensKind | None = None if lens == "automatic" else lens
    own = lens_parameters(kind or "brown")
    if strange := [name for name in parameters if name not in own]:
        raise WorkflowError(
            f"The calibration's parameters {', '.join(strange)} are none of a lens of the model {kind or 'brown'}, which has "
            f"{', '.join(own)}; name the model that has them (model)."
        )
    return Model(tuple(name for name in own if name in parameters) or None, kind)


def _check_board(source: CameraFromChessboards) -> None:
    """A board must have enough corners, and where they are uncertain a first one. Raises WorkflowError."""
    columns, rows = source.corners
    # Fewer than three rows of corners leave no inner corner whose four neighbours could confirm the lattice.
    if min(columns, rows) < 3:
        raise WorkflowError(f"The chessboard has {columns} x {rows} inner corners; both numbers must be at least 3.")
    if symmetric(source.corners) and (source.sigma_in_plane or source.sigma_height):
        raise WorkflowError(
            f"A chessboard with {columns} x {rows} inner corners looks the same after half a turn: which of its corners is which "
            "cannot be seen, so that sigma_in_plane and sigma_height have no meaning; remove them, or use a board with one even "
            "and one odd number of inner corners."
        )
