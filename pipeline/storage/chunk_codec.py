"""A chunk of a raster as bytes and back: little-endian values, packed by Blosc, ended by a CRC-32C.

zarr is the format, and everybody's way in; what is written here is its file byte for byte. zarr's own road to it leads through the
event loop of another thread three times a chunk, which took most of the time of a small job.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

_CRC_BYTES = 4
_KEYS = {"name": "default", "configuration": {"separator": "/"}}
"""How zarr names the files of chunks: `c/ROW/COLUMN`, with a `/0` for all bands together."""
_SHUFFLES = {"noshuffle": 0, "shuffle": 1, "bitshuffle": 2}


class UnknownCodec(ValueError):
    """The metadata of an array name a way to store chunks that is none of this program."""


@dataclass(frozen=True)
class ChunkCodec:
    """How the chunks of an array are stored, as its metadata in zarr's format say."""

    shape: tuple[int, ...]
    """of a chunk; those at the lower and right border are stored whole as well"""
    dtype: np.dtype
    fill: np.generic
    """the value of what was never written"""
    packing: tuple[tuple[str, Any], ...]
    """configuration of Blosc"""

    @staticmethod
    def of(metadata: dict[str, Any]) -> "ChunkCodec":
        """From the metadata of an array. Raises UnknownCodec."""
        dtype = np.dtype(metadata["data_type"]).newbyteorder("<")
        codecs = [codec["name"] for codec in metadata["codecs"]]
        endian = metadata["codecs"][0].get("configuration", {}).get("endian", "little")
        if codecs != ["bytes", "blosc", "crc32c"] or endian != "little" or metadata["chunk_key_encoding"] != _KEYS:
            raise UnknownCodec(f"its chunks are stored as {', '.join(codecs)}")
        packing = metadata["codecs"][1]["configuration"]
        fill = dtype.type(float(metadata["fill_value"]) if dtype.kind == "f" else metadata["fill_value"])
        shape = tuple(metadata["chunk_grid"]["configuration"]["chunk_shape"])
        return ChunkCodec(shape, dtype, fill, tuple(packing.items()))

    def encode(self, values: np.ndarray) -> bytes | None:
        """The file of a chunk whose upper-left part has these values; None for nothing but the fill value, which has no file."""
        chunk = values.astype(self.dtype, order="C", copy=False)
        if values.shape != self.shape:
            chunk = np.full(self.shape, self.fill, self.dtype)
            chunk[tuple(map(slice, values.shape))] = values
        if self._only_fill(chunk):
            return None
        import google_crc32c

        with _one_thread():
            packed = self._blosc.encode(np.ascontiguousarray(chunk).reshape(-1).view("B"))
        return packed + google_crc32c.value(packed).to_bytes(_CRC_BYTES, "little")

    def decode(self, content: bytes) -> np.ndarray:
        """The values of a chunk, read-only. Raises ValueError, RuntimeError where the content is damaged."""
        import google_crc32c

        packed = content[:-_CRC_BYTES]
        if google_crc32c.value(packed).to_bytes(_CRC_BYTES, "little") != content[-_CRC_BYTES:]:
            raise ValueError("wrong checksum")
        with _one_thread():
            return np.frombuffer(self._blosc.decode(packed), self.dtype).reshape(self.shape)

    def _only_fill(self, chunk: np.ndarray) -> bool:
        if self.dtype.kind == "f" and self.fill == 0:  # by their bits: a zero with another sign is another value
            bits = f"u{self.dtype.itemsize}"
            return bool((chunk.view(bits) == self.fill.view(bits)).all())
        return np.array_equal(chunk, np.broadcast_to(self.fill, chunk.shape), equal_nan=True)

    @cached_property
    def _blosc(self) -> Any:
        from numcodecs.blosc import Blosc

        packing = dict(self.packing)
        return Blosc(**packing | {"shuffle": _SHUFFLES[packing["shuffle"]]})


@contextmanager
def _one_thread() -> Iterator[None]:
    """Blosc works on one thread inside: on several it writes its blocks in the order in which they happen to be done."""
    from numcodecs import blosc

    before, blosc.use_threads = blosc.use_threads, False
    try:
        yield
    finally:
        blosc.use_threads = before
