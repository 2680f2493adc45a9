"""Settings of a workflow as options of the NodeODM contract: those that users turn, with type, domain and help."""

import math
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, TypeAdapter
from pydantic.fields import FieldInfo

from orthomill.pipeline.workflow.field_words import allowed, number, sentence, unit, variants
from orthomill.pipeline.workflow.workflow_checks import kind_of
from orthomill.pipeline.workflow.workflow_text import default_text
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.project import Project
from orthomill.schemas.stage_contract import Stage

TURNED = (
    "crs",
    "tile",
    "tolerances.plan",
    "tolerances.height",
    "photos.max_megapixels",
    "tie_points.search",
    "tie_points.search_side",
    "tie_points.max_features",
    "tie_points.contrast",
    "tie_points.ratio",
    "tie_points.nearest",
    "orientation.least_matches",
    "orientation.gnss_shift",
    "orientation.looking",
    "orientation.rejection",
    "epipolar.level",
    "epipolar.height_margin",
    "epipolar.height_room",
    "densification.cell",
    "densification.matching",
    "densification.fill",
    "densification.points.most_per_cell",
    "dsm_check.pairs_per_place",
    "dsm_check.step",
    "dsm_check.apply",
    "dsm_check.significance",
    "dsm_check.tolerance",
    "terrain.widest_object",
    "terrain.slope",
    "terrain.steepest",
    "terrain.max_gap",
    "texture.cell",
    "texture.weights",
    "texture.rejection",
    "texture.best",
    "texture.balance",
    "texture.holes",
    "texture.feather",
    "accuracy.steepest",
)
"""places of settings that a client is offered; all others are settings of a workflow of one's own"""


@dataclass(frozen=True)
class NodeOption:
    """An option as the contract writes it: the value is a text."""

    name: str
    type: str
    value: str
    domain: str | list[str]
    help: str

    def as_json(self) -> dict[str, Any]:
        """The object of GET /options."""
        return {"name": self.name, "type": self.type, "value": self.value, "domain": self.domain, "help": self.help}


def offered(catalogue: tuple[type[Stage], ...]) -> Iterator[NodeOption]:
    """The settings that are offered, in the order of a workflow."""
    fields = fields_offered(catalogue)
    for place, field in fields.items():
        kind, domain = _type(field)
        measure = f" ({unit(field)})" if unit(field) else ""
        default = "" if field.is_required() else _default(field)
        yield NodeOption(place, kind, default, domain, f"{sentence(field)}{measure}")


def fields_offered(catalogue: tuple[type[Stage], ...]) -> dict[str, FieldInfo]:
    """The fields of the settings that are offered, by their places."""
    stages = {kind_of(stage): stage for stage in catalogue}
    found = {}
    for place in TURNED:
        first, *rest = place.split(".")
        model: Any = stages.get(first, Project)
        for name in rest if first in stages else [first, *rest]:
            field = model.model_fields[name]
            model = field.annotation
        found[place] = field
    return found


def checked_value(place: str, field: FieldInfo, value: Any) -> Any:
    """The value of a setting as a workflow holds it, from what clients send: numbers may be texts. Raises WorkflowError with what
    is allowed."""
    kinds = variants(field.annotation)
    plain = _plain(value)
    try:
        if isinstance(plain, float) and not math.isfinite(plain):
            raise ValueError
        # Settings refuse unknown names and wrong types in the same way as in a workflow file.
        kind: Any = Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation
        checked: TypeAdapter[Any] = TypeAdapter(kind)
        given = {"kind": plain} if kinds and isinstance(plain, str) and plain in kinds else plain
        checked.validate_python(given)
    except (ValueError, OverflowError, RecursionError):
        if isinstance(value, str) and plain is not value:
            return checked_value(place, field, _Text(value))
        shown = str(value)[:60]
        choices = ", ".join(kinds) if kinds else ""
        raise WorkflowError(f"{place} is {shown!r}; it is {f'one of {choices}' if kinds else allowed(field)}.") from None
    return str(given) if isinstance(given, _Text) else given


class _Text(str):
    """A text that is none of a number's, for settings that hold texts."""


def _plain(value: Any) -> Any:
    """Numbers and truth values out of the texts that web forms send."""
    if not isinstance(value, str) or isinstance(value, _Text):
        return value
    text = value.strip()
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _default(field: FieldInfo) -> str:
    if variants(field.annotation):
        return str(field.default.kind)
    return "" if field.default is None else default_text(field).strip('"')


def _type(field: FieldInfo) -> tuple[str, str | list[str]]:
    """Type and domain of a field in the terms of the contract."""
    annotation = field.annotation
    if kinds := variants(annotation):
        return "enum", [kind for kind, model in kinds.items() if not _asks(model)]
    if annotation is bool:
        return "bool", "bool"
    if typing.get_origin(annotation) is typing.Literal:
        return "enum", [str(choice) for choice in typing.get_args(annotation)]
    if annotation in (int, float):
        word = "integer" if annotation is int else "float"
        return ("int" if annotation is int else "float"), _numbers(word, field)
    return "string", allowed(field)


def _asks(model: type[BaseModel]) -> bool:
    return any(field.is_required() for name, field in model.model_fields.items() if name != "kind")


def _numbers(word: str, field: FieldInfo) -> str:
    limits = {type(item).__name__: item for item in field.metadata}
    low = next(((sign, getattr(limits[k], a)) for k, a, sign in (("Ge", "ge", "<="), ("Gt", "gt", "<")) if k in limits), None)
    high = next(((sign, getattr(limits[k], a)) for k, a, sign in (("Le", "le", "<="), ("Lt", "lt", "<")) if k in limits), None)
    if low and high:
        return f"{word}: {number(low[1])} {low[0]} x {high[0]} {number(high[1])}"
    if low:
        return f"{word} {low[0].replace('<', '>')} {number(low[1])}"
    return f"{word} {high[0]} {number(high[1])}" if high else word
