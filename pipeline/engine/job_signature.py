"""Whether a job fits its function: found when the graph is built, before any worker starts.

A job passes `reads` and `params` to its function under their names, so the names must be parameters of the function, and a region
must hold what the parameter's annotation says; a tuple of regions arrives as a tuple, a stream as an iterator. The annotation of
the return value says what comes back: the bare value of the only write, a NamedTuple whose fields are the names of the writes, or
`dict[str, T]` where the names depend on the data. A field that is not always written has a default. Functions that share most of
what they read may take it together: `**reads: Unpack[D]` of a TypedDict stands for its keys.
"""

import inspect
import types
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Union, Unpack, get_args, get_origin, get_type_hints

import numpy as np

from orthomill.schemas.job import (
    AreaFile,
    CloudFile,
    HeightHeader,
    Job,
    MapHeader,
    MeshFile,
    PhotoHeader,
    PhotoPicture,
    Reading,
    Region,
    Stream,
    Table,
    TextFile,
)
from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.photo import Header, Soundness
from orthomill.schemas.raster import MapGrid
from orthomill.schemas.solid.cloud_points import CloudPoints
from orthomill.schemas.solid.mesh import TriangleMesh

_HELD = {
    TextFile: str,
    PhotoHeader: Header,
    PhotoPicture: Soundness,
    MapHeader: MapGrid,
    HeightHeader: MapGrid,
    MeshFile: TriangleMesh,
    CloudFile: CloudPoints,
    AreaFile: WantedArea,
}


@dataclass(frozen=True)
class Several:
    """What several regions hold: the kinds of their values, and the generic types that a parameter for them may have."""

    word: str
    kinds: tuple["Held", ...]
    containers: tuple[type, ...]


Held = type | Several
"""What the regions of one argument hold."""


def misfit(job: Job) -> str | None:
    """What does not fit between a job and its function, as a sentence with both names; None when everything fits."""
    reads = tuple((name, _held(region)) for name, region in job.reads.items())
    params = tuple((name, type(value)) for name, value in job.params.items())
    writes = tuple((name, _held_by(region)) for name, region in job.writes.items())
    # Thousands of tile jobs share a function and the names and kinds of their regions: each combination is examined once.
    found = _misfit(job.function, reads, params, writes)
    return found and f"The job {'/'.join(map(str, job.key))} does not fit the function {job.function.__qualname__}: {found}."


def _held(reading: Reading) -> Held:
    if not isinstance(reading, tuple | Stream):
        return _held_by(reading)
    if isinstance(reading, Stream):
        return Several("a stream", tuple(dict.fromkeys(map(_held, reading.regions))), (Iterator, Iterable))
    kinds = tuple(dict.fromkeys(map(_held_by, reading)))
    # The engine passes a tuple; a parameter of type list would invite a function to change it.
    return Several("a tuple", kinds, (tuple, Sequence))


def _held_by(region: Region) -> type:
    return region.type if isinstance(region, Table) else _HELD.get(type(region), np.ndarray)


@lru_cache(maxsize=4096)
def _misfit(
    function: Callable[..., Any],
    reads: tuple[tuple[str, Held], ...],
    params: tuple[tuple[str, type], ...],
    writes: tuple[tuple[str, type], ...],
) -> str | None:
    signature, hints = _unpacked(inspect.signature(function), get_type_hints(function))
    try:
        signature.bind(**dict(reads), **dict(params))
    except TypeError as error:
        return f"{error}; it takes {', '.join(signature.parameters) or 'nothing'}"
    given = [*_wrong_arguments(hints, reads), *_wrong_settings(hints, params)]
    return next(iter([*given, *_wrong_results(hints.get("return"), dict(writes))]), None)


def _unpacked(signature: inspect.Signature, hints: dict[str, Any]) -> tuple[inspect.Signature, dict[str, Any]]:
    """The signature with the keys of an unpacked TypedDict as parameters of their own."""
    parameters, found = list(signature.parameters.values()), dict(hints)
    last = parameters[-1] if parameters else None
    if last is None or last.kind is not inspect.Parameter.VAR_KEYWORD or get_origin(hints.get(last.name)) is not Unpack:
        return signature, hints
    (together,) = get_args(found.pop(last.name))
    keys = get_type_hints(together)
    needed = [inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY) for key in keys if key in together.__required_keys__]
    rest = [
        inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=None) for key in keys if key in together.__optional_keys__
    ]
    return signature.replace(parameters=[*parameters[:-1], *needed, *rest]), {**found, **keys}


