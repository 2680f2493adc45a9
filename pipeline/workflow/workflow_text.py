"""A workflow as YAML text with every default filled in, each line with its sentence and unit; reading it gives equal models."""

import re
from collections.abc import Iterator
from typing import Any

import yaml
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import to_jsonable_python

from orthomill.pipeline.workflow.field_words import sentence, unit
from orthomill.schemas.project import Project
from orthomill.schemas.stage_contract import Stage

_PLAIN = re.compile(r"[A-Za-z_./][A-Za-z0-9_./+-]*(:[A-Za-z0-9_./+-]+)*\Z")
_WORDS_OF_YAML = frozenset({"null", "true", "false", "yes", "no", "on", "off", "y", "n"})


def workflow_text(project: Project, stages: tuple[Stage, ...]) -> str:
    """The YAML text of a workflow."""
    lines = [*_fields(project, ""), "", "stages:"]
    for stage in stages:
        lines += ["", *_entry(stage, "  ")]
    return "\n".join(lines) + "\n"


def settings_text(model: BaseModel) -> str:
    """The YAML text of one model."""
    return "\n".join(_fields(model, "")) + "\n"


def comment(words: str, measure: str) -> str:
    """ "  # Side of a tile. [px]", or nothing where there are neither words nor a unit."""
    text = " ".join([*([words] if words else []), *([f"[{measure}]"] if measure else [])])
    return f"  # {text}" if text else ""


def _fields(model: BaseModel, indent: str) -> Iterator[str]:
    data = model.model_dump(mode="json")
    for name, field in type(model).model_fields.items():
        note = comment(sentence(field), unit(field))
        yield from _named(f"{indent}{name}:", getattr(model, name), data[name], note, indent + "  ")


def _named(start: str, value: Any, data: Any, note: str, indent: str) -> Iterator[str]:
    # Nested models are written in block style, so that every one of their settings has its own line and comment.
    if isinstance(value, BaseModel):
        yield f"{start}{note}" if data else f"{start} {{}}{note}"
        yield from _fields(value, indent)
    elif isinstance(value, tuple | list) and any(isinstance(item, BaseModel) for item in value):
        yield f"{start}{note}"
        for item in value:
            yield from _entry(item, indent)
    else:
        yield f"{start} {flow(data)}{note}"


def _entry(model: BaseModel, indent: str) -> Iterator[str]:
    """A model as an entry of a list: the first line behind a dash."""
    lines = list(_fields(model, indent + "  "))
    yield f"{indent}- {lines[0].lstrip()}" if lines else f"{indent}- {{}}"
    yield from lines[1:]


def default_text(field: FieldInfo) -> str:
    """The default of a field as YAML on one line."""
    return flow(to_jsonable_python(field.get_default(call_default_factory=True)))


def flow(data: Any) -> str:
    """Plain data as YAML on one line; reading it gives the same data again."""
    if data is None:
        return "null"
    if isinstance(data, bool):  # before int, of which bool is a subclass
        return "true" if data else "false"
    if isinstance(data, int):
        return str(data)
    if isinstance(data, float):
        return _float(data)
    if isinstance(data, list):
        return f"[{', '.join(flow(item) for item in data)}]"
    if isinstance(data, dict):
        return f"{{{', '.join(f'{flow(str(key))}: {flow(value)}' for key, value in data.items())}}}"
    return _text(str(data))


def _float(value: float) -> str:
    """The shortest text that reads as the same number."""
    # YAML 1.1 readers take "1e-05" for a word and "1.0e-05" for a number.
    mantissa, exponent, power = repr(value).partition("e")
    return f"{mantissa}{'' if '.' in mantissa or not exponent else '.0'}{exponent}{power}"


def _text(value: str) -> str:
    # Quoted wherever some YAML reader might see a number, a truth value or a document marker.
    if _PLAIN.match(value) and value.lower() not in _WORDS_OF_YAML and not value.startswith((".", "---")):
        return value
    return yaml.safe_dump(value, default_style='"', width=float("inf"), allow_unicode=True).rstrip("\n")
