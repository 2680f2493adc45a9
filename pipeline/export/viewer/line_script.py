"""Contours or edges as a script that hands them to the page, as far as a browser still draws them."""

import json
from pathlib import Path

import numpy as np

from orthomill.pipeline.export.vectors.map_features import line_features
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.job import Export
from orthomill.schemas.maps.map_lines import MapLines

MOST_VERTICES = 1_500_000
"""of lines that a browser still draws; more are left to a GIS"""


def write_lines(export: Export, store: ReadableStore, path: Path) -> None:
    """Write the lines of the export's tables under the name of the file; an empty one where there are none or too many."""
    drawn = _drawn(export, store)
    if not drawn:
        return write_whole(path, b"")
    west, south = (float(np.floor(min(getattr(table, name).min() for table in drawn))) for name in ("x", "y"))
    rows = []
    for feature in (feature for table in drawn for feature in line_features(table)):
        # Whole centimetres from a corner, one after the other: half the size of coordinates in full.
        centimetres = np.rint((feature.places[:, :2] - (west, south)) * 100).astype(np.int64)
        steps = np.diff(centimetres, axis=0, prepend=np.zeros((1, 2), np.int64)).ravel().tolist()
        rows.append([round(float(feature.places[0, 2]), 3), int(feature.dashed), feature.text, steps])
    write_whole(path, f"omLines('{path.stem}',{west},{south},{json.dumps(rows, separators=(',', ':'))});\n".encode())


def _drawn(export: Export, store: ReadableStore) -> list[MapLines]:
    """The tables that have lines; none where all together have too many, which is seen before all are read."""
    drawn: list[MapLines] = []
    for table in export.tables:
        lines = store.table(table)
        if isinstance(lines, MapLines) and len(lines):
            drawn.append(lines)
        if sum(map(len, drawn)) > MOST_VERTICES:
            return []
    return drawn
