"""Settings in words: what a field of a model may hold.

Error sentences, the settings reference, the workflow as run and the starting workflow all take their words from here, and this
file takes them from the fields themselves; nothing about a setting is written down twice.
"""

import types
import typing
from dataclasses import dataclass
from enum import Enum
from pathlib import PurePath
from typing import Annotated, Any, Literal, Union

import annotated_types
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from orthomill.schemas.project import Project

_OR_NULL = " or null"
_TYPES: dict[type, tuple[str, str]] = {
    bool: ("true or false", "truth values"),
    int: ("a whole number", "whole numbers"),
    float: ("a number", "numbers"),
    str: ("a text", "texts"),
}
"""type -> one of it, several of it"""


@dataclass(frozen=True)
class Place:
    """A place in a model's data: the path there, the innermost model around it, and the field (None: there is no such field)."""

    path: tuple[str | int, ...]
    model: type[BaseModel] | None
    field: FieldInfo | None
    annotation: Any = None
    """of the value there: that of an entry where the field is a list"""


def locate(loc: tuple[str | int, ...], annotation: Any) -> Place:
    """The place that pydantic's error location refers to, without the tags of unions, which are not in the file."""
    path: tuple[str | int, ...] = ()
    model, field, tagged = None, None, False
    for element in loc:
        annotation = _bare(annotation)
        # pydantic inserts the tag of a variant into the location, once: `{kind: plane, plane: ...}` has a setting so called.
        tagged = not tagged and element in variants(annotation)
        if tagged:
            annotation = variants(annotation)[str(element)]
        elif is_model(annotation):
            model, field = annotation, annotation.model_fields.get(str(element))
            path, annotation = (*path, element), field.annotation if field else None
        elif typing.get_origin(annotation) in (tuple, list, dict):
            path, annotation = (*path, element), _item_type(annotation, element)
        else:
            break
    if is_model(_bare(annotation)) and model is None:
        model = _bare(annotation)
    return Place(path, model, field, annotation)


def _item_type(annotation: Any, element: str | int) -> Any:
    arguments = typing.get_args(annotation)
    if typing.get_origin(annotation) is dict:
        return arguments[1]
    # tuple[int, str] has a type per place; tuple[int, ...] and list[int] have one for all.
    fixed = typing.get_origin(annotation) is tuple and Ellipsis not in arguments
    return arguments[element] if fixed and isinstance(element, int) and element < len(arguments) else arguments[0]


def is_model(annotation: Any) -> bool:
    """Whether an annotation is a pydantic model."""
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def variants(annotation: Any) -> dict[str, type[BaseModel]]:
    """kind -> model of a tagged union; empty for anything else."""
    members = [member for member in _members(annotation) if is_model(member) and "kind" in member.model_fields]
    return {kind: member for member in members for kind in typing.get_args(member.model_fields["kind"].annotation)}


def _members(annotation: Any) -> tuple[Any, ...]:
    """The members of a union without None; the annotation itself when it is none."""
    annotation = _without_annotated(annotation)
    # A | B and Union[A, B] have different origins, and unions may be nested in Annotated members of other unions.
    if typing.get_origin(annotation) in (Union, types.UnionType):
        nested = [_members(member) for member in typing.get_args(annotation) if member is not type(None)]
        return tuple(member for members in nested for member in members)
    return (annotation,)


def _without_annotated(annotation: Any) -> Any:
    while typing.get_origin(annotation) is Annotated:
        annotation = typing.get_args(annotation)[0]
    return annotation


def _bare(annotation: Any) -> Any:
    members = _members(annotation)
    return members[0] if len(members) == 1 else _without_annotated(annotation)


def optional(annotation: Any) -> bool:
    """Whether null is allowed."""
    annotation = _without_annotated(annotation)
    return typing.get_origin(annotation) in (Union, types.UnionType) and type(None) in typing.get_args(annotation)


def type_words(annotation: Any) -> str:
    """What a value of this type is called: "a whole number", "one of ellipse, square", "2 numbers in brackets"."""
    tags = variants(annotation)
    words = [_member_words(member) for member in _members(annotation)]
    # All variants of a tagged union are mappings: one phrase with their kinds replaces "a mapping or a mapping".
    if len(tags) > 1:
        words = [f"a mapping with kind: {one_of(tags)}", *(word for word in words if word != "a mapping")]
    return " or ".join(words) + (_OR_NULL if optional(annotation) else "")


