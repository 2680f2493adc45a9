"""Mistakes become sentences: what was found, what is allowed, what was probably meant, and never a raw message of a library."""

import re
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from orthomill.pipeline.workflow.field_words import (
    allowed,
    bounds,
    locate,
    number,
    one_of,
    optional,
    pattern_words,
    type_words,
    unit,
)
from orthomill.pipeline.workflow.mistakes import Mistakes, did_you_mean, found_words, nearest, place_words, stage_kind
from orthomill.pipeline.workflow.yaml_lines import read_yaml
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.settings import Settings, setting


class Shape(StrEnum):
    """Words to choose from."""

    ROUND = "round"
    SQUARE = "square"


class Inner(Settings):
    """A nested model."""

    kind: Literal["inner"] = "inner"
    size: int = setting(3, "Side.", "px", ge=1, le=9)


class Other(Settings):
    """Another variant."""

    kind: Literal["other"] = "other"


class Outer(Settings):
    """A model with every kind of field."""

    size: int = setting(..., "Side of a thing.", "px", ge=3, le=255)
    cell: float = setting(0.5, "Side of a cell.", "m", gt=0)
    shape: Shape = setting(Shape.ROUND, "Its shape.")
    pair: tuple[int, int] = setting((1, 2), "Two numbers.")
    names: tuple[str, ...] = setting((), "Names.", max_length=3)
    nested: Inner = setting(Inner(), "A nested model.")
    choice: Annotated[Inner | Other, Field(discriminator="kind")] = setting(Other(), "One of two.")
    many: tuple[Inner, ...] = setting((), "Several.")
    table: dict[str, float] = setting({}, "By name.")
    source: Path = setting(Path("a"), "A file.")
    note: str | None = setting(None, "A note.", min_length=1)


class Tilted(Settings):
    """A variant with a setting that is called as its kind is."""

    kind: Literal["normal"]
    normal: tuple[float, float, float] = setting(..., "A direction.")


class Sheet(Settings):
    """The same, around it."""

    kind: Literal["plane"]
    plane: Annotated[Tilted | Other, Field(discriminator="kind")] = setting(..., "Where it lies.")


class Sheets(Settings):
    """Several of them."""

    outputs: tuple[Annotated[Sheet | Other, Field(discriminator="kind")], ...] = setting(..., "What is made.", min_length=1)


@pytest.mark.parametrize(
    ("normal", "sentence"),
    [
        ("[0, 1]", "outputs > entry 1 > plane > normal: is a list; must be 3 numbers in brackets."),
        ("[0, 1, 2, 3]", "outputs > entry 1 > plane > normal: is a list; must be 3 numbers in brackets."),
        ("up", "outputs > entry 1 > plane > normal: is 'up'; must be 3 numbers in brackets."),
        ("", "outputs > entry 1 > plane > normal: is empty; must be 3 numbers in brackets."),
    ],
)
def test_a_setting_that_is_called_as_its_kind_has_its_own_place(normal, sentence):
    document = read_yaml(f"outputs: [{{kind: plane, plane: {{kind: normal, normal: {normal}}}}}]")
    mistakes = Mistakes("a.yaml", document)
    with pytest.raises(ValidationError) as caught:
        TypeAdapter(Sheets).validate_python(document.value)
    mistakes.add_all(caught.value, Sheets, ())
    assert [f"{mistake.place}: {mistake.sentence}" for mistake in mistakes.found] == [sentence]


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        ("{kind: other, siz: 3}", "outputs > entry 1 > siz: there is no such setting. entry 1 has no settings."),
        ("{siz: 3}", "outputs > entry 1: has no kind; 'kind' must be one of plane, other."),
        ("{kind: plain}", "outputs > entry 1 > kind: there is no kind of outputs 'plain'; did you mean 'plane'? Allowed: one of"),
    ],
)
def test_a_wrong_entry_does_not_make_its_list_too_short(entry, sentence):
    document = read_yaml(f"outputs: [{entry}]")
    mistakes = Mistakes("a.yaml", document)
    with pytest.raises(ValidationError) as caught:
        TypeAdapter(Sheets).validate_python(document.value)
    mistakes.add_all(caught.value, Sheets, ())
    (mistake,) = mistakes.found
    assert f"{mistake.place}: {mistake.sentence}".startswith(sentence)


