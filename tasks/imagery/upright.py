"""The EXIF orientation: its flag, which window of the file holds a window of the upright photograph, and the rotation itself.

Flags 1 to 4 keep rows as rows, 5 to 8 exchange rows and columns (EXIF 2.3, tag 0x0112).
"""

from collections.abc import Mapping

import numpy as np

from orthomill.schemas.photo import tag_text
from orthomill.schemas.raster import Window


def exif_orientation(tags: Mapping[str, str]) -> int:
    """The EXIF orientation flag, 1 to 8; 1 (upright) when the tag is absent or holds no such number."""
    text = tag_text(tags, "Orientation")
    return int(text) if text in {"1", "2", "3", "4", "5", "6", "7", "8"} else 1


def turned(orientation: int) -> bool:
    """Whether rows of the upright photograph are columns of the file."""
    return orientation >= 5


def upright_shape(orientation: int, height: int, width: int) -> tuple[int, int]:
    """Rows and columns of the upright photograph of a file of `height` x `width`."""
    return (width, height) if turned(orientation) else (height, width)


def upright(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """Pixels of the file (rows, cols, bands) rotated and mirrored upright."""
    # Rows and columns are exchanged first: `_reversals` speaks of the axes of the upright photograph.
    if turned(orientation):
        pixels = pixels.swapaxes(0, 1)
    rows_back, cols_back = _reversals(orientation)
    return np.ascontiguousarray(pixels[:: -1 if rows_back else 1, :: -1 if cols_back else 1])


def from_upright(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """Pixels of the upright photograph (rows, cols, bands) as its file has them."""
    # The two quarter turns undo each other; each of the others undoes itself.
    return upright(pixels, {6: 8, 8: 6}.get(orientation, orientation))


def file_window(window: Window, orientation: int, height: int, width: int) -> Window:
    """Where `window` of the upright photograph lies in its file of `height` x `width`."""
    rows, cols = upright_shape(orientation, height, width)
    rows_back, cols_back = _reversals(orientation)
    row = rows - window.row - window.height if rows_back else window.row
    col = cols - window.col - window.width if cols_back else window.col
    if turned(orientation):
        return Window(col, row, window.width, window.height)
    return Window(row, col, window.height, window.width)


def _reversals(orientation: int) -> tuple[bool, bool]:
    """Whether rows and columns are reversed, after their exchange."""
    return orientation in (3, 4, 7, 8), orientation in (2, 3, 6, 7)
