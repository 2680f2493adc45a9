"""Mistakes in a workflow file: collected together, each one a line with its place and a sentence that helps.

pydantic finds what does not fit the models; this file says it in the words of the workflow: where, what was found, what is
allowed, and what was probably meant.
"""

import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from orthomill.pipeline.workflow.field_words import (
    Place,
    allowed,
    locate,
    number,
    one_of,
    pattern_words,
    sentence,
    type_words,
    unit,
    variants,
)
from orthomill.pipeline.workflow.yaml_lines import Document, Path_
from orthomill.schemas.errors import WorkflowError, first_of
from orthomill.schemas.settings import RenamedSettings

_BOUNDS = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}
_METRES = {
    "m": 1.0,
    "metre": 1.0,
    "metres": 1.0,
    "meter": 1.0,
    "meters": 1.0,
    "km": 1000.0,
    "dm": 0.1,
    "cm": 0.01,
    "mm": 0.001,
    "um": 1e-6,
    "µm": 1e-6,
    "micrometres": 1e-6,
}
_NUMBER_WITH_UNIT = re.compile(r"\s*([-+]?[\d.,]+(?:[eE][-+]?\d+)?)\s*([^\d\s.,].*?)?\s*\Z")


@dataclass(frozen=True, order=True)
class Mistake:
    """One mistake. `place` is empty where it concerns the file as a whole."""

    line: int
    place: str
    sentence: str


@dataclass
class Mistakes:
    """All mistakes of one file so far. `file` is its name as the user knows it, `document` its content."""

    file: str
    document: Document
    found: list[Mistake] = field(default_factory=list)
    _known: set[object] = field(default_factory=set)
    """the mistakes that were found, and their lines and places: a file may hold tens of thousands"""

    def add(self, path: Path_, text: str, line: int | None = None) -> None:
        """Record a mistake at a place of the document (on another `line` if given); a repetition is ignored."""
        mistake = Mistake(line or self.document.line(path), place_words(path, self.document), text)
        if mistake not in self._known:
            self.found.append(mistake)
            self._known |= {mistake, (mistake.line, mistake.place)}

    def add_all(self, error: ValidationError, annotation: Any, base: Path_) -> None:
        """Record what pydantic found wrong in the value at `base`, which should be an `annotation`."""
        details = error.errors(include_url=False)
        taken, below = _meant(details, annotation), [other for other in details if other["type"] != "too_short"]
        for detail in details:
            place = locate(detail["loc"], annotation)
            # "siz: 9" is one mistake for the user, but an unknown and a missing field for pydantic.
            if detail["type"] == "missing" and place.path in taken:
                continue
            # pydantic counts the valid entries of a list: one that is wrong would make the list too short as well.
            if detail["type"] == "too_short" and any(other["loc"][: len(detail["loc"])] == detail["loc"] for other in below):
                continue
            text, path = _sentence(detail, place, self.document, base, annotation)
            # Members of a plain union report one error each for the same value: the first one names the declared type.
            if (self.document.line(path), place_words(path, self.document)) not in self._known:
                self.add(path, text)

    def raise_if_any(self) -> None:
        """Raises WorkflowError with the first mistakes, one a line, in the order of the file."""
        if self.found:
            raise WorkflowError(first_of([_line(self.file, mistake) for mistake in sorted(self.found)]))


def _line(file: str, mistake: Mistake) -> str:
    where = f"{mistake.place}: " if mistake.place else ""
    text = f"{file}:{mistake.line}: {where}{mistake.sentence}"
    # The text quotes the file: control characters in it must not reach the terminal as commands.
    return "".join(letter if letter.isprintable() else " " for letter in text)


def renamed_sentences(renamed: RenamedSettings, mistakes: Mistakes) -> tuple[str, ...]:
    """What to change in a file whose settings have former names, each with its place."""
    document = mistakes.document
    found = {}
    for setting in renamed:
        path = next(
            (path for path in document.lines if path[-1:] == (setting.former,) and document.at(path[:-1]) is setting.given), ()
        )
        place = place_words(path, document) or setting.former
        found[path or setting.former] = _line(mistakes.file, Mistake(document.line(path), place, setting.sentence))
    return tuple(found.values())


def place_words(path: Path_, document: Document) -> str:
    """ "stages > densification > window > max_axis_ratio": stages by their kind, other list entries by their number from 1."""
    words = []
    for depth, element in enumerate(path):
        if not isinstance(element, int):
            words.append(element)
        elif depth == 1 and path[0] == "stages":
            words.append(stage_kind(document, element) or f"entry {element + 1}")
        else:
            words.append(f"entry {element + 1}")
    return " > ".join(words)


def stage_kind(document: Document, index: int) -> str | None:
    """The kind that entry `index` of the stages names, if any."""
    try:
        item = document.at(("stages", index))
    except LookupError:
        return None
    kind = item.get("kind") if isinstance(item, dict) else item
    return kind if isinstance(kind, str) and kind else None


def did_you_mean(word: object, names: Iterable[str]) -> str:
    """ "; did you mean 'window'?" for the nearest of `names`, or a full stop."""
    near = nearest(word, names)
    return f"; did you mean '{near}'?" if near else "."


def nearest(word: object, names: Iterable[str]) -> str | None:
    """The name nearest to a mistyped word, regardless of case, or None."""
    by_lower = {name.lower(): name for name in names}
    # 0.6 is difflib's default: "fotos" finds "photos" (0.73), words that share only a few letters find nothing.
    close = difflib.get_close_matches(str(word).lower(), by_lower, n=1, cutoff=0.6)
    return by_lower[close[0]] if close else None


