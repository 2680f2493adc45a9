"""Copies of objects on a worker's own disk, for libraries that read files: photographs, maps, meshes.

A copy lies in a folder named after the version of its object, so that it is never stale, and is there whole or not at all. The
oldest go when all of them take more than their share. `ORTHOMILL_SCRATCH` names another folder than the system's temporary one.
"""

import hashlib
import os
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

from orthomill.pipeline.storage.depots.bucket import bucket_of
from orthomill.schemas.errors import StoreError

LARGEST = 20 * 2**30
"""bytes of all copies of a machine"""


def scratch_folder() -> Path:
    """Where the copies of this user lie."""
    return Path(os.environ.get("ORTHOMILL_SCRATCH") or tempfile.gettempdir()) / f"orthomill-scratch-{os.getuid()}"


def fetched(address: str, name: str, path: str) -> Path:
    """A folder in which the object `name` of a depot lies under the relative `path`. Raises StoreError where there is none."""
    bucket = bucket_of(address)
    state = bucket.state(name)
    if state is None:
        raise StoreError(f"{path} is not in {address}; run again, and it is put there again.")
    version = hashlib.sha256(f"{address}/{name} {state.version}".encode()).hexdigest()[:20]
    place = scratch_folder() / version
    if (place / path).exists():
        with suppress(OSError):
            os.utime(place)
        return place
    _make_room(state.size)
    place.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=place.parent, suffix=".part") as made:
        whole = Path(made) / "whole"
        (whole / path).parent.mkdir(parents=True)
        bucket.fetch(name, whole / path)
        with suppress(OSError):  # another process of this machine was faster
            whole.rename(place)
    return place


def _make_room(size: int) -> None:
    top = scratch_folder()
    if not top.is_dir():
        return
    copies = []
    for folder in top.iterdir():
        with suppress(OSError):
            held = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
            copies.append((folder.stat().st_mtime, held, folder))
    total = size + sum(held for _, held, _ in copies)
    for _, held, folder in sorted(copies, key=lambda copy: copy[:2]):
        if total <= LARGEST:
            return
        shutil.rmtree(folder, ignore_errors=True)
        total -= held
