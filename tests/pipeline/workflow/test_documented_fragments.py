"""Every piece of YAML in the documentation, inline, indented or fenced, is one that some setting of that name takes."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, get_args

import pytest
import yaml
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from orthomill.pipeline.serving.node.access import TokenFile
from orthomill.pipeline.workflow.workflow_checks import kind_of
from orthomill.schemas.project import Project
from orthomill.tasks.catalogue import STAGES

ROOT = Path(__file__).parents[3]
PAGES = sorted([ROOT / "README.md", *(page for page in (ROOT / "docs").rglob("*.md") if "api" not in page.parts)])
FENCED = re.compile(r"```.*?```", re.DOTALL)
INLINE = re.compile(r"`(\w+: \{[^`]*\})`")
INDENTED = re.compile(r"(?:^(?: {4,}.*)?\n)+", re.MULTILINE)
YAML_LINE = re.compile(r"\s*(- )?\w+:( |$)|\s*#")
LEFT_OPEN = "..."


def pieces(page: Path) -> Iterator[str]:
    """Pieces of YAML of a page without whole workflows, which are loaded by a test of their own."""
    text = FENCED.sub("", page.read_text())
    yield from (" ".join(found.split()) for found in INLINE.findall(text))
    for block in INDENTED.findall(text):
        lines = [line for line in block.split("\n") if line.strip()]
        if lines and all(map(YAML_LINE.match, lines)):
            yield block


PIECES = [(page, piece) for page in PAGES for piece in pieces(page)]


def models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from models_in(inner)


def settings_by_name() -> dict[str, list[Any]]:
    """Every setting of a workflow under its name, however deep it lies; a stage is under its kind."""
    found: dict[str, list[Any]] = {kind_of(stage): [stage] for stage in STAGES}
    seen: set[type[BaseModel]] = set()
    waiting: list[type[BaseModel]] = [Project, *STAGES]
    while waiting:
        if (model := waiting.pop()) in seen:
            continue
        seen.add(model)
        for name, field in model.model_fields.items():
            # that a union is told apart by its kind stands beside the annotation
            found.setdefault(name, []).append(Annotated[field.annotation, Field(discriminator=field.discriminator)])
            waiting += models_in(field.annotation)
    return found


SETTINGS = settings_by_name()


def mistakes(annotation: Any, value: Any) -> list[str]:
    """What a setting does not take of `value`; what the page leaves open (...) is no mistake, nor what it leaves to other lines."""
    try:
        TypeAdapter(annotation).validate_python(value)
    except ValidationError as error:
        return [one["msg"] for one in error.errors() if one["input"] != LEFT_OPEN and one["type"] != "missing"]
    return []


def untaken(piece: str) -> list[str]:
    """Names of a piece of YAML whose value no setting of that name takes."""
    content = yaml.safe_load(piece)
    if isinstance(content, list):
        content = {"stages": content}
    entries = [(stage["kind"], stage) for stage in content.pop("stages", [])] + list(content.items())
    return [name for name, value in entries if all(mistakes(one, value) for one in SETTINGS.get(name, ())) or name not in SETTINGS]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pieces_of_yaml_are_settings(page):
    assert [(piece, wrong) for piece in pieces(page) if (wrong := untaken(piece))] == []


@pytest.mark.parametrize(
    "piece",
    [
        "grid: {kind: plain}",
        "control: {kind: files, pionts: a.csv}",
        "masks: 3",
        "gird: {kind: map}",
        "fill: {kind: none, reach: x}",
    ],
)
def test_a_wrong_piece_is_found(piece):
    assert untaken(piece)


def test_pieces_are_found_in_all_their_forms():
    assert len(PIECES) > 30 and sum("\n" in piece for _, piece in PIECES) >= 5


def test_the_tokens_of_the_node_are_what_it_reads():
    (block,) = re.findall(r"```yaml\n(tokens:.*?)```", (ROOT / "docs/serve.md").read_text(), re.DOTALL)
    assert [token.name for token in TokenFile.model_validate(yaml.safe_load(block)).tokens] == ["ana", "ben"]