def found_words(value: Any, measure: str = "") -> str:
    """What was found: "5000 px", "'abc'", "empty"."""
    if value is None:
        return "empty"
    if isinstance(value, int | float):
        return f"{number(value) if abs(value) != float('inf') else value}{' ' + measure if measure else ''}"
    if isinstance(value, str):
        return f"'{value if len(value) <= 60 else value[:57] + '...'}'"
    return "a list" if isinstance(value, list) else "a mapping"


def _meant(details: list[Any], annotation: Any) -> set[Path_]:
    """Places of required fields that are given under a mistyped name, so that they are not reported as missing as well."""
    places = [locate(detail["loc"], annotation) for detail in details if detail["type"] == "extra_forbidden"]
    near = [(place, nearest(place.path[-1], _field_names(place))) for place in places]
    return {(*place.path[:-1], name) for place, name in near if name}


def _field_names(place: Place) -> list[str]:
    return list(place.model.model_fields) if place.model else []


def _sentence(detail: Any, place: Place, document: Document, base: Path_, annotation: Any) -> tuple[str, Path_]:
    """The sentence, and the path it belongs to, for one of pydantic's errors."""
    path, kind = (*base, *place.path), detail["type"]
    # The types of errors are part of pydantic's documented interface, their messages are not.
    # A list that is too short is reported as a missing entry; for the user the list itself is wrong.
    if kind == "missing" and place.path and isinstance(place.path[-1], int):
        path, kind = path[:-1], "wrong length"
    value = _value(document, path, detail["input"])
    if kind == "extra_forbidden":
        return _unknown(place, path, document), path
    if kind == "missing":
        wanted = allowed(place.field) if place.field else "a value"
        return f"is missing; it must be {wanted}. {sentence(place.field)}".rstrip(), path
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        return _unknown_kind(value, path, place, annotation)
    if kind in ("value_error", "assertion_error"):
        return str(detail["ctx"]["error"]), path
    return f"is {found_words(value, unit(place.field))}; {_needed(detail, place, value)}", path


def _value(document: Document, path: Path_, judged: Any) -> Any:
    try:
        return document.at(path)
    except LookupError:  # a setting below one that has its former name in the file; or one that is missing
        return judged


def _unknown(place: Place, path: Path_, document: Document) -> str:
    name, names = place.path[-1], [name for name in _field_names(place) if name != "kind"]
    owner = place_words(path[:-1], document).split(" > ")[-1] or "a workflow"
    if owner == "a workflow":
        names.append("stages")
    known = f" Settings of {owner} are: {', '.join(names)}." if names else f" {owner} has no settings."
    return f"there is no such setting{did_you_mean(name, names)}{known}"


def _unknown_kind(value: Any, path: Path_, place: Place, annotation: Any) -> tuple[str, Path_]:
    kinds = list(variants(place.annotation or annotation))
    what = (
        "stage"
        if path[:1] == ("stages",) and len(path) == 2
        else f"kind of {next((word for word in reversed(path) if isinstance(word, str)), 'value')}"
    )
    word = value.get("kind") if isinstance(value, dict) else value
    if word is not None:
        where = (*path, "kind") if isinstance(value, dict) else path
        return f"there is no {what} {found_words(word)}{did_you_mean(word, kinds)} Allowed: {one_of(kinds)}.", where
    # "{matching: {size: 3}}" is how other tools write their steps.
    key = next(iter(value), None) if isinstance(value, dict) and len(value) == 1 else None
    if key in kinds:
        return f"write 'kind: {key}' instead of '{key}:', with its settings below it in the same column.", path
    return f"has no kind; 'kind' must be {one_of(kinds)}.", path


def _needed(detail: Any, place: Place, value: Any) -> str:
    """ "must be at most 255 px." and what else helps."""
    measure = unit(place.field)
    if detail["type"] in _BOUNDS:
        limit, words = _BOUNDS[detail["type"]]
        return f"must be {words} {number(detail['ctx'][limit])}{' ' + measure if measure else ''}."
    if detail["type"] == "string_pattern_mismatch":
        return f"must be {pattern_words(detail['ctx']['pattern'])}.{_slug(value)}"
    if place.field is None:
        return "must be a mapping of settings."
    return f"must be {allowed(place.field)}.{_hint(value, place.field)}"


def _slug(value: Any) -> str:
    slug = re.sub(r"[^a-z0-9_-]+", "-", str(value).lower()).strip("-_")
    return f" '{slug}' is possible." if slug else ""


def _hint(value: Any, field_info: FieldInfo) -> str:
    kinds = variants(field_info.annotation)
    if isinstance(value, str) and kinds:
        return f" Write '{{kind: {value}}}'." if value in kinds else ""
    if isinstance(value, int | float) and type_words(field_info.annotation) == "a text":
        return " Put it in quotes."
    if isinstance(value, str) and "number" in type_words(field_info.annotation):
        return _number_hint(value, unit(field_info))
    return ""


def _number_hint(text: str, measure: str) -> str:
    """Advice for "30 cm", "0.3 m" and "0,3": the number alone, in the unit of the field."""
    match = _NUMBER_WITH_UNIT.match(text)
    if match is None:
        return ""
    try:
        # A single comma is a decimal comma; "1,234.5" could be meant in two ways and gets no advice.
        size = float(match[1].replace(",", "."))
    except ValueError:
        return ""
    given = (match[2] or "").lower()
    factor = 1.0 if not given or given == measure.lower() else _METRES.get(given, 0.0) / _METRES.get(measure.lower(), float("inf"))
    unit_words = f", in {measure}" if measure else ""
    # Twelve digits: 30 cm times 0.01 is 0.3 and not 0.30000000000000004.
    example = f": {number(float(f'{size * factor:.12g}'))}" if factor else ""
    return f" Write the number alone{unit_words}{example}."
