"""Results below a prefix of an object store: Amazon S3 and what speaks like it, Google Cloud Storage, Azure Blob Storage.

An object is written whole by itself, and every answer names its version. What other libraries read or write by path goes through
the scratch folder of this machine. The store may be away for minutes and answer late: requests are repeated for so long.
"""

import hashlib
import tempfile
import uuid
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from functools import lru_cache
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO, Literal, cast

from orthomill.pipeline.storage.depots.depot import FileState, KeptFile
from orthomill.pipeline.storage.depots.folder import checksum_of
from orthomill.pipeline.storage.depots.found_keys import check_keys
from orthomill.pipeline.storage.depots.repeated_requests import PATIENCE, repeated
from orthomill.pipeline.storage.depots.store_keys import hidden, options_of
from orthomill.schemas.errors import ResourceError, StoreError, WorkflowError

SCHEMES = ("s3", "gs", "az")
_RETRY: Any = {
    "max_retries": 60,
    "backoff": {"init_backoff": timedelta(seconds=0.3), "max_backoff": timedelta(seconds=15), "base": 2},
    "retry_timeout": PATIENCE,
}
_NO_BUCKET = ("<Code>NoSuchBucket<", "<Code>ContainerNotFound<")
_REFUSED = ("401 Unauthorized", "403 Forbidden")
"""as answers say it that the library has no error of its own for"""
_IN_MEMORY = 4 * 2**20
"""bytes up to which a file goes from memory to memory: below, most of its time is that of temporary files"""
_PIECE = 64 * 2**20
"""Bytes above which a file is sent in parts: those of a killed process stay, unseen, until the bucket's own rule removes them."""


