"""Settings that name a file of the project are of a type, so that the check of a workflow meets each, whatever it is called."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel


@dataclass(frozen=True)
class FileRole:
    """What a named file is: any file that a stage reads, or in particular a raster map."""

    is_map: bool = False


ProjectPath = Annotated[str, FileRole()]
"""a file, relative to the project's root; it must exist, and lie inside the project"""
ProjectMap = Annotated[str, FileRole(is_map=True)]
"""a raster map, relative to the project's root; it must exist, lie inside the project, and be readable as one"""


def file_roles(model: type[BaseModel]) -> dict[str, FileRole]:
    """The fields of a model that name files, or lists of files, with what the files are."""
    found = {}
    for name, field in model.model_fields.items():
        role = next((one for one in (*field.metadata, *_inside(field.annotation)) if isinstance(one, FileRole)), None)
        if role is not None:
            found[name] = role
    return found


def words_of(model: type[BaseModel], name: str) -> frozenset[str]:
    """The words that a field may hold instead of the name of a file."""
    parts = (model.model_fields[name].annotation, *_inside(model.model_fields[name].annotation))
    return frozenset(word for part in parts if get_origin(part) is Literal for word in get_args(part) if isinstance(word, str))


def _inside(annotation: Any) -> Iterator[Any]:
    """Everything that a type is made of: members of a union, items of a list, remarks of an annotation."""
    for part in get_args(annotation):
        yield part
        yield from _inside(part)
