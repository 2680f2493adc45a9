"""zarr's own metadata, the `zarr.json` of arrays and groups: sealed when it is written, checked when it is read.

zarr believes what stands there. A flipped byte in the codecs, the fill value or the shape of an array would give other pixels
without an error, so that its attributes hold a checksum of all the rest. The metadata of a group is always the same.
"""

import json
import zlib
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import PurePosixPath
from typing import Any

from orthomill.pipeline.storage.chunk_codec import ChunkCodec
from orthomill.pipeline.storage.depots.depot import Depot, FileState
from orthomill.schemas.raster import RasterSpec

METADATA = "zarr.json"
SEAL = "seal"
_GROUP: dict[str, Any] = {"attributes": {}, "zarr_format": 3, "node_type": "group"}


def sealed(content: bytes) -> bytes:
    """An array's metadata with a checksum in its attributes."""
    metadata = json.loads(content)
    metadata["attributes"][SEAL] = _checksum(metadata)
    return json.dumps(metadata, indent=2).encode()


@dataclass(frozen=True)
class StoredArray:
    """An array of the store as its metadata describe it."""

    metadata: dict[str, Any]

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(self.metadata["shape"])

    @property
    def birth(self) -> str:
        """Mark of its creation: a raster that was made again has another."""
        return str(self.metadata["attributes"]["birth"])

    @cached_property
    def spec(self) -> RasterSpec:
        """The specification that it was made from."""
        return RasterSpec.model_validate(self.metadata["attributes"]["spec"])

    @cached_property
    def codec(self) -> ChunkCodec:
        """How its chunks are stored. Raises UnknownCodec."""
        return ChunkCodec.of(self.metadata)


def array_metadata(depot: Depot, folder: str) -> dict[str, Any] | None:
    """The metadata of an array; None where there is none or it is damaged. Arrays of earlier versions have no seal."""
    found = stored_array(depot, folder)
    return found.metadata if found else None


def stored_array(depot: Depot, folder: str) -> StoredArray | None:
    """The array in a folder; None where there is none or its metadata are damaged."""
    state = depot.state(f"{folder}/{METADATA}")
    return _sealed(depot, folder, state) if state else None


@lru_cache(maxsize=1024)
def _sealed(depot: Depot, folder: str, state: FileState) -> StoredArray | None:
    # Kept by the file's state: every job opens its arrays anew, and most of them are those of the job before.
    metadata = _read(depot, folder)
    if metadata is None or metadata.get("node_type") != "array" or not isinstance(metadata.get("attributes"), dict):
        return None
    found = metadata["attributes"].get(SEAL)
    return StoredArray(metadata) if found in (None, _checksum(metadata)) else None


def _checksum(metadata: dict[str, Any]) -> str:
    attributes = {name: value for name, value in metadata["attributes"].items() if name != SEAL}
    # Canonical text, so that a program that writes the file with other spaces breaks no seal.
    return f"{zlib.crc32(json.dumps(metadata | {'attributes': attributes}, sort_keys=True).encode()):08x}"


def ensure_groups(depot: Depot, top: str, folder: str) -> list[str]:
    """Write the metadata of the group `folder` and of all groups above it up to `top`, where it is missing or damaged.

    Returns the names of the files that were written. Raises OSError, StoreError.
    """
    groups = [f"{place}" for place in (PurePosixPath(folder), *PurePosixPath(folder).parents) if place.is_relative_to(top)]
    wanting = [f"{place}/{METADATA}" for place in groups if _read(depot, place) != _GROUP]
    for name in wanting:
        depot.put(name, json.dumps(_GROUP, indent=2).encode())
    return wanting


def _read(depot: Depot, folder: str) -> dict[str, Any] | None:
    try:
        value = json.loads(depot.get(f"{folder}/{METADATA}"))
    except (OSError, ValueError):  # absent, not UTF-8, or no JSON
        return None
    return value if isinstance(value, dict) else None
