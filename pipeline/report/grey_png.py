"""A greyscale PNG that is written row by row, so that a picture of any size takes the memory of a strip.

Imaging libraries need the whole picture before they write it. The format is simple enough to be written incrementally: a header,
the rows compressed in pieces, and an end chunk. The file appears under its name when it is complete, and not before.

Source: W3C, Portable Network Graphics (third edition), 5 and 11.
"""

import os
import struct
import zlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY_8_BITS = (8, 0, 0, 0, 0)
"""bit depth, colour type, compression, filter, no interlace"""


def write_grey_png(path: Path, shape: tuple[int, int], strips: Iterable[np.ndarray]) -> None:
    """Write strips (rows, cols) uint8, from top to bottom, as a picture of `shape` (rows, cols). Raises OSError."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with open(temporary, "wb") as file:
            file.write(_SIGNATURE + _chunk(b"IHDR", struct.pack(">II5B", shape[1], shape[0], *_GREY_8_BITS)))
            deflate = zlib.compressobj()
            for strip in strips:
                unfiltered = np.zeros((strip.shape[0], shape[1] + 1), np.uint8)  # every row begins with its filter type, 0: none
                unfiltered[:, 1:] = strip
                file.write(_chunk(b"IDAT", deflate.compress(unfiltered.data)))
            file.write(_chunk(b"IDAT", deflate.flush()) + _chunk(b"IEND", b""))
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
