"""Heights, standard errors and codes as scripts, from which the map tells what is at a place.

A browser reads no files from the disk, but it runs scripts from there: every tile is one, and holds whole millimetres, packed.
Along a row only differences are stored, which packs twice as small.
"""

import base64
import json
import zlib
from pathlib import Path

import numpy as np

from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.maps.map_page import ValueLayer
from orthomill.schemas.raster import RasterSpec, tiles_of

SIZE = 256
"""cells along a tile"""
NOTHING = -(2**31)
"""in place of a value"""
MILLIMETRES = 1000
EFFORT = 1
"""of packing: more would pack a tenth smaller, in eight times the time"""


def write_values(folder: Path, store: ReadableStore, layers: tuple[ValueLayer, ...], grid: RasterSpec) -> list[tuple[int, int]]:
    """The tiles of all layers, on one grid; rows and columns of those that hold a value."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for tile in tiles_of(grid.shape, SIZE):
        parts, holds = {}, False
        for layer in layers:
            for key, name in layer.rasters.items():
                values = store.read(name, tile.window)
                holds |= bool(np.isfinite(values).any()) if values.dtype.kind == "f" else bool(values.any())
                parts[f"{layer.name}.{key}"] = packed(values)
        if holds:
            text = f"omValues({json.dumps(f'{tile.row}-{tile.col}')},{tile.window.width},{json.dumps(parts)});\n"
            (folder / f"{tile.row}-{tile.col}.js").write_text(text)
            written.append((tile.row, tile.col))
    return written


def packed(values: np.ndarray) -> str:
    """Heights (rows, cols) in millimetres, or codes as they are: differences along the rows as 32-bit integers, deflated, as
    text."""
    if values.dtype.kind == "f":
        known = np.isfinite(values)
        whole = np.where(known, np.rint(np.where(known, values, 0).astype(np.float64) * MILLIMETRES), NOTHING)
    else:
        whole = values
    numbers = whole.astype(np.int64).astype(np.int32)
    with np.errstate(over="ignore"):
        differences = np.diff(numbers, axis=1, prepend=np.int32(0)).astype("<i4")
    return base64.b64encode(zlib.compress(differences.tobytes(), EFFORT)).decode()