def _wrong_arguments(hints: dict[str, Any], reads: tuple[tuple[str, Held], ...]) -> Iterator[str]:
    for name, held in reads:
        if name not in hints:
            yield f"its parameter '{name}' has no annotation"
        elif not _takes(hints[name], held):
            yield f"'{name}' is read as {_name(held)}, but the parameter is {_name(hints[name])}"


def _wrong_settings(hints: dict[str, Any], params: tuple[tuple[str, type], ...]) -> Iterator[str]:
    """Parameters are checked where their annotation is a plain class; the content of containers is not examined."""
    for name, kind in params:
        if name in hints and not _may_be(hints[name], kind):
            yield f"'{name}' is given as {_name(kind)}, but the parameter is {_name(hints[name])}"


def _wrong_results(returned: Any, writes: dict[str, type]) -> Iterator[str]:
    fields = _fields(returned)
    if fields is not None:
        yield from _wrong_fields(returned, fields, writes)
    elif get_origin(returned) is dict:
        held = get_args(returned)[1]
        # A dict of several kinds of tables (links and the observations of every photograph) is a union: each write is one of them.
        yield from (
            f"'{n}' is written as {_name(k)}, but it returns {_name(held)}"
            for n, k in writes.items()
            if not any(_gives(member, k) for member in _members(held))
        )
    elif returned is None:
        yield "its return value has no annotation"
    elif len(writes) != 1:
        yield f"it returns {_name(returned)}, but the job writes {', '.join(writes)}; return a NamedTuple with these fields"
    else:
        name, kind = next(iter(writes.items()))
        if not _gives(returned, kind):
            yield f"'{name}' is written as {_name(kind)}, but it returns {_name(returned)}"


def _fields(returned: Any) -> dict[str, Any] | None:
    return get_type_hints(returned) if isinstance(returned, type) and hasattr(returned, "_fields") else None


def _wrong_fields(returned: Any, fields: dict[str, Any], writes: dict[str, type]) -> Iterator[str]:
    for name, kind in writes.items():
        if name not in fields:
            yield f"the job writes '{name}', but {returned.__name__} has the fields {', '.join(fields)}"
        elif not _gives(fields[name], kind):
            yield f"'{name}' is written as {_name(kind)}, but {returned.__name__} holds {_name(fields[name])}"
    for name in fields:
        if name not in writes and name not in returned._field_defaults:
            yield f"'{name}' of {returned.__name__} is not written, and it has no default"


def _takes(annotation: Any, held: Held) -> bool:
    """Whether a parameter with this annotation accepts what the regions of an argument hold."""
    if isinstance(held, Several):
        return any(_takes_all(member, held) for member in _members(annotation))
    return any(_is_a(held, member) for member in _members(annotation))


def _takes_all(annotation: Any, held: Several) -> bool:
    if get_origin(annotation) not in held.containers:
        return annotation in (*held.containers, object, Any)
    elements = [argument for argument in get_args(annotation) if argument is not Ellipsis]
    return all(any(_takes(element, kind) for element in elements) for kind in held.kinds)


def _gives(annotation: Any, kind: type) -> bool:
    """Whether everything that an annotation allows can be written as `kind`; None means 'not written'."""
    members = [member for member in _members(annotation) if member is not type(None)]
    return bool(members) and all(member is Any or _is_a(_plain(member), kind) for member in members)


def _may_be(annotation: Any, kind: type) -> bool:
    members = _members(annotation)
    # Literals, containers and type variables cannot be compared with the class of a value; pydantic has checked settings already.
    if not all(isinstance(member, type) for member in members) or any(get_origin(member) for member in members):
        return True
    return any(_is_a(kind, member) or (member is float and issubclass(kind, int | np.floating)) for member in members)


def _members(annotation: Any) -> tuple[Any, ...]:
    """The alternatives of a union; otherwise the annotation alone."""
    return get_args(annotation) if get_origin(annotation) in (Union, types.UnionType) else (annotation,)


def _plain(annotation: Any) -> Any:
    return get_origin(annotation) or annotation


def _is_a(kind: Any, annotation: Any) -> bool:
    if annotation in (Any, object) or getattr(annotation, "_is_protocol", False):
        return True
    plain = _plain(annotation)
    return isinstance(plain, type) and isinstance(kind, type) and issubclass(kind, plain)


def _name(kind: Any) -> str:
    if isinstance(kind, Several):
        return f"{kind.word} of {' and '.join(map(_name, kind.kinds)) or 'nothing'}"
    return kind.__name__ if isinstance(kind, type) and not get_origin(kind) else str(kind).replace("typing.", "")