class Bucket:
    """A prefix of an object store, for the results of one run."""

    longest_log: int | None = 64 * 2**10
    at_once = 8

    def __init__(self, address: str, store: Any) -> None:
        self.address = address
        self.store = store
        self._version: Literal["version", "e_tag"] = "version" if address.startswith("gs://") else "e_tag"
        self._logs: dict[str, bytes] = {}
        self._left: dict[str, KeptFile] = {}

    def state(self, name: str) -> FileState | None:
        import obstore

        try:
            with self._explained():
                return self._state(obstore.head(self.store, name))
        except FileNotFoundError:
            return None

    def _state(self, entry: Any) -> FileState:
        # Google's conditional writes ask for the generation of an object; lists do not tell it.
        version = entry[self._version] or entry["e_tag"]
        return FileState(int(entry["size"]), _number(entry["e_tag"]), str(version))

    def size(self, name: str) -> int | None:
        if found := self.state(name):
            return found.size
        sizes = [int(entry["size"]) for entry in self._listed(name)]
        return sum(sizes) if sizes else None

    def get(self, name: str, start: int = 0) -> bytes:
        import obstore

        options: Any = {"range": {"offset": start}} if start else None
        with self._explained():
            return repeated(lambda: bytes(obstore.get(self.store, name, options=options).bytes()))

    def blocks(self, name: str) -> Iterator[bytes]:
        import obstore

        with self._explained():
            for block in obstore.get(self.store, name).stream():
                yield bytes(block)

    def put(self, name: str, content: bytes) -> KeptFile:
        import obstore

        with self._explained():
            answer = obstore.put(self.store, name, content, use_multipart=False)
        return KeptFile(len(content), _number(answer["e_tag"]), zlib.crc32(content))

    def create(self, name: str, content: bytes) -> bool:
        """Write an object that does not exist yet; whether its content is this one now. `content` must be no one else's."""
        return self._only_if(name, content, "create")

    def replace(self, name: str, content: bytes, version: str | int) -> bool:
        """Write an object anew, if it is still the given version; whether its content is this one now."""
        return self._only_if(name, content, {self._version: str(version)})

    def _only_if(self, name: str, content: bytes, mode: Any) -> bool:
        import obstore
        from obstore.exceptions import AlreadyExistsError, PreconditionError

        try:
            with self._explained(passing=(AlreadyExistsError, PreconditionError)):
                obstore.put(self.store, name, content, mode=mode, use_multipart=False)
            return True
        except (AlreadyExistsError, PreconditionError):
            # An answer may be lost and the request repeated: then it is our own object that stands in the way.
            try:
                return self.get(name) == content
            except FileNotFoundError:
                return False

    def probe(self) -> None:
        """Write, read and remove an object. Raises StoreError where the store cannot be used."""
        name = f".probe-{uuid.uuid4().hex}"
        try:
            kept = self.create(name, name.encode()) and self.get(name) == name.encode()
        except FileNotFoundError:
            raise _no_bucket(self.address) from None
        if not kept:
            raise StoreError(f"The object store {self.address} does not give back what was written there; choose another.")
        self.delete(name)

    def append(self, name: str, line: bytes) -> int:
        content = self._logs.get(name, b"") + line
        self.put(name, content)
        self._logs[name] = content
        return len(content)

    @contextmanager
    def writing(self, name: str) -> Iterator[BinaryIO]:
        with tempfile.NamedTemporaryFile(prefix="orthomill-") as stream:
            yield cast(BinaryIO, stream)
            stream.flush()
            self._send(Path(stream.name), name)

    def send(self, path: Path, name: str) -> None:
        self._send(path, name)
        self._left.pop(name)

    def _send(self, path: Path, name: str) -> None:
        import obstore

        size = path.stat().st_size
        if size <= _IN_MEMORY:
            self._left[name] = self.put(name, path.read_bytes())
            return
        with self._explained():
            answer = repeated(lambda: obstore.put(self.store, name, path, use_multipart=size > _PIECE))
        self._left[name] = KeptFile(size, _number(answer["e_tag"]), checksum_of(path))

    def kept(self, name: str) -> KeptFile:
        if name in self._left:
            return self._left.pop(name)
        found, content = self.state(name), self.get(name)
        if found is None:
            raise FileNotFoundError(name)
        return KeptFile(found.size, found.changed, zlib.crc32(content))

    def entries(self, folder: str) -> list[tuple[str, FileState]]:
        return [(PurePosixPath(entry["path"]).name, self._state(entry)) for entry in self._level(folder)["objects"]]

    def folders(self, folder: str) -> list[str]:
        return sorted(PurePosixPath(path).name for path in self._level(folder)["common_prefixes"])

    def _level(self, folder: str) -> Any:
        import obstore

        with self._explained():
            return repeated(lambda: obstore.list_with_delimiter(self.store, folder or None))

    def names(self, folder: str) -> Iterator[str]:
        yield from sorted(str(entry["path"]) for entry in self._listed(folder))

    def objects(self) -> Iterator[tuple[str, int, float]]:
        """All objects: name, bytes, and when they changed, in seconds since 1970. Raises StoreError."""
        yield from map(_told, self._listed(""))

    def object(self, name: str) -> tuple[str, int, float]:
        """One object, as in `objects`. Raises FileNotFoundError, StoreError."""
        import obstore

        with self._explained():
            return _told(obstore.head(self.store, name))

    def _listed(self, folder: str) -> Iterator[Any]:
        import obstore

        with self._explained():
            yield from repeated(lambda: [entry for page in obstore.list(self.store, folder or None) for entry in page])

    def delete(self, name: str) -> None:
        import obstore

        with self._explained():
            try:
                obstore.delete(self.store, name)
            except FileNotFoundError:
                return

    def clear(self, folder: str) -> None:
        import obstore

        if names := list(self.names(folder)):
            with self._explained():
                repeated(lambda: obstore.delete(self.store, names))

    def sweep(self) -> None:
        """An object that was not sent whole is none."""

    @contextmanager
    def local(self, name: str) -> Iterator[Path]:
        with tempfile.TemporaryDirectory(prefix="orthomill-") as scratch:
            path = Path(scratch) / PurePosixPath(name).name
            self.fetch(name, path)
            yield path

    @contextmanager
    def source(self, name: str) -> Iterator[Path | BinaryIO]:
        content = self._small(name)
        if content is not None:
            yield BytesIO(content)
            return
        with self.local(name) as path:
            yield path

    def _small(self, name: str) -> bytes | None:
        """The content of a small object; None of a large one."""
        import obstore

        def answer() -> bytes | None:
            found = obstore.get(self.store, name)
            return bytes(found.bytes()) if found.meta["size"] <= _IN_MEMORY else None

        with self._explained():
            return repeated(answer)

    def fetch(self, name: str, path: Path) -> None:
        """Copy an object to a file. Raises FileNotFoundError, OSError, StoreError."""
        with path.open("wb") as target:
            for block in self.blocks(name):
                target.write(block)

    @contextmanager
    def product(self, name: str) -> Iterator[Path]:
        with tempfile.TemporaryDirectory(prefix="orthomill-") as scratch:
            path = Path(scratch) / name
            path.parent.mkdir(parents=True)
            yield path
            self._deliver(Path(scratch), path)

    def _deliver(self, scratch: Path, main: Path) -> None:
        """Send what lies in a scratch folder, the main file last: once it is there, all is."""
        made = sorted((file for file in scratch.rglob("*") if file.is_file()), key=lambda file: (file == main, file))
        names = [file.relative_to(scratch).as_posix() for file in made]
        for file, name in zip(made, names, strict=True):
            self._send(file, name)
            if file != main:
                self._left.pop(name)

    @contextmanager
    def _explained(self, passing: tuple[type[Exception], ...] = ()) -> Iterator[None]:
        """Errors of the store as sentences without a key in them; an object that is not there stays a FileNotFoundError."""
        from obstore.exceptions import BaseError

        try:
            yield
        except passing:
            raise
        except FileNotFoundError:
            raise FileNotFoundError(2, "no such object", self.address) from None
        except BaseError as error:
            if any(word in str(error) for word in _NO_BUCKET):
                raise _no_bucket(self.address) from None
            if any(word in str(error) for word in _REFUSED):
                raise StoreError(
                    f"The object store {self.address} refuses the keys that this process has; check those in the environment, and "
                    "what they allow, then run again."
                ) from None
            raise StoreError(
                f"The object store {self.address} cannot be read or written ({hidden(str(error))}); check its address, "
                "that it can be reached, and the keys in the environment, then run again."
            ) from None