def sentences(text: str) -> list[str]:
    """The mistakes in a document that should be an `Outer`, without file and line."""
    document = read_yaml(text)
    mistakes = Mistakes("a.yaml", document)
    try:
        TypeAdapter(Outer).validate_python(document.value)
    except ValidationError as error:
        mistakes.add_all(error, Outer, ())
    return [f"{mistake.place}: {mistake.sentence}" for mistake in sorted(mistakes.found)]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{size: 2}", "size: is 2 px; must be at least 3 px."),
        ("{size: 300}", "size: is 300 px; must be at most 255 px."),
        ("{size: many}", "size: is 'many'; must be a whole number (px), from 3 to 255."),
        ("{size: 2.5}", "size: is 2.5 px; must be a whole number (px), from 3 to 255."),
        ("{size: 9, cell: 0}", "cell: is 0 m; must be greater than 0 m."),
        ("{size: 9, cell: 25 mm}", "cell: is '25 mm'; must be a number (m), greater than 0. Write the number alone, in m: 0.025."),
        ("{size: 9, cell: 4 apples}", "cell: is '4 apples'; must be a number (m), greater than 0. Write the number alone, in m."),
        ("{size: 9, cell: '1,234.5'}", "cell: is '1,234.5'; must be a number (m), greater than 0."),
        ("{size: 9, shape: oval}", "shape: is 'oval'; must be one of round, square."),
        ("{size: 9, pair: [1]}", "pair: is a list; must be 2 whole numbers in brackets."),
        ("{size: 9, pair: [1, x]}", "pair > entry 2: is 'x'; must be 2 whole numbers in brackets."),
        ("{size: 9, names: [a, b, c, d]}", "names: is a list; must be a list of texts, at most 3 entries."),
        ("{size: 9, names: [1]}", "names > entry 1: is 1; must be a list of texts, at most 3 entries."),
        ("{size: 9, nested: 3}", "nested: is 3; must be a mapping."),
        ("{size: 9, nested: {size: 10}}", "nested > size: is 10 px; must be at most 9 px."),
        ("{size: 9, choice: {kind: inner, size: 0}}", "choice > size: is 0 px; must be at least 1 px."),
        (
            "{size: 9, choice: {kind: iner}}",
            "choice > kind: there is no kind of choice 'iner'; did you mean 'inner'? Allowed: one of inner, other.",
        ),
        (
            "{size: 9, choice: {inner: {size: 2}}}",
            "choice: write 'kind: inner' instead of 'inner:', with its settings below it in the same column.",
        ),
        (
            "{size: 9, many: [{size: 2}, {sise: 3}]}",
            "many > entry 2 > sise: there is no such setting; did you mean 'size'? Settings of entry 2 are: size.",
        ),
        ("{size: 9, table: {a: x}}", "table > a: is 'x'; must be a mapping."),
        ("{size: 9, note: ''}", "note: is ''; must be a text, not empty or null."),
        ("{cell: 1}", "size: is missing; it must be a whole number (px), from 3 to 255. Side of a thing."),
    ],
)
def test_one_mistake_is_one_sentence(text, sentence):
    assert sentences(text) == [sentence]


def test_a_mistyped_name_is_not_reported_as_missing_too():
    (line,) = sentences("{siz: 9}")
    assert line.startswith("siz: there is no such setting; did you mean 'size'? Settings of a workflow are: size, cell,")


def test_every_mistake_is_reported_in_the_order_of_the_file():
    document = read_yaml("cell: 0\nshape: oval\nsize: 1\n")
    mistakes = Mistakes("a.yaml", document)
    with pytest.raises(ValidationError) as caught:
        Outer.model_validate(document.value)
    mistakes.add_all(caught.value, Outer, ())
    with pytest.raises(WorkflowError) as reported:
        mistakes.raise_if_any()
    assert [line.split(":")[1] for line in str(reported.value).splitlines()] == ["1", "2", "3"]


def test_the_same_mistake_is_recorded_once_and_none_raises_nothing():
    mistakes = Mistakes("a.yaml", read_yaml("a: 1\n"))
    mistakes.raise_if_any()
    mistakes.add(("a",), "is wrong.")
    mistakes.add(("a",), "is wrong.")
    with pytest.raises(WorkflowError, match=r"\Aa\.yaml:1: a: is wrong\.\Z"):
        mistakes.raise_if_any()


@settings(max_examples=100, deadline=None)
@given(word=st.text(max_size=80))
def test_text_of_the_file_cannot_steer_a_terminal(word):
    mistakes = Mistakes("a.yaml", read_yaml("a: 1\n"))
    mistakes.add((word,), f"is {found_words(word)}; must be a number.")
    with pytest.raises(WorkflowError) as caught:
        mistakes.raise_if_any()
    assert str(caught.value).isprintable()


