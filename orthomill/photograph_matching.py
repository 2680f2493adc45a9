"""Matching of points in two photographs without a project."""

from pathlib import Path

import numpy as np

from orthomill.pipeline.storage.image_files import read_header, read_pixels
from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.radiometry import grey
from orthomill.tasks.imagery.upright import exif_orientation, upright
from orthomill.tasks.matching.least_squares.matching import Matches, match_points
from orthomill.tasks.matching.least_squares.model import LeastSquaresMatching


def read_photograph(path: str | Path) -> np.ndarray:
    """Pixels (rows, cols, bands) of a JPEG, TIFF or PNG, upright as EXIF says, in the file's own type. Raises PhotoError."""
    header = read_header(Path(path))
    pixels = read_pixels(Path(path), Window(0, 0, header.height, header.width))
    return upright(pixels[:, :, : header.bands], exif_orientation(header.tags))


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
    return match_points(_grey(left), _grey(right), points, starts, settings or LeastSquaresMatching())


def _grey(image: np.ndarray | str | Path) -> np.ndarray:
    pixels = image if isinstance(image, np.ndarray) else read_photograph(image)
    return grey(pixels) if pixels.ndim == 3 else pixels
