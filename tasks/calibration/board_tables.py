"""The tables that the jobs of a calibration from chessboards exchange."""

from dataclasses import dataclass
from pathlib import PurePath

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.camera import Camera
from orthomill.schemas.job import Columns, Table


class _Record(BaseModel):
    # Unknown values are NaN; JSON has no number for them, and null would not come back as a float.
    model_config = ConfigDict(frozen=True, ser_json_inf_nan="constants")


class BoardPhotos(_Record):
    """The photographs of chessboards, all of one size (width, height) as stored in their files."""

    paths: tuple[str, ...]
    size: tuple[int, int]

    @property
    def names(self) -> tuple[str, ...]:
        """Stems of the files; the whole path where two stems are alike."""
        # Stems name tables and rasters: two folders of one camera both hold a DSC_0001, and one would overwrite the other.
        stems = [PurePath(path).stem for path in self.paths]
        whole = ["_".join(PurePath(path).with_suffix("").parts).replace("..", "up") for path in self.paths]
        return tuple(name if stems.count(name) == 1 else full for name, full in zip(stems, whole, strict=True))


@dataclass(frozen=True)
class Corners(Columns):
    """Chessboard corners of one photograph, board after board, row by row."""

    board: np.ndarray
    """int32: number of the board in the photograph, or among all boards once they are identified"""
    column: np.ndarray
    row: np.ndarray
    """int32: position of the corner on its board"""
    x: np.ndarray
    y: np.ndarray
    """float64: pixel coordinates (col, row)"""

    @property
    def pixels(self) -> np.ndarray:
        """(N, 2) (col, row)."""
        return np.column_stack([self.x, self.y])


class PhotoSearch(_Record):
    """Result of the search in one photograph.

    Numbers of boards: whole (`boards`), `cut` ones, cut ones whose corners cannot be numbered (`unnumbered`), rejected finds
    (`false`), boards with more corners than stated (`larger`). `other`: sizes (columns, rows) of boards of another kind; `blur`:
    standard deviation of the edges, px; `overexposed`: share of the pixels of the boards.
    """

    photo: str
    boards: int
    cut: int = 0
    unnumbered: int = 0
    false: int = 0
    larger: int = 0
    other: tuple[tuple[int, int], ...] = ()
    blur: float | None
    overexposed: float


class Prediction(_Record):
    """The predicted image of a board that was missed or found only in part: pixels (col, row) of all its corners, also of those
    outside the frame; NaN where that would extrapolate the distortion too far."""

    board: int
    pixels: tuple[tuple[float, float], ...]


class ArrangedPhoto(_Record):
    """`names`: number of the board for every board found, -1: not used; `certain`: more than one board was identified."""

    photo: str
    names: tuple[int, ...]
    certain: bool
    predictions: tuple[Prediction, ...] = ()


class Arranged(_Record):
    """The boards identified in all photographs, with the images that the second search looks for."""

    boards: int
    photos: tuple[ArrangedPhoto, ...]

    @property
    def incomplete(self) -> tuple[str, ...]:
        """Photographs that are searched a second time."""
        return tuple(photo.photo for photo in self.photos if photo.predictions)


@dataclass(frozen=True)
class CornerResiduals(Columns):
    """Every measured corner in the adjustment: pixels (col, row), residual (px, y downwards as rows), whether it was used."""

    photo: np.ndarray
    board: np.ndarray
    column: np.ndarray
    row: np.ndarray
    x: np.ndarray
    y: np.ndarray
    dx: np.ndarray
    dy: np.ndarray
    used: np.ndarray


class AdjustedPose(_Record):
    """Position (m) and rotation (degrees) with standard errors; of a photograph, or of a board in the system of board 0."""

    name: str
    place: tuple[float, float, float]
    angles: tuple[float, float, float]
    place_sigma: tuple[float, float, float]
    angles_sigma: tuple[float, float, float]


class EstimatedBend(_Record):
    """The bends of a board (m) with standard errors: along its rows, along its columns, and its twist; or one for both directions
    of a board that looks the same after a quarter turn."""

    name: str
    bend: tuple[float, ...]
    sigma: tuple[float, ...]


class Calibration(_Record):
    """The calibration as a record: the camera, all interior parameters with their covariance, photographs, boards and their bends
    (none where boards were stated to be flat)."""

    camera: Camera
    parameters: tuple[str, ...]
    values: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    sigma0: float
    redundancy: int
    iterations: int
    held_out: float | None
    corners: tuple[int, int]
    square: float
    photographs: tuple[AdjustedPose, ...]
    boards: tuple[AdjustedPose, ...]
    bends: tuple[EstimatedBend, ...] = ()


class TextPage(_Record):
    """A text to be exported as a file."""

    text: str


BOARD_PHOTOS = Table("calibration/chessboards.json", BoardPhotos)
ARRANGED = Table("calibration/arranged.json", Arranged)
CALIBRATION = Table("calibration/calibration.json", Calibration)
CAMERA_FILE = Table("calibration/camera.json", Camera)
RESIDUALS = Table("calibration/residuals.parquet", CornerResiduals)


def corners_table(name: str) -> Table[Corners]:
    """Where the chessboard corners of a photograph are stored."""
    return Table(f"calibration/corners/{name}.parquet", Corners)


def completed_table(name: str) -> Table[Corners]:
    """Where the corners of the second search in a photograph are stored."""
    return Table(f"calibration/completed/{name}.parquet", Corners)


def search_table(name: str) -> Table[PhotoSearch]:
    """Where the result of the search in a photograph is stored."""
    return Table(f"calibration/search/{name}.json", PhotoSearch)


def text_table(name: str) -> Table[TextPage]:
    """A camera file in the format of another program."""
    return Table(f"calibration/text/{name}.json", TextPage)


def overview_raster(name: str) -> str:
    """uint8 (rows, cols): a photograph of boards, reduced."""
    return f"calibration/overview/{name}"


def drawing_raster(name: str) -> str:
    """uint8 (rows, cols, 3): the reduced photograph with the boards and residuals drawn on it."""
    return f"calibration/boards/{name}"
