"""Matching of two photographs without a project: of points, and of the whole surface of a rectified pair."""

from pathlib import Path

import numpy as np

from orthomill.pipeline.engine.one_thread import opencv_on_one_thread
from orthomill.pipeline.storage.image_files import read_header, read_pixels
from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.masked_pixels import colours_of, picture_of
from orthomill.tasks.imagery.radiometry import grey
from orthomill.tasks.imagery.upright import exif_orientation, upright
from orthomill.tasks.matching.dense.dense_settings import DenseMatching
from orthomill.tasks.matching.dense.pair_surface import PairSurface, match_pair
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching
from orthomill.tasks.matching.least_squares.matching import Matches, match_points


def read_photograph(path: str | Path) -> np.ndarray:
    """Pixels (rows, cols, bands) of a JPEG, TIFF or PNG, upright as EXIF says, in the file's own type; 0 where the file
    masks it. Raises PhotoError."""
    header = read_header(Path(path))
    pixels = read_pixels(Path(path), Window(0, 0, header.height, header.width))
    shown = np.where(picture_of(pixels)[..., None], colours_of(pixels), np.zeros((), pixels.dtype))
    return upright(shown, exif_orientation(header.tags))


def match(
    left: np.ndarray | str | Path,
    right: np.ndarray | str | Path,
    points: np.ndarray,
    starts: np.ndarray | None = None,
    settings: LeastSquaresMatching | None = None,
) -> Matches:
    """Least-squares matching of points of the left photograph in the right one.

    left, right: image files, or arrays (rows, cols) or (rows, cols, bands) of uint8, uint16 or float32; 0 is no data. points,
    starts: (N, 2) as (col, row) px, places in the left photograph and where the search starts in the right one, a few pixels
    near; None: at the same place. The result has positions, covariances, correlation and an outcome for every point.

    Raises PhotoError for unreadable files, ValueError for arrays that do not fit together.
    """
    points = np.atleast_2d(np.asarray(points, np.float64))
    starts = points if starts is None else np.atleast_2d(np.asarray(starts, np.float64))
    with opencv_on_one_thread():
        return match_points(_grey(left), _grey(right), points, starts, settings or LeastSquaresMatching())


def match_surface(
    left: np.ndarray | str | Path, right: np.ndarray | str | Path, low: float, high: float, settings: DenseMatching | None = None
) -> PairSurface:
    """Parallaxes of a rectified pair, complete, each with its standard error and a code that says what it is worth.

    left, right: image files or arrays as for `match`, whose rows are homologous. low, high: parallaxes (column left - column right)
    that can occur, px. The result has the nodes `settings.step` px apart from the first pixel on.

    Raises PhotoError for unreadable files, ValueError for arrays that do not fit together.
    """
    with opencv_on_one_thread():
        return match_pair(_grey(left), _grey(right), low, high, settings)


def _grey(image: np.ndarray | str | Path) -> np.ndarray:
    pixels = image if isinstance(image, np.ndarray) else read_photograph(image)
    return grey(pixels) if pixels.ndim == 3 else pixels
