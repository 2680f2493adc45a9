"""The index of the sheets of an export: their outlines with name and file, for the client's GIS."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from orthomill.pipeline.export.conversions.map_sheets import Sheet
from orthomill.pipeline.export.vectors.geopackage import write_geopackage
from orthomill.pipeline.export.vectors.map_features import Feature, Layer


def write_sheet_index(path: Path, sheets: Sequence[Sheet], ending: str, crs: str | None) -> None:
    """A GeoPackage of the sheets in the system `crs` (None: a plane of its own)."""
    features = tuple(Feature(_ring(sheet), {"name": sheet.name, "file": f"{sheet.name}{ending}"}) for sheet in sheets)
    write_geopackage(path, (Layer("sheets", "area", features),), crs)


def _ring(sheet: Sheet) -> np.ndarray:
    west, south, east, north = sheet.area
    return np.array([[west, south, 0], [east, south, 0], [east, north, 0], [west, north, 0], [west, south, 0]], np.float64)
