"""The settings as a page, generated from the schemas: every one with its type, default, bounds, unit and sentence.

The page is a function of the models alone: it is made where the documentation is built, and is not in the repository.
"""

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from orthomill.pipeline.workflow.field_words import bounds, is_model, sentence, type_words, unit, variants
from orthomill.pipeline.workflow.workflow_checks import kind_of
from orthomill.pipeline.workflow.workflow_text import default_text
from orthomill.schemas.project import Project
from orthomill.schemas.stage_contract import Stage

_HEAD = """# Settings

A workflow file has the settings of the project and the list `stages`,
where each entry has a `kind` and the settings of that stage. What is left out has its default; `orthomill run` writes the workflow
with every default filled in to `runs/<project>/workflow.yaml`. Paths are relative to the project's root, the folder that holds
`workflows/`. Numbers are given alone, in the unit of the column; where a setting is a mapping with `kind`, each kind has a table.
"""
_TABLE = ("| setting | what it holds | default | bounds | unit | meaning |", "| --- | --- | --- | --- | --- | --- |")


def settings_reference(catalogue: tuple[type[Stage], ...]) -> str:
    """The whole page as Markdown."""
    lines = [*_HEAD.splitlines(), "", "## The project", "", *_section(Project, "", {})]
    for stage in catalogue:
        title = stage.title[:1].upper() + stage.title[1:].rstrip(".")
        lines += ["", f"## {kind_of(stage)}", "", f"{title}.", "", *_section(stage, "", {})]
    return "\n".join(lines).rstrip() + "\n"


def _section(model: type[BaseModel], prefix: str, written: dict[type[BaseModel], str]) -> Iterator[str]:
    """The table of a model, then one section per kind of its tagged unions and per nested model, each written once."""
    fields = {name: field for name, field in model.model_fields.items() if name != "kind"}
    # `kind` is left out of the tables: it is in the heading, and its only value is fixed.
    yield from _table(fields) if fields else ("No settings.",)
    for name, field in fields.items():
        for kind, part in _models_in(field.annotation):
            heading = f"`{prefix}{name}`{f' of kind `{kind}`' if kind else ''}"
            # Photographs, windows and camera sources occur in several places; one table each keeps the page readable.
            if part in written:
                yield from ("", f"### {heading}", "", f"As {written[part]}.")
                continue
            written[part] = heading
            inner = f"{prefix}{name}{f' ({kind})' if kind else ''} > "
            yield from ("", f"### {heading}", "", *_about(part), *_section(part, inner, written))


def _about(model: type[BaseModel]) -> tuple[str, ...]:
    # The model's own docstring only: an inherited one describes the base class.
    own = model.__dict__.get("__doc__")
    return (" ".join(own.split()), "") if own else ()


def _models_in(annotation: Any) -> Iterator[tuple[str, type[BaseModel]]]:
    """(kind, model) of everything nested in a field; kind is empty for a plain model."""
    tags = variants(annotation)
    if tags:
        yield from tags.items()
    elif is_model(annotation):
        yield "", annotation
    else:
        for argument in getattr(annotation, "__args__", ()):
            yield from _models_in(argument)


def _table(fields: dict[str, FieldInfo]) -> Iterator[str]:
    yield from _TABLE
    for name, field in fields.items():
        cells = (f"`{name}`", type_words(field.annotation), _default(field), ", ".join(bounds(field)), unit(field), sentence(field))
        yield f"| {' | '.join(_cell(cell) for cell in cells)} |"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _default(field: FieldInfo) -> str:
    return "required" if field.is_required() else f"`{default_text(field)}`"
