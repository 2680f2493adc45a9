"""The jobs of a calibration from chessboards: corners, boards by name, a second search, one adjustment, drawings."""

from collections.abc import Iterator
from typing import Any

from orthomill.schemas.camera import CAMERAS, LensKind, lens_parameters
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Export, Job, PhotoHeader, PhotoPixels, Raster, Region, Table
from orthomill.schemas.memory import MIB, array_bytes
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.project import CameraFromChessboards
from orthomill.schemas.raster import RasterSpec, Window
from orthomill.schemas.stage_contract import ProjectView
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
from orthomill.tasks.calibration.chessboards import Model, index_board_photos
from orthomill.tasks.calibration.detection.board_photographs import overview_level, photo_corners
from orthomill.tasks.calibration.detection.board_turns import symmetric
from orthomill.tasks.calibration.detection.second_search import complete_corners
from orthomill.tasks.calibration.diagnosis.drawing import draw_boards
from orthomill.tasks.calibration.report.chessboard_calibration import from_chessboards
from orthomill.tasks.calibration.solving.arranging import arrange
from orthomill.tasks.calibration.solving.solving import CalibrationTarget
from orthomill.tasks.calibration.stage import CalibrationStage, LensChoice
from orthomill.tasks.imagery.pyramid import level_shape

KIND = "calibration"
_SEARCH_MEMORY = 160 * MIB
"""bytes of working memory of the board detection on reduced images, measured"""


def chessboard_jobs(asked: CalibrationStage, view: ProjectView, source: CameraFromChessboards) -> Iterator[RasterSpec | Job]:
    """The jobs that calibrate a camera from photographs of boards, one step after the other. Raises WorkflowError for a board, or
    parameters, that no calibration can have."""
    _check_board(source)
    # Checked before any photograph is searched: a wrong setting must not cost minutes first.
    model = _model(asked.parameters, asked.model)
    yield _index(view.image_files(source.photographs, simulated_folder="chessboards"))
    boards = view.table(BOARD_PHOTOS)
    yield from _searches(boards, source)
    target = _target(boards, source)
    yield _identification(boards, target)
    # The photographs to be searched again are known once the boards are identified: view.table suspends the plan until then.
    incomplete = view.table(ARRANGED).incomplete
    yield from _second_searches(boards, incomplete, source)
    params = {"target": target, "model": model, "serves": source.serves}
    yield _adjustment(boards, incomplete, params, alone=not view.has_stage("photos"))
    yield from _drawings(boards)


def _index(paths: tuple[str, ...]) -> Job:
    return Job(
        stage=KIND,
        item="chessboards",
        function=index_board_photos,
        reads={"headers": tuple(PhotoHeader(path) for path in paths)},
        writes={"boards": BOARD_PHOTOS},
    )


def _searches(boards: BoardPhotos, source: CameraFromChessboards) -> Iterator[RasterSpec | Job]:
    """One job per photograph."""
    width, height = boards.size
    exact = not source.sigma_in_plane and not source.sigma_height
    for path, name in zip(boards.paths, boards.names, strict=True):
        shape = level_shape((height, width), overview_level(boards.size))
        spec = RasterSpec(name=overview_raster(name), shape=shape, dtype="uint8", chunk=max(shape))
        yield spec
        yield Job(
            stage=KIND,
            item=f"corners {name}",
            function=photo_corners,
            reads={"pixels": PhotoPixels(path, Window(0, 0, height, width))},
            writes={"corners": corners_table(name), "search": search_table(name), "overview": Raster(spec.name, spec.full)},
            params={"photo": name, "corners": source.corners, "boards": source.boards, "exact": exact},
            scratch=array_bytes(3, width, height) + _SEARCH_MEMORY,
        )


def _identification(boards: BoardPhotos, target: CalibrationTarget) -> Job:
    reads: dict[str, Region | tuple[Region, ...]] = {
        "boards": BOARD_PHOTOS,
        "corners": tuple(corners_table(name) for name in boards.names),
        "searches": tuple(search_table(name) for name in boards.names),
    }
    return Job(
        stage=KIND, item="arrangement", function=arrange, reads=reads, writes={"arranged": ARRANGED}, params={"target": target}
    )


def _second_searches(boards: BoardPhotos, incomplete: tuple[str, ...], source: CameraFromChessboards) -> Iterator[Job]:
    width, height = boards.size
    path_of = dict(zip(boards.names, boards.paths, strict=True))
    for name in incomplete:
        yield Job(
            stage=KIND,
            item=f"second search {name}",
            function=complete_corners,
            reads={"pixels": PhotoPixels(path_of[name], Window(0, 0, height, width)), "arranged": ARRANGED},
            writes={"corners": completed_table(name)},
            params={"photo": name, "corners": source.corners},
            scratch=array_bytes(2, width, height),
        )


def _adjustment(boards: BoardPhotos, incomplete: tuple[str, ...], params: dict[str, Any], alone: bool) -> Job:
    reads: dict[str, Region | tuple[Region, ...]] = {
        "boards": BOARD_PHOTOS,
        "arranged": ARRANGED,
        "corners": tuple(corners_table(name) for name in boards.names),
        "completed": tuple(completed_table(name) for name in incomplete),
        "searches": tuple(search_table(name) for name in boards.names),
    }
    return Job(
        stage=KIND,
        item="cameras",
        function=from_chessboards,
        reads=reads if alone else {"photos": PHOTOS, **reads},
        writes=_adjustment_writes(),
        params=params,
        scratch=200 * MIB,
    )


def _adjustment_writes() -> dict[str, Raster | Table]:
    return {
        "cameras": CAMERAS,
        "report": report_table(KIND),
        "camera": CAMERA_FILE,
        "calibration": CALIBRATION,
        "residuals": RESIDUALS,
        **{name: text_table(known.file) for name, known in FORMATS.items()},
    }


def _drawings(boards: BoardPhotos) -> Iterator[RasterSpec | Job]:
    width, height = boards.size
    rows, cols = level_shape((height, width), overview_level(boards.size))
    for name in boards.names:
        spec = RasterSpec(name=drawing_raster(name), shape=(rows, cols, 3), dtype="uint8", chunk=max(rows, cols))
        yield spec
        yield Job(
            stage=KIND,
            item=f"drawing {name}",
            function=draw_boards,
            reads={"overview": Raster(overview_raster(name), Window(0, 0, rows, cols)), "residuals": RESIDUALS},
            writes={"picture": Raster(spec.name, spec.full)},
            params={"photo": name, "size": boards.size},
        )


def chessboard_exports() -> Iterator[Export]:
    """The camera, the record of its calibration, and the files of other programs."""
    yield Export(KIND, "camera file", "products/camera.json", "json", tables=(CAMERA_FILE,))
    yield Export(KIND, "calibration record", "products/calibration.json", "json", tables=(CALIBRATION,))
    for known in FORMATS.values():
        yield Export(KIND, known.file, f"products/{known.file}", "text", tables=(text_table(known.file),))


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
