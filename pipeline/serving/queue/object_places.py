"""Photographs from an object store, and results into one, in the form of ScaleODM: addresses below prefixes that the node allows.

The keys are the node's own (its environment): a task names places and no secrets, and no place that its node was not started for.
"""

from collections.abc import Iterable
from pathlib import PurePosixPath

from orthomill.pipeline.serving.outputs.asset_files import ROOMS, Asset
from orthomill.pipeline.serving.queue.safe_archives import ArchiveLimits
from orthomill.pipeline.serving.queue.upload_names import NamesTaken, belongs_beside, is_archive, is_image
from orthomill.pipeline.storage.depots.bucket import exchange_at
from orthomill.pipeline.storage.depots.fetched_photographs import FetchRules
from orthomill.schemas.errors import WorkflowError

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


def apart(read_from: str, write_to: str) -> None:
    """Raises WorkflowError where results would lie among the photographs."""
    if read_from and read_from == write_to:
        raise WorkflowError(
            f"writeS3Path is {write_to!r}, where the photographs lie; name a place of its own, below or beside them."
        )


def task_rules(address: str, results: str, limits: ArchiveLimits) -> FetchRules:
    """Photographs, lists and archives of a place, side by side in one folder, as uploads are. What lies below `results` is none of
    them, nor what an engine has left in folders of results: a task that is begun again would take its own maps for photographs."""
    names = NamesTaken(address)
    below = results.removeprefix(f"{address}/") + "/" if results.startswith(f"{address}/") else None
    return FetchRules(
        wanted=lambda path: not (below and path.startswith(below)) and _taken(PurePosixPath(path)),
        named=lambda path: names.take(path.split("/")),
        files=limits.files,
        file_bytes=limits.file_bytes,
        bytes=limits.bytes,
        reserve=limits.reserve,
    )


def _taken(path: PurePosixPath) -> bool:
    name = path.name
    return not ROOMS & set(path.parts[:-1]) and (is_image(name) or belongs_beside(name) or is_archive(name))


def send_results(address: str, chosen: Iterable[Asset]) -> int:
    """Put files at their places below an address; how many. Raises WorkflowError, ResourceError, StoreError."""
    place, sent = exchange_at(address), 0
    for asset in chosen:
        place.send(asset.path, asset.place)
        sent += 1
    return sent
