"""Interest points evenly over an image: the strongest of every cell of a grid, or of the six places of von Gruber.

Strategy: weakly textured fields must contribute points as well as richly textured roofs, or an orientation rests on the roofs
alone. Cells lie on an absolute grid, so that the choice does not depend on tiles.

Source: Karfis 2009 (sources/epipolar.md#interest-points: points must be well distributed); von Gruber 1924.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from orthomill.schemas.raster import Window
from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.matching.points.interest_points import InterestPoints


class GridDistribution(Settings):
    """The strongest points of every cell."""

    kind: Literal["grid"] = "grid"
    cell: int = setting(100, "Side of a cell.", "px", ge=1)
    per_cell: int = setting(1, "Points that a cell may have.", ge=1)


class GruberDistribution(Settings):
    """The strongest points of six squares: at both ends of the overlap, at its upper edge, its middle and its lower edge."""

    kind: Literal["gruber"] = "gruber"
    side: int = setting(400, "Side of a square.", "px", ge=1)
    per_area: int = setting(20, "Points that a square may have.", ge=1)


Distribution = Annotated[GridDistribution | GruberDistribution, Field(discriminator="kind")]


def distributed(points: InterestPoints, overlap: Window, distribution: GridDistribution | GruberDistribution) -> InterestPoints:
    """The chosen points, in their order. overlap: the part of the image that the other photograph shows too."""
    inside = np.flatnonzero(_inside(points, overlap))
    found = points.take(inside)
    if isinstance(distribution, GridDistribution):
        cells = np.column_stack([np.floor(found.row / distribution.cell), np.floor(found.col / distribution.cell)])
        return found.take(_strongest(found, cells, distribution.per_cell))
    areas = gruber_areas(overlap, distribution.side)
    number = np.full(len(found), len(areas))
    # In reverse, so that a point in two overlapping squares belongs to the first of them.
    for index, area in reversed(list(enumerate(areas))):
        number[_inside(found, area)] = index
    chosen = _strongest(found, number[:, None], distribution.per_area)
    return found.take(chosen[number[chosen] < len(areas)])


def gruber_areas(overlap: Window, side: int) -> tuple[Window, ...]:
    """The six squares of `side` px inside an overlap, smaller where they would cross; upper left first, row by row."""
    # The six squares never overlap: at most a third of the height and half of the width.
    height, width = min(side, overlap.height // 3), min(side, overlap.width // 2)
    rows = (overlap.row, overlap.row + (overlap.height - height) // 2, overlap.row + overlap.height - height)
    cols = (overlap.col, overlap.col + overlap.width - width)
    return tuple(Window(row, col, height, width) for row in rows for col in cols)


def _inside(points: InterestPoints, window: Window) -> np.ndarray:
    """(N,) bool: the nearest pixel lies in the window."""
    row, col = np.floor(points.row + 0.5), np.floor(points.col + 0.5)
    return (row >= window.row) & (row < window.row + window.height) & (col >= window.col) & (col < window.col + window.width)


def _strongest(points: InterestPoints, cells: np.ndarray, count: int) -> np.ndarray:
    """Rows, rising, of the `count` strongest points of each cell; cells: (N, k), one row of numbers names a cell."""
    # Row and column break ties of equal strength, so that the choice does not depend on the order of the points.
    order = np.lexsort((points.col, points.row, -points.strength, *cells.T))
    begins = np.ones(len(order), dtype=bool)
    begins[1:] = (np.diff(cells[order], axis=0) != 0).any(axis=1)
    starts = np.flatnonzero(begins)
    rank = np.arange(len(order)) - np.repeat(starts, np.diff(np.append(starts, len(order))))
    return np.sort(order[rank < count])
