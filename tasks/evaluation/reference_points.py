"""Points of known height as a reference: from a table of text or from a point cloud, with their standard errors.

A table has a line with the names of its columns (x, y, z, and a standard error of the height where there is one), or x, y, z and
perhaps that error alone, with or without a name before them.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Columns
from orthomill.schemas.solid.mesh import TriangleMesh
from orthomill.schemas.survey_files.sniffed_table import Lines, lines_of, separation
from orthomill.schemas.survey_files.table_heads import Numbered, possible_heads

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
    return ReferencePoints(*table[:, :3].T.copy(), own)


def points_of_cloud(cloud: TriangleMesh, sigma: float) -> ReferencePoints:
    """The points of a point cloud, all with the standard error `sigma`, m."""
    x, y, z = (cloud.vertices + np.array(cloud.origin)).astype(np.float64).T.copy()
    return ReferencePoints(x, y, z, np.full(len(x), sigma))


def _with_head(lines: Lines) -> list[tuple[float, ...]]:
    """(x, y, z, standard error or NaN) below the names of columns; none without such names."""
    for head in possible_heads(lines):
        meanings = [column.meaning for column in head.columns]
        if not {"x", "y", "z"} <= set(meanings):
            continue
        wanted = [meanings.index(axis) for axis in "xyz"]
        own = next((meanings.index(name) for name in _SIGMAS if name in meanings), None)
        units = [head.columns[place].unit for place in (*wanted, *(() if own is None else (own,)))]
        found = []
        for cells in _cells(head.separation.cells(line) for _, line in head.data):
            numbers = [head.separation.number(cells[k]) if k < len(cells) else None for k in (*wanted, *([own] if own else []))]
            known = [None if value is None else unit * value for value, unit in zip(numbers, units, strict=True)]
            if all(value is not None and np.isfinite(value) for value in known[:3]):
                found.append((*known[:3], known[3] if own and known[3] is not None else np.nan))
        if found:
            return found
    return []


def _without_head(lines: Lines) -> list[tuple[float, ...]]:
    data: Numbered = lines.others
    sign, found = separation([line for _, line in data]), []
    for cells in _cells(sign.cells(line) for _, line in data):
        numbers = [sign.number(cell) for cell in cells]
        # A name that is a number is told from x by the number of columns: x, y, z, or name, x, y, z, or with a standard error.
        values = numbers[1:] if numbers[0] is None or len(numbers) > 4 else numbers
        if len(values) in (3, 4) and all(value is not None for value in values):
            found.append((*values, *([np.nan] * (4 - len(values)))))
    return found


def _cells(rows: Iterator[tuple[str, ...]]) -> Iterator[tuple[str, ...]]:
    return (cells for cells in rows if cells)
