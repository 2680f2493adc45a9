"""Medians and middles of values that are known by the counts of their classes only."""

import numpy as np

from orthomill.tasks.densification.line_locus.locus_block import CORRELATION_CLASSES
from orthomill.tasks.densification.matching_block import PRECISION_EDGES
from orthomill.tasks.densification.surface_tile import CLASSES


def median_of(counts: tuple[int, ...], edges: np.ndarray) -> float | None:
    """Median of values that are known by classes only, linear within the class."""
    # Medians of tiles cannot be combined; counts by class can, whatever the number of tiles and their order.
    total = sum(counts)
    return float(np.interp(total / 2, np.concatenate([[0], np.cumsum(counts)]), edges)) if total else None


def median_parallax_error(counts: tuple[int, ...]) -> float | None:
    """Median standard error of the parallaxes, px."""
    return median_of(counts, np.array(PRECISION_EDGES))


def median_height_error(counts: tuple[int, ...], cell: float) -> float | None:
    """Median standard error of the heights of cells of `cell` m, m."""
    return median_of(counts, _cell_edges(cell))


def median_correlation(counts: tuple[int, ...]) -> float | None:
    """Median absolute correlation of the nodes of lines."""
    return median_of(counts, np.linspace(0.0, 1.0, CORRELATION_CLASSES + 1))


def median_tie_distance(counts: tuple[int, ...], width: float) -> float | None:
    """Median distance of the tie points from the surface, m; width: of a class, m."""
    return median_of(counts, np.arange(len(counts) + 1) * width)


def height_error_middles(cell: float) -> tuple[float, ...]:
    """Middles of the classes of standard errors of heights, m."""
    edges = _cell_edges(cell)
    return tuple(np.round((edges[:-1] + edges[1:]) / 2, 4).tolist())


def _cell_edges(cell: float) -> np.ndarray:
    return np.arange(CLASSES + 1) * 0.1 * cell
