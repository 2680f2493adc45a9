"""Image points from a text file to points on the surface of a finished run, as a table.

The catalogue provides the method; this file knows files, lines and columns.
"""

import csv
import io
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import StoreError, WorkflowError
from orthomill.schemas.inspections.inspection import SurfacePoint
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.raster import MapGrid
from orthomill.schemas.surface import HEIGHT, PRECISION, SURFACE

OnSurface = Callable[[Block, str, np.ndarray, MapGrid, np.ndarray, np.ndarray, float], Sequence[SurfacePoint | None]]
_COLUMNS = ("name", "col", "row", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z", "cov_xy", "cov_xz", "cov_yz", "photographs")
_HEADERS = {"name", "point", "id", "col", "column", "x", "u"}
"""first words of a line of headings"""


@dataclass(frozen=True)
class ImagePoints:
    """Points of a file: their names and (N, 2) (col, row), px."""

    names: tuple[str, ...]
    pixels: np.ndarray


@dataclass(frozen=True)
class SurfaceTable:
    """The answer as CSV, the number of points in it, and a sentence for every point that hits nothing."""

    csv: str
    count: int
    missed: tuple[str, ...]


def read_image_points(path: Path) -> ImagePoints:
    """Points of a text file, "col row" or "name col row" on a line, separated by blanks, commas or semicolons.

    Raises WorkflowError with file and line for what cannot be read.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise WorkflowError(f"The points {path} cannot be read; give a text file with col and row of a point on a line.") from error
    names: list[str] = []
    pixels: list[tuple[float, float]] = []
    for number, line in enumerate(lines, start=1):
        words = [word for word in re.split(r"[,;\s]+", line.strip()) if word]
        if not words or words[0].startswith("#") or (not pixels and words[0].lower() in _HEADERS):
            continue
        pixels.append(_place(words, f"{path}, line {number}"))
        names.append(words[0] if len(words) > 2 else str(len(pixels)))
    if not pixels:
        raise WorkflowError(f"{path} holds no point; write col and row of a point on a line, px, perhaps with a name before them.")
    return ImagePoints(tuple(names), np.array(pixels))


def _place(words: list[str], where: str) -> tuple[float, float]:
    try:
        col, row = (float(word) for word in words[-2:])
    except ValueError:
        col = row = math.nan
    if len(words) not in (2, 3) or not (math.isfinite(col) and math.isfinite(row)):
        raise WorkflowError(f"{where}: '{' '.join(words)}' is no point; write col and row, px, perhaps with a name before them.")
    return col, row


def monoplot_table(folder: Path, photo: str, points: ImagePoints, sigma: float, on_surface: OnSurface) -> SurfaceTable:
    """The points of a photograph on the surface of a run. Raises StoreError before the run has a surface."""
    store = Store(folder)
    if not (store.has_table(BLOCK) and store.has_table(SURFACE) and store.has(HEIGHT)):
        raise StoreError(f"{folder.name} has no surface yet; run it first: orthomill run {folder.name} --until densification")
    grid, whole = store.table(SURFACE).grid, store.spec(HEIGHT).full
    found = on_surface(
        store.table(BLOCK), photo, points.pixels, grid, store.read(HEIGHT, whole), store.read(PRECISION, whole), sigma
    )
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(_COLUMNS)
    missed = []
    for name, (col, row), point in zip(points.names, points.pixels, found, strict=True):
        if point is None:
            missed.append(
                f"{name} ({col:g}, {row:g}) hits nothing: it lies outside the photograph {photo}, or its ray meets no height of "
                "the surface; measure it in another photograph."
            )
        writer.writerow([name, f"{col:g}", f"{row:g}", *_values(point)])
    return SurfaceTable(out.getvalue(), len(found), tuple(missed))


def _values(point: SurfacePoint | None) -> list[str]:
    if point is None:
        return [""] * (len(_COLUMNS) - 3)
    c = point.covariance
    sigmas = (math.sqrt(max(c[k][k], 0.0)) for k in range(3))
    numbers = [*(f"{value:.3f}" for value in point.place), *(f"{value:.3f}" for value in sigmas)]
    return [*numbers, *(f"{value:.3e}" for value in (c[0][1], c[0][2], c[1][2])), " ".join(point.photos)]
