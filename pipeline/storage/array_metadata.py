"""zarr's own metadata, the `zarr.json` of arrays and groups: sealed when it is written, checked when it is read.

zarr believes what stands there. A flipped byte in the codecs, the fill value or the shape of an array would give other pixels
without an error, so that its attributes hold a checksum of all the rest. The metadata of a group is always the same.
"""

import json
import os
import zlib
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

from orthomill.pipeline.storage.chunk_codec import ChunkCodec
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.raster import RasterSpec

METADATA = "zarr.json"
SEAL = "seal"
_GROUP: dict[str, Any] = {"attributes": {}, "zarr_format": 3, "node_type": "group"}


def seal_array(folder: Path) -> None:
    """Put a checksum of an array's metadata into its attributes, and write it whole. Raises StoreError."""
    metadata = json.loads((folder / METADATA).read_text())
    metadata["attributes"][SEAL] = _checksum(metadata)
    write_whole(folder / METADATA, json.dumps(metadata, indent=2).encode())


@dataclass(frozen=True)
class StoredArray:
    """An array of the store as its metadata describe it."""

    metadata: dict[str, Any]

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(self.metadata["shape"])

    @property
    def birth(self) -> str:
        return str(self.metadata["attributes"]["birth"])

    @cached_property
    def spec(self) -> RasterSpec:
        return RasterSpec.model_validate(self.metadata["attributes"]["spec"])

    @cached_property
    def codec(self) -> ChunkCodec:
        """How its chunks are stored. Raises UnknownCodec."""
        return ChunkCodec.of(self.metadata)


def array_metadata(folder: Path) -> dict[str, Any] | None:
    """The metadata of an array; None where there is none or it is damaged. Arrays of earlier versions have no seal."""
    found = stored_array(folder)
    return found.metadata if found else None


def stored_array(folder: Path) -> StoredArray | None:
    """The array in a folder; None where there is none or its metadata are damaged."""
    try:
        state = os.stat(f"{folder}/{METADATA}")
    except OSError:
        return None
    return _sealed(folder, state.st_mtime_ns, state.st_size, state.st_ino)


@lru_cache(maxsize=1024)
def _sealed(folder: Path, changed: int, size: int, number: int) -> StoredArray | None:
    # Kept by the file's state: every job opens its arrays anew, and most of them are those of the job before.
    metadata = _read(folder)
    if metadata is None or metadata.get("node_type") != "array" or not isinstance(metadata.get("attributes"), dict):
        return None
    sealed = metadata["attributes"].get(SEAL)
    return StoredArray(metadata) if sealed in (None, _checksum(metadata)) else None


def _checksum(metadata: dict[str, Any]) -> str:
    attributes = {name: value for name, value in metadata["attributes"].items() if name != SEAL}
    # Canonical text, so that a program that writes the file with other spaces breaks no seal.
    return f"{zlib.crc32(json.dumps(metadata | {'attributes': attributes}, sort_keys=True).encode()):08x}"


def ensure_groups(top: Path, folder: Path) -> list[Path]:
    """Write the metadata of the group `folder` and of all groups above it up to `top`, where it is missing or damaged.

    Returns the files that were written. Raises StoreError.
    """
    groups = [place for place in (folder, *folder.parents) if place.is_relative_to(top)]
    wanting = [place / METADATA for place in groups if _read(place) != _GROUP]
    for path in wanting:
        write_whole(path, json.dumps(_GROUP, indent=2).encode())
    return wanting


def _read(folder: Path) -> dict[str, Any] | None:
    try:
        value = json.loads((folder / METADATA).read_bytes())
    except (OSError, ValueError):  # absent, not UTF-8, or no JSON
        return None
    return value if isinstance(value, dict) else None
