"""Photographs from an object store, and results into one, in the form of ScaleODM: addresses below prefixes that the node allows.

The keys are the node's own (its environment): a task names places and no secrets, and no place that its node was not started for.
"""

import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from orthomill.pipeline.serving.outputs.asset_files import Asset
from orthomill.pipeline.serving.queue.safe_archives import ArchiveLimits
from orthomill.pipeline.serving.queue.upload_names import NamesTaken, belongs_beside, is_archive, is_image
from orthomill.pipeline.storage.whole_files import replacing
from orthomill.schemas.errors import ResourceError, WorkflowError
from orthomill.schemas.memory import MIB

_ODD = frozenset("%?#*\\ \t\r\n")


def allowed_address(address: str, prefixes: tuple[str, ...]) -> str:
    """The address of a folder or of an archive, below one of the prefixes. Raises WorkflowError for any other."""
    bare = address.strip().rstrip("/")
    inside = any(f"{bare}/".startswith(f"{prefix.rstrip('/')}/") for prefix in prefixes)
    if inside and not (_ODD & set(bare) or {".", ".."} & set(bare.split("/"))):
        return bare
    if not prefixes:
        raise WorkflowError("This node reads from and writes to no object store; it would be started with --s3 s3://bucket/prefix.")
    raise WorkflowError(f"{address[:100]!r} is no place for this node, which reads and writes below {', '.join(prefixes)}.")


def fetch_photographs(address: str, target: Path, limits: ArchiveLimits) -> tuple[int, int]:
    """Put the photographs, lists and archives of a place into a folder; how many photographs there are, and how many objects were
    left out. What is there already is not fetched again. Raises WorkflowError and ResourceError."""
    folder, _, last = address.rpartition("/")
    single = is_archive(last)
    photographs = left_out = 0
    with _explained(address):
        import obstore

        store = _store(folder if single else address)
        found = [last] if single else [entry["path"] for page in obstore.list(store) for entry in page]
        if len(found) > limits.files:
            raise WorkflowError(f"{address} holds {len(found)} objects; a task has at most {limits.files}.")
        names, received = NamesTaken(address), 0
        for path in sorted(found):
            parts = path.split("/")
            if not (is_image(parts[-1]) or belongs_beside(parts[-1]) or is_archive(parts[-1])):
                left_out += 1
                continue
            name = names.take(parts)
            received += _fetch(store, path, target / name, limits, limits.bytes - received)
            photographs += is_image(name)
    return photographs, left_out


def _fetch(store: Any, path: str, target: Path, limits: ArchiveLimits, left: int) -> int:
    """Bytes of one object."""
    import obstore

    answer = obstore.get(store, path)
    size = int(answer.meta["size"])
    if size > min(limits.file_bytes, left):
        raise WorkflowError(f"{target.name} has {size / MIB:.0f} MiB, more than this node takes for one file or for a task.")
    if target.exists() and target.stat().st_size == size:
        return size
    if shutil.disk_usage(target.parent).free - size < limits.reserve:
        raise ResourceError("The disk of this node is full; remove tasks that are no longer needed, and restart this one.")
    with replacing(target) as stream:
        for block in answer.stream():
            stream.write(block)
    return size


def send_results(address: str, chosen: Iterable[Asset]) -> int:
    """Put files at their places below an address; how many. Raises WorkflowError and ResourceError."""
    sent = 0
    with _explained(address):
        import obstore

        store = _store(address)
        for asset in chosen:
            obstore.put(store, asset.place, asset.path)
            sent += 1
    return sent


def _store(address: str) -> Any:
    from obstore.store import from_url

    # A shared folder may be named as well (file:///mnt/flights); buckets have no folders that would have to exist.
    return from_url(address, mkdir=True) if address.startswith("file:") else from_url(address)


@contextmanager
def _explained(address: str) -> Iterator[None]:
    """Errors of the store as sentences."""
    try:
        from obstore.exceptions import BaseError
    except ImportError:
        raise ResourceError("Object stores need the libraries of the extra: pip install 'orthomill[serve]'.") from None
    try:
        yield
    except (BaseError, OSError) as error:
        # The rest of what it says is for the authors of the library.
        said = str(error).split("\n")[0][:300]
        raise ResourceError(
            f"{address} cannot be read or written: {said}; check the address, and the keys of this node (AWS_ACCESS_KEY_ID, "
            "AWS_SECRET_ACCESS_KEY, AWS_ENDPOINT ...)."
        ) from error
