"""What a request holds: fields of a form or of JSON, bounded; numbers of a query."""

import json
from contextlib import AbstractContextManager
from typing import Any
from urllib.parse import parse_qsl

from pydantic import TypeAdapter
from starlette.requests import Request

from orthomill.pipeline.serving.node.streamed_uploads import MOST_FIELDS, MultipartReader, Receiver
from orthomill.pipeline.serving.queue.task_state import GivenOption
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.memory import MIB

MOST_BODY = 2 * MIB
"""bytes of a request without files"""
_OPTIONS = TypeAdapter(tuple[GivenOption, ...])
MOST_OPTIONS = 500


def _no_files(name: str) -> AbstractContextManager[Receiver]:
    raise WorkflowError("This request takes no files; they are sent to /task/new/upload.")


async def fields_of(request: Request) -> dict[str, Any]:
    """The fields of a request, whichever of the usual forms it has. Raises WorkflowError for one that cannot be read."""
    kind = request.headers.get("content-type", "")
    if kind.startswith("multipart/form-data"):
        reader = MultipartReader(_no_files)
        await reader.read(kind, request.stream())
        return dict(reader.fields)
    body = bytearray()
    async for block in request.stream():
        if len(body) + len(block) > MOST_BODY:
            raise WorkflowError(f"The request has more than {MOST_BODY} bytes; files are sent to /task/new/upload.")
        body.extend(block)
    if kind.startswith("application/json"):
        return _json_object(bytes(body))
    try:
        return dict(parse_qsl(body.decode("utf-8", errors="replace"), keep_blank_values=True, max_num_fields=MOST_FIELDS))
    except ValueError:
        raise WorkflowError(f"A request has at most {MOST_FIELDS} fields.") from None


def _json_object(body: bytes) -> dict[str, Any]:
    try:
        found = json.loads(body or b"{}")
    except (ValueError, RecursionError):
        raise WorkflowError("The request is no JSON.") from None
    if not isinstance(found, dict):
        raise WorkflowError("The request is JSON, but no object of fields.")
    return found


def text_of(fields: dict[str, Any], name: str, most: int = 1000) -> str:
    """A field as a text without control signs; "" where it is not given."""
    value = fields.get(name)
    return "".join(sign if sign.isprintable() else " " for sign in str(value))[:most] if value not in (None, "") else ""


def options_of(fields: dict[str, Any]) -> tuple[GivenOption, ...]:
    """The options of a task. Raises WorkflowError."""
    given = fields.get("options") or "[]"
    try:
        found = json.loads(given) if isinstance(given, str) else given
        # Halves of letters, which JSON can hold, are no text that could be kept.
        json.dumps(found, ensure_ascii=False).encode()
        options = _OPTIONS.validate_python(found)
    except (ValueError, RecursionError):
        raise WorkflowError('options is no list of the form [{"name": "dtm", "value": true}, ...].') from None
    if len(options) > MOST_OPTIONS:
        raise WorkflowError(f"A task has at most {MOST_OPTIONS} options.")
    return options


def outputs_of(fields: dict[str, Any]) -> tuple[str, ...]:
    """The paths below the results that are wanted. Raises WorkflowError."""
    given = fields.get("outputs") or "[]"
    try:
        found = json.loads(given) if isinstance(given, str) else given
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, list) or len(found) > MOST_OPTIONS or not all(isinstance(one, str) for one in found):
        raise WorkflowError('outputs is no list of paths such as ["odm_orthophoto"].')
    return tuple(one[:300].encode(errors="replace").decode() for one in found)


def whole_number(text: str, name: str) -> int:
    """A number of a query. Raises WorkflowError."""
    sign, digits = text[:1] == "-", text.lstrip("-")
    if not (digits.isascii() and digits.isdigit()) or len(digits) > 12:
        raise WorkflowError(f"{name} is {text[:40]!r}; it is a whole number.")
    return -int(digits) if sign else int(digits)


def created_of(fields: dict[str, Any], otherwise: int) -> int:
    """The time of creation, ms, that a client gives."""
    text = str(fields.get("dateCreated") or "")
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 15 else otherwise