# --- words -------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("annotation", "words"),
    [
        (int, "a whole number"),
        (float | None, "a number or null"),
        (bool, "true or false"),
        (str, "a text"),
        (Path, "a path"),
        (Shape, "one of round, square"),
        (Literal["a"], "a"),
        (Literal["a", "b"], "one of a, b"),
        (tuple[float, float, float], "3 numbers in brackets"),
        (tuple[int, str], "2 values in brackets"),
        (tuple[str, ...], "a list of texts"),
        (list[Inner], "a list of mappings"),
        (Inner, "a mapping"),
        (dict[str, int], "a mapping"),
        (Inner | Other, "a mapping with kind: one of inner, other"),
        (int | str, "a whole number or a text"),
        (object, "a value"),
    ],
)
def test_types_in_words(annotation, words):
    assert type_words(annotation) == words


@pytest.mark.parametrize(
    ("field", "words"),
    [
        (Field(ge=1, le=9), ("from 1 to 9",)),
        (Field(gt=0, lt=1), ("greater than 0", "less than 1")),
        (Field(ge=0.5), ("at least 0.5",)),
        (Field(ge=64, le=512, multiple_of=64), ("from 64 to 512", "a multiple of 64")),
        (Field(), ()),
    ],
)
def test_bounds_in_words(field, words):
    class Model(BaseModel):
        value: float = field

    assert bounds(Model.model_fields["value"]) == words


def test_units_patterns_and_choices_in_words():
    assert unit(Outer.model_fields["size"]) == "px" and unit(Outer.model_fields["shape"]) == "" and unit(None) == ""
    assert pattern_words("[A-Z]+") == "of the form [A-Z]+"
    assert one_of(("x",)) == "x" and one_of(("x", "y", 3)) == "one of x, y, 3"
    assert optional(int | None) and not optional(int)
    assert allowed(Outer.model_fields["note"]) == "a text, not empty or null"


@settings(max_examples=200, deadline=None)
@given(value=st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_in_words_reads_back_exactly(value):
    assert float(number(value)) == value


@pytest.mark.parametrize(
    ("value", "measure", "words"),
    [
        (None, "px", "empty"),
        (5000, "px", "5000 px"),
        (0.5, "", "0.5"),
        (float("inf"), "m", "inf m"),
        ("abc", "px", "'abc'"),
        ("x" * 70, "", f"'{'x' * 57}...'"),
        ([1], "px", "a list"),
        ({}, "px", "a mapping"),
    ],
)
def test_what_was_found_in_words(value, measure, words):
    assert found_words(value, measure) == words


@settings(max_examples=100, deadline=None)
@given(name=st.permutations("abcdefgh_").map("".join), place=st.integers(0, 8))
def test_a_name_with_one_wrong_letter_or_in_capitals_is_recognised(name, place):
    wrong = name[:place] + "X" + name[place + 1 :]
    assert nearest(wrong, [name, "0123456789"]) == name and nearest(name.upper(), [name]) == name


def test_nothing_is_suggested_for_what_is_nothing_like_any_name():
    assert nearest("zzz", ["size", "cell"]) is None and did_you_mean("zzz", ["size"]) == "."
    assert did_you_mean("sise", ["size"]) == "; did you mean 'size'?"


def test_places_are_called_as_the_file_calls_them():
    document = read_yaml("stages:\n  - matching\n  - kind: painting\n    levels: [1, 2]\n  - {size: 3}\n")
    assert place_words(("stages", 0, "size"), document) == "stages > matching > size"
    assert place_words(("stages", 1, "levels", 1), document) == "stages > painting > levels > entry 2"
    assert place_words(("stages", 2, "size"), document) == "stages > entry 3 > size"
    assert stage_kind(document, 9) is None and stage_kind(document, 0) == "matching"


@pytest.mark.parametrize(
    ("loc", "path", "name"),
    [
        (("choice", "inner", "size"), ("choice", "size"), "size"),
        (("many", 1, "size"), ("many", 1, "size"), "size"),
        (("pair", 1), ("pair", 1), "pair"),
        (("table", "a"), ("table", "a"), "table"),
        (("nowhere",), ("nowhere",), None),
    ],
)
def test_pydantic_s_location_is_the_place_in_the_file(loc, path, name):
    place = locate(loc, Outer)
    assert place.path == path
    assert place.field is (None if name is None else place.model.model_fields[name])


def test_no_sentence_speaks_of_the_library():
    for text in ("[1]", "{size: {}}", "{size: [1]}", "{choice: 3}", "{many: 3}", "{table: 3}", "{source: 3}", "{pair: {}}"):
        for line in sentences(text):
            assert not re.search(r"Input should|pydantic|valid (integer|string)|dict|tuple", line), line
