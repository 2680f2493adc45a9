"""Lines on the map with their attributes, as tables: what maps and drawings are made of."""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.job import Columns


@dataclass(frozen=True)
class MapLines(Columns):
    """One row for every vertex, line after line. Subclasses add attributes of the lines, one value at each of their vertices."""

    line: np.ndarray
    """int64: number of the line, ascending from 0"""
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    """float64 m"""
    layer: np.ndarray
    """str: the layer of a drawing that the line belongs to"""
    dashed: np.ndarray
    """bool: whether it is drawn dashed"""
    text: np.ndarray
    """str: what is written along it, "" for nothing"""
