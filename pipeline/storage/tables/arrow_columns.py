"""Columns as arrow's arrays and back, by their buffers: numbers, truth values, names, and long rows of bytes.

pyarrow's own ways between numpy and arrow import pandas where it is installed: 40 MiB and half a second of every process that reads
or writes a table, for nothing that is used here.
"""

import numpy as np
import pyarrow as pa

from orthomill.schemas.memory import MIB

PIECE = MIB
"""bytes of one binary value: to write a value takes eight times its size"""


def arrow_of(column: np.ndarray) -> pa.Array:
    """A column (N,) of numbers, truth values or texts."""
    if column.dtype.kind not in "iufb":
        return _texts(column)
    if column.dtype.kind == "b":
        content, kind = np.packbits(column, bitorder="little"), pa.bool_()
    else:
        content, kind = np.ascontiguousarray(column, column.dtype.newbyteorder("=")), pa.from_numpy_dtype(column.dtype)
    return pa.Array.from_buffers(kind, len(column), [None, pa.py_buffer(content)])


def _texts(column: np.ndarray) -> pa.Array:
    texts = [str(text).encode() for text in column]
    offsets = np.concatenate(([0], np.cumsum([len(text) for text in texts], dtype=np.int64))).astype(np.int32)
    return pa.Array.from_buffers(pa.string(), len(texts), [None, pa.py_buffer(offsets), pa.py_buffer(b"".join(texts))])


def arrow_of_bytes(column: np.ndarray) -> pa.Array:
    """A column of bytes as binary values of `PIECE` bytes, the last one shorter."""
    count = max(-(-column.size // PIECE), 1)
    offsets = np.minimum(PIECE * np.arange(count + 1, dtype=np.int64), column.size)
    data = pa.py_buffer(np.ascontiguousarray(column))
    return pa.Array.from_buffers(pa.large_binary(), count, [None, pa.py_buffer(offsets), data])


def numpy_of(column: pa.ChunkedArray) -> np.ndarray:
    """What such an array holds, numbers in one piece read-only, texts as objects. Raises ValueError where a value is missing."""
    if column.null_count:
        raise ValueError("a column with missing values")
    parts = [_part(chunk) for chunk in column.chunks] or [_part(pa.nulls(0, column.type))]
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _part(chunk: pa.Array) -> np.ndarray:
    buffers, kind = chunk.buffers(), chunk.type
    if pa.types.is_large_binary(kind):
        return _bytes(chunk)
    if pa.types.is_string(kind):
        return np.array([*chunk.to_pylist(), None], object)[:-1]
    if len(chunk) == 0 or buffers[1] is None:
        return np.zeros(0, kind.to_pandas_dtype())
    if pa.types.is_boolean(kind):
        bits = np.unpackbits(np.frombuffer(buffers[1], np.uint8), count=chunk.offset + len(chunk), bitorder="little")
        return bits[chunk.offset :].astype(bool)
    return np.frombuffer(buffers[1], kind.to_pandas_dtype(), len(chunk), chunk.offset * kind.bit_width // 8)


def _bytes(chunk: pa.Array) -> np.ndarray:
    _, offsets, data = chunk.buffers()
    ends = np.frombuffer(offsets, np.int64)[[chunk.offset, chunk.offset + len(chunk)]]
    return np.frombuffer(data, np.uint8)[ends[0] : ends[1]] if data is not None else np.zeros(0, np.uint8)
