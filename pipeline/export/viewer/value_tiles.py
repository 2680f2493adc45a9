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
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.job import Export
from orthomill.schemas.maps.map_parts import WrittenTiles
from orthomill.schemas.raster import Window, tiles_of

SIZE = 256
"""cells along a tile"""
NOTHING = -(2**31)
"""in place of a value"""
MILLIMETRES = 1000
EFFORT = 1
"""of packing: more would pack a tenth smaller, in eight times the time"""


def write_values(export: Export, store: ReadableStore, path: Path) -> None:
    """The tiles of a part that hold a value, beside the folder of `path`, and their names. The rasters of the export are those of
    `ValueLayer`s, as LAYER.KEY."""
    assert export.window is not None, "a part"
    written = []
    for tile in tiles_of(export.window.shape, SIZE):
        row, col = (export.window.row + tile.window.row) // SIZE, (export.window.col + tile.window.col) // SIZE
        window = Window(row * SIZE, col * SIZE, tile.window.height, tile.window.width)
        values = {key: store.read(name, window) for key, name in export.rasters.items()}
        if any(map(_holds, values.values())):
            written.append(name := f"{row}-{col}.js")
            parts = {key: packed(one) for key, one in values.items()}
            text = f"omValues({json.dumps(f'{row}-{col}')},{window.width},{json.dumps(parts)});\n"
            (path.parents[1] / name).write_text(text)
    write_whole(path, WrittenTiles(names={0: tuple(written)}).model_dump_json().encode())


def _holds(values: np.ndarray) -> bool:
    return bool(np.isfinite(values).any()) if values.dtype.kind == "f" else bool(values.any())


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
