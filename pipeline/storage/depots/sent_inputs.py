"""The user's files in the object store of a run, for workers that do not see the project's disk.

Each is sent once, under the digest of its content: a second run sends what has changed, and a half-sent one is no object.
"""

from collections.abc import Callable
from pathlib import Path, PurePosixPath

from orthomill.pipeline.storage.depots.depot import Depot

INPUTS = "inputs"


class SentInputs:
    """What a depot holds of the files below a project's `root`; `digest` is that of a file's content."""

    def __init__(self, root: Path, depot: Depot, digest: Callable[[Path], str]) -> None:
        self._digest = digest
        self._root = root
        self._depot = depot
        self._there: set[str] | None = None

    def sent(self, path: str) -> str:
        """The name in the depot of a file below the root, which is there when this returns. Raises OSError, StoreError."""
        if self._there is None:
            self._there = set(self._depot.names(INPUTS))
        name = f"{INPUTS}/{self._digest(self._root / path)}/{PurePosixPath(path).name}"
        if name not in self._there:
            self._depot.send(self._root / path, name)
            self._there.add(name)
        return name