def _no_bucket(address: str) -> StoreError:
    return StoreError(f"There is no bucket or container for {address}; make it with the tools of the store.")


def _told(entry: Any) -> tuple[str, int, float]:
    return str(entry["path"]), int(entry["size"]), entry["last_modified"].timestamp()


def _number(e_tag: str | None) -> int:
    """What a store calls a version, as a number of 53 bits: JSON of any program keeps it."""
    return int.from_bytes(hashlib.sha256(str(e_tag).encode()).digest()[:7]) >> 3


def is_address(place: str) -> bool:
    """Whether a place is one of an object store."""
    return place.startswith(tuple(f"{scheme}://" for scheme in (*SCHEMES, "memory")))


@lru_cache(maxsize=8)
def bucket_of(address: str) -> Bucket:
    """The depot of an address such as s3://bucket/prefix. Raises WorkflowError, ResourceError; StoreError where no key is to be
    found."""
    scheme, _, rest = address.partition("://")
    if not is_address(address) or not rest or any(word in rest for word in ("@", "?", "//", "..")):
        raise WorkflowError(
            f"{hidden(address)} is no place for results; give s3://BUCKET/PREFIX, gs://BUCKET/PREFIX or az://CONTAINER/PREFIX, and "
            "keys in the environment."
        )
    try:
        from obstore.store import MemoryStore, from_url
    except ImportError:
        raise _no_library() from None
    if scheme == "memory":  # of this process alone, for tests
        return Bucket(address, MemoryStore())
    options = options_of(scheme)
    check_keys(address, scheme, options)
    try:
        return Bucket(address, from_url(address, retry_config=_RETRY, **options))
    except Exception as error:
        raise WorkflowError(f"{address} cannot be opened ({hidden(str(error))}); check its form and the environment.") from None


def exchange_at(address: str) -> Bucket:
    """Where files are fetched from and sent to: an object store, or a folder that machines share (file:///mnt/flights). Raises
    WorkflowError, ResourceError."""
    if not address.startswith("file:///"):
        return bucket_of(address)
    try:
        from obstore.store import from_url
    except ImportError:
        raise _no_library() from None
    try:
        # Buckets have no folders that would have to exist.
        return Bucket(address, from_url(address, mkdir=True))
    except Exception as error:
        raise WorkflowError(f"{address} cannot be opened ({hidden(str(error))}); check that the folder is there.") from None


def _no_library() -> ResourceError:
    return ResourceError("Object stores need a library: pip install 'orthomill[store]'.")
