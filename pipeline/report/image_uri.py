"""Small images as data URIs, embedded in the page: JPEG for photographs and relief, PNG with a palette for maps.

With a palette the colours of a map are exactly those of its legend, in a third of the bytes of a full-colour PNG.
"""

import base64
import struct
import zlib

import cv2
import numpy as np


def _uri(kind: str, data: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def jpeg_uri(colours: np.ndarray) -> str:
    """Colours (rows, cols, 3) uint8, red green blue, as JPEG."""
    # Quality 87: artefacts stay invisible at the size of the report, at half the bytes of quality 95. OpenCV takes blue first.
    data = cv2.imencode(".jpg", np.ascontiguousarray(colours[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 87])[1]
    return _uri("jpeg", data.tobytes())


def png_uri(index: np.ndarray, table: np.ndarray) -> str:
    """Colour numbers (rows, cols) uint8 into `table` (n, 3) uint8, n at most 256, as PNG (colour type 3, no filter)."""
    rows, cols = index.shape
    lines = np.concatenate([np.zeros((rows, 1), np.uint8), index], axis=1).tobytes()
    header = struct.pack(">IIBBBBB", cols, rows, 8, 3, 0, 0, 0)
    parts = ((b"IHDR", header), (b"PLTE", table.astype(np.uint8).tobytes()), (b"IDAT", zlib.compress(lines, 9)), (b"IEND", b""))
    return _uri("png", b"\x89PNG\r\n\x1a\n" + b"".join(_png_chunk(kind, data) for kind, data in parts))


def _png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
