"""Multipart bodies as streams: files go to the disk block by block, fields are bounded, nothing waits in memory.

python-multipart's parser finds the parts; what it calls back is collected and handled between two blocks of the body, where files
may be written outside of the loop of the server.
"""

from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from python_multipart.exceptions import MultipartParseError
from python_multipart.multipart import MultipartParser, MultipartState, parse_options_header
from starlette.concurrency import run_in_threadpool

from orthomill.schemas.errors import OrthomillError, WorkflowError
from orthomill.schemas.memory import MIB

if TYPE_CHECKING:
    from python_multipart.multipart import MultipartCallbacks

MOST_FIELD, MOST_FIELDS, MOST_HEADER = MIB, 64, 4096
"""bytes of a field, number of fields, bytes of the headers of a part"""
_WRITTEN = MIB
"""bytes that are collected before they are written"""


class Receiver(Protocol):
    """Takes the blocks of a file."""

    def write(self, block: bytes) -> None:
        """Take the next block."""


Receive = Callable[[str], AbstractContextManager[Receiver]]
"""From the name of a file to whoever keeps it; the file is there when the context has ended well."""


@dataclass
class _FormPart:
    """A part that is being read."""

    headers: dict[bytes, bytes] = field(default_factory=dict)
    name: str = ""
    filename: str | None = None
    value: bytearray = field(default_factory=bytearray)


@dataclass
class MultipartReader:
    """Reads one body: fields by name (the last one counts), and the number of files that were kept."""

    receive: Receive
    file_field: str = "images"
    fields: dict[str, str] = field(default_factory=dict)
    files: int = 0
    _events: list[tuple[str, bytes]] = field(default_factory=list)
    _pending: int = 0
    _part: _FormPart = field(default_factory=_FormPart)
    _header: tuple[bytearray, bytearray] = field(default_factory=lambda: (bytearray(), bytearray()))
    _context: AbstractContextManager[Receiver] | None = None
    _file: Receiver | None = None

    async def read(self, content_type: str, body: AsyncIterator[bytes]) -> None:
        """Raises OrthomillError with a sentence for a body that is no multipart form or holds too much, after reading it on to its
        end: a client hears nothing while it sends."""
        kind, parameters = parse_options_header(content_type)
        boundary = parameters.get(b"boundary")
        if kind != b"multipart/form-data" or not boundary or len(boundary) > 200:
            raise WorkflowError("The request is no multipart form; files are sent as multipart/form-data in the field 'images'.")
        parser = MultipartParser(boundary, self._callbacks())
        refused: OrthomillError | None = None
        try:
            async for block in body:
                if refused is not None:
                    continue
                try:
                    parser.write(block)
                    if self._pending >= _WRITTEN:
                        await run_in_threadpool(self._handle)
                except MultipartParseError:
                    refused = WorkflowError("The body is no multipart form, or was damaged on its way; send it again.")
                except OrthomillError as error:
                    refused = error
            if refused is None:
                await run_in_threadpool(self._handle)
                if parser.state != MultipartState.END or self._context is not None:
                    refused = WorkflowError("The body ended in the middle of a file; send it again.")
        except OrthomillError as error:
            refused = error
        finally:
            self._drop(refused)
        if refused is not None:
            raise refused

    def _callbacks(self) -> "MultipartCallbacks":
        def event(name: str) -> Callable[[], None]:
            return lambda: self._events.append((name, b""))

        def data(name: str) -> Callable[[bytes, int, int], None]:
            def take(block: bytes, start: int, end: int) -> None:
                self._events.append((name, block[start:end]))
                self._pending += end - start

            return take

        return {
            "on_part_begin": event("begin"),
            "on_part_end": event("end"),
            "on_header_field": data("field"),
            "on_header_value": data("value"),
            "on_header_end": event("header"),
            "on_headers_finished": event("headers"),
            "on_part_data": data("data"),
        }

    def _handle(self) -> None:
        events, self._events, self._pending = self._events, [], 0
        does = {
            "begin": self._begin_part,
            "field": self._header_name,
            "value": self._header_value,
            "header": self._end_header,
            "headers": self._end_headers,
            "data": self._take,
            "end": self._end_part,
        }
        for name, block in events:
            does[name](block)

    def _begin_part(self, _: bytes) -> None:
        self._part, self._header = _FormPart(), (bytearray(), bytearray())

    def _header_name(self, block: bytes) -> None:
        self._header[0].extend(block)
        self._bound_header()

    def _header_value(self, block: bytes) -> None:
        self._header[1].extend(block)
        self._bound_header()

    def _bound_header(self) -> None:
        if len(self._header[0]) + len(self._header[1]) > MOST_HEADER:
            raise WorkflowError("A part of the request has longer headers than any client sends.")

    def _end_header(self, _: bytes) -> None:
        self._part.headers[bytes(self._header[0]).lower()] = bytes(self._header[1])
        self._header = (bytearray(), bytearray())

    def _end_headers(self, _: bytes) -> None:
        _, given = parse_options_header(self._part.headers.get(b"content-disposition", b""))
        self._part.name = _text(given.get(b"name", b""))
        if b"filename" not in given:
            return
        if self._part.name != self.file_field:
            raise WorkflowError(f"Files are sent in the field '{self.file_field}'.")
        self._context = self.receive(_text(given[b"filename"]))
        try:
            self._file = self._context.__enter__()
        except BaseException:
            self._context = None
            raise

    def _take(self, block: bytes) -> None:
        if self._file is not None:
            self._file.write(block)
            return
        self._part.value.extend(block)
        if len(self._part.value) > MOST_FIELD:
            raise WorkflowError(f"The field '{self._part.name[:40]}' is longer than {MOST_FIELD} bytes.")

    def _end_part(self, _: bytes) -> None:
        if self._context is not None:
            context, self._context, self._file = self._context, None, None
            context.__exit__(None, None, None)
            self.files += 1
            return
        if len(self.fields) >= MOST_FIELDS:
            raise WorkflowError(f"A request has at most {MOST_FIELDS} fields.")
        self.fields[self._part.name] = self._part.value.decode("utf-8", errors="replace")

    def _drop(self, refused: OrthomillError | None) -> None:
        """Leave a file that is not whole to whoever removes it."""
        context, self._context, self._file = self._context, None, None
        if context is not None:
            error = refused or WorkflowError("The connection ended in the middle of a file.")
            with suppress(OrthomillError):
                context.__exit__(type(error), error, error.__traceback__)


def _text(name: bytes) -> str:
    try:
        return name.decode()
    except UnicodeDecodeError:
        return name.decode("latin-1")