def _member_words(annotation: Any) -> str:
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Literal:
        return one_of(arguments)
    if origin in (tuple, list):
        return _list_words(origin, arguments)
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return one_of(member.value for member in annotation)
    if isinstance(annotation, type) and issubclass(annotation, PurePath):
        return "a path"
    if is_model(annotation) or origin is dict or annotation is dict:
        return "a mapping"
    return _TYPES.get(annotation, ("a value", "values"))[0]


def _list_words(origin: Any, arguments: tuple[Any, ...]) -> str:
    bare = [_without_annotated(argument) for argument in arguments if argument is not Ellipsis]
    plural = _TYPES.get(bare[0], ("", "mappings" if is_model(bare[0]) or variants(bare[0]) else "values"))[1]
    if origin is tuple and Ellipsis not in arguments:
        return f"{len(bare)} {plural if len(set(bare)) == 1 else 'values'} in brackets"
    return f"a list of {plural}"


def one_of(choices: Any) -> str:
    """ "x", or "one of x, y"."""
    names = [str(choice) for choice in choices]
    return names[0] if len(names) == 1 else f"one of {', '.join(names)}"


def unit(field: FieldInfo | None) -> str:
    """The unit of a field; empty for names, choices and pure numbers."""
    extra = field.json_schema_extra if field else None
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""


def sentence(field: FieldInfo | None) -> str:
    """The field's one sentence, on one line."""
    return " ".join((field.description or "").split()) if field else ""


def bounds(field: FieldInfo) -> tuple[str, ...]:
    """The bounds of a field in words: ("from 128 to 8192", "a multiple of 64")."""
    # pydantic keeps bounds as objects of annotated_types, one per bound.
    limits = {type(item).__name__: item for item in field.metadata}
    low = _limit(limits, (("Ge", "ge", "at least"), ("Gt", "gt", "greater than")))
    high = _limit(limits, (("Le", "le", "at most"), ("Lt", "lt", "less than")))
    if "Ge" in limits and "Le" in limits:
        low, high = [f"from {number(limits['Ge'].ge)} to {number(limits['Le'].le)}"], []
    step = _limit(limits, (("MultipleOf", "multiple_of", "a multiple of"),))
    return tuple(low + high + step + _lengths(field) + _patterns(field))


def _limit(limits: dict[str, Any], kinds: tuple[tuple[str, str, str], ...]) -> list[str]:
    return [f"{words} {number(getattr(limits[kind], attribute))}" for kind, attribute, words in kinds if kind in limits]


def _lengths(field: FieldInfo) -> list[str]:
    things = "characters" if _bare(field.annotation) is str else "entries"
    words = []
    for item in field.metadata:
        if isinstance(item, annotated_types.MinLen):
            words.append("not empty" if item.min_length == 1 else f"at least {item.min_length} {things}")
        if isinstance(item, annotated_types.MaxLen):
            words.append(f"at most {item.max_length} {things}")
    return words


def _patterns(field: FieldInfo) -> list[str]:
    return [pattern_words(item.pattern) for item in field.metadata if getattr(item, "pattern", None)]


def pattern_words(pattern: str) -> str:
    """A regular expression in words, if there are words for it."""
    return _PATTERNS.get(pattern, f"of the form {pattern}")


def _project_pattern() -> str:
    return next(item.pattern for item in Project.model_fields["project"].metadata if getattr(item, "pattern", None))


# The pattern is taken from the field itself, so that a change there cannot leave an outdated description here.
_PATTERNS = {_project_pattern(): "made of lower-case letters, digits, - and _, beginning with a letter or digit"}


def allowed(field: FieldInfo) -> str:
    """Everything a field may hold, with its unit: "a whole number (px), from 128 to 8192, a multiple of 64"."""
    # "or null" is moved to the end, so that the bounds follow the type they belong to.
    words, null = type_words(field.annotation).removesuffix(_OR_NULL), optional(field.annotation)
    measure = f" ({unit(field)})" if unit(field) else ""
    return ", ".join([words + measure, *bounds(field)]) + (_OR_NULL if null else "")


def number(value: float) -> str:
    """A number without a needless ".0": 0.3, 512, 1e-06."""
    # Above 1e15 not every whole number is a float64, and writing all digits would pretend so.
    return str(int(value)) if float(value).is_integer() and abs(value) < 1e15 else repr(float(value))
