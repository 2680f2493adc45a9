"""Points of known height as a reference: from a table of text or from a point cloud, with their standard errors.

A table has a line with the names of its columns (x, y, z, and a standard error of the height where there is one), or x, y, z and
perhaps that error alone, with or without a name before them.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Columns
from orthomill.schemas.solid.cloud_points import CloudPoints
from orthomill.schemas.solid.mesh import TriangleMesh
from orthomill.schemas.survey_files.sniffed_table import Lines, lines_of, separation
from orthomill.schemas.survey_files.table_heads import Numbered, possible_heads

_Row = tuple[float, float, float, float]
"""x, y, z, and the standard error or NaN"""
_SIGMAS = ("sigma_z", "sigma_all", "sigma")
"""meanings of the columns that hold the standard error of a height, the best first"""


@dataclass(frozen=True)
class ReferencePoints(Columns):
    """Points in the project's system, m, and the standard errors of their heights."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    """float64"""
    sigma: np.ndarray
    """float64 m; 0: free of error"""


def points_of_table(text: str, path: str, sigma: float) -> ReferencePoints:
    """The points of a table; `sigma` (m) where it states none. Raises WorkflowError for a text that is none."""
    lines = lines_of(text)
    rows = _with_head(lines) or _without_head(lines)
    if not rows:
        raise WorkflowError(
            f"{path} holds no points with heights that can be read; it needs the columns x, y and z, in the project's system, and "
            "may have sigma_z."
        )
    table = np.array(rows, dtype=np.float64)
    own = np.where(np.isfinite(table[:, 3]), table[:, 3], sigma)
    if (own < 0).any():
        raise WorkflowError(f"{path} holds standard errors below zero; give them in metres, or leave the column out.")
    x, y, z = table[:, :3].T.copy()
    return ReferencePoints(x, y, z, own)


def points_of_cloud(cloud: CloudPoints, sigma: float) -> ReferencePoints:
    """The points of a point cloud; `sigma` (m) where it states none."""
    return ReferencePoints(cloud.x, cloud.y, cloud.z, np.where(np.isfinite(cloud.sigma), cloud.sigma, sigma))


def points_of_mesh(cloud: TriangleMesh, sigma: float) -> ReferencePoints:
    """The vertices of a mesh in the project's system, all with the standard error `sigma`, m."""
    x, y, z = (cloud.vertices + np.array(cloud.origin)).astype(np.float64).T.copy()
    return ReferencePoints(x, y, z, np.full(len(x), sigma))


def _with_head(lines: Lines) -> list[_Row]:
    """The points below the names of columns; none without such names."""
    for head in possible_heads(lines):
        meanings = [column.meaning for column in head.columns]
        if not {"x", "y", "z"} <= set(meanings):
            continue
        places = [meanings.index(axis) for axis in "xyz"]
        places += [meanings.index(name) for name in _SIGMAS if name in meanings][:1]
        units = [head.columns[place].unit for place in places]
        found = []
        for cells in _cells(head.separation.cells(line) for _, line in head.data):
            numbers = [head.separation.number(cells[k]) if k < len(cells) else None for k in places]
            found += _rows([np.nan if n is None else unit * n for n, unit in zip(numbers, units, strict=True)])
        if found:
            return found
    return []


def _without_head(lines: Lines) -> list[_Row]:
    data: Numbered = lines.others
    sign, found = separation([line for _, line in data]), []
    for cells in _cells(sign.cells(line) for _, line in data):
        numbers = [sign.number(cell) for cell in cells]
        # A name that is a number is told from x by the number of columns: x, y, z, or name, x, y, z, or with a standard error.
        values = numbers[1:] if numbers[0] is None or len(numbers) > 4 else numbers
        if len(values) in (3, 4) and None not in values:
            found += _rows([np.nan if value is None else value for value in values])
    return found


def _rows(values: list[float]) -> list[_Row]:
    """One row of x, y, z and, where there is one, a standard error; none where a coordinate is not known."""
    x, y, z, sigma = (*values, np.nan)[:4]
    return [(x, y, z, sigma)] if np.isfinite([x, y, z]).all() else []


def _cells(rows: Iterator[tuple[str, ...]]) -> Iterator[tuple[str, ...]]:
    return (cells for cells in rows if cells)
