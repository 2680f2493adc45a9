"""The codecs of a chunk called one after the other, without a thread and tasks for each of them.

zarr asks a thread of a pool to decode each chunk, and starts a task for every codec of its chain, so that chunks from afar are
decoded while others are fetched. A worker has one thread for its jobs, and its chunks on a disk: there that costs as much as the
decoding.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import zarr
from zarr.abc.codec import SupportsSyncCodec
from zarr.core.codec_pipeline import BatchedCodecPipeline
from zarr.registry import register_pipeline


@dataclass(frozen=True)
class DirectCodecs(BatchedCodecPipeline):
    """A chain of codecs; where one of them cannot be called directly, all go zarr's own way."""

    @property
    def _direct(self) -> bool:
        return all(isinstance(codec, SupportsSyncCodec) for codec in self)

    async def decode_batch(self, chunk_bytes_and_specs: Iterable[tuple[Any, Any]]) -> Iterable[Any]:
        """Arrays of chunks; None where a chunk is not there."""
        if not self._direct:
            return await super().decode_batch(chunk_bytes_and_specs)
        return [self._decoded(chunk, spec) for chunk, spec in chunk_bytes_and_specs]

    async def encode_batch(self, chunk_arrays_and_specs: Iterable[tuple[Any, Any]]) -> Iterable[Any]:
        """Bytes of chunks; None where a chunk is nothing but its fill value."""
        if not self._direct:
            return await super().encode_batch(chunk_arrays_and_specs)
        return [self._encoded(chunk, spec) for chunk, spec in chunk_arrays_and_specs]

    def _decoded(self, chunk: Any, spec: Any) -> Any:
        chain: list[tuple[Any, Any]] = []
        for codec in self:
            chain.append((codec, spec))
            spec = codec.resolve_metadata(spec)
        for direct, own in reversed(chain):
            chunk = None if chunk is None else direct._decode_sync(chunk, own)
        return chunk

    def _encoded(self, chunk: Any, spec: Any) -> Any:
        chain: list[Any] = list(self)
        for codec in chain:
            chunk, spec = None if chunk is None else codec._encode_sync(chunk, spec), codec.resolve_metadata(spec)
        return chunk


@contextmanager
def direct_codecs() -> Iterator[None]:
    """Arrays that are opened inside use their codecs directly; those of others are not touched."""
    with zarr.config.set({"codec_pipeline.path": f"{DirectCodecs.__module__}.{DirectCodecs.__qualname__}"}):
        yield


register_pipeline(DirectCodecs)
