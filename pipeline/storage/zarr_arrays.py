"""Arrays that zarr itself writes and reads, in memory: what it makes is put into the depot, metadata sealed."""

from typing import Any

import numpy as np

from orthomill.pipeline.storage.array_metadata import METADATA, sealed
from orthomill.pipeline.storage.depots.depot import Depot


def put_array(depot: Depot, folder: str, wanted: dict[str, Any], values: np.ndarray | None = None) -> None:
    """Write an array in place of what a folder holds: `wanted` as for zarr.create_array. Raises OSError, StoreError."""
    import zarr
    from zarr.storage import MemoryStore

    memory: dict[str, Any] = {}
    array = zarr.create_array(MemoryStore(memory), **wanted)
    if values is not None:
        array[:] = values
    depot.clear(folder)
    metadata = memory.pop(METADATA).to_bytes()
    for name, content in memory.items():
        depot.put(f"{folder}/{name}", content.to_bytes())
    # Last: an array whose metadata are there is whole.
    depot.put(f"{folder}/{METADATA}", sealed(metadata))


def values_of_array(depot: Depot, folder: str) -> np.ndarray:
    """All values of a small array. Raises OSError, ValueError, RuntimeError where it is damaged."""
    import zarr
    from zarr.core.buffer import default_buffer_prototype
    from zarr.storage import MemoryStore

    buffer = default_buffer_prototype().buffer
    found = {name.removeprefix(f"{folder}/"): buffer.from_bytes(depot.get(name)) for name in depot.names(folder)}
    return np.asarray(zarr.open_array(MemoryStore(found), mode="r")[...])
