"""Sheets, of a product or of an export, and their index: outlines with name and file, for the client's GIS."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orthomill.pipeline.export.vectors.geopackage import write_geopackage
from orthomill.pipeline.export.vectors.map_features import Feature, Layer

Bounds = tuple[float, float, float, float]
"""west, south, east, north"""


@dataclass(frozen=True)
class Sheet:
    """A sheet by its name, in the system of the file."""

    name: str
    area: Bounds


def write_sheet_index(path: Path, sheets: Sequence[Sheet], ending: str, crs: str | None) -> None:
    """A GeoPackage of the sheets in the system `crs` (None: a plane of its own)."""
    features = tuple(Feature(_ring(sheet), {"name": sheet.name, "file": f"{sheet.name}{ending}"}) for sheet in sheets)
    write_geopackage(path, (Layer("sheets", "area", features),), crs)


def _ring(sheet: Sheet) -> np.ndarray:
    west, south, east, north = sheet.area
    return np.array([[west, south, 0], [east, south, 0], [east, north, 0], [west, north, 0], [west, south, 0]], np.float64)
