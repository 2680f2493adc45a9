"""YAML with line numbers, without the features that a workflow never needs.

The document is built from the parser's events in one pass: plain mappings, lists, texts, numbers and null, with the line of every
place in it. Aliases, anchors, tags, excessive nesting and repeated keys are refused, so that a file means what a reader sees in it,
and no file can expand in memory. Plain scalars follow YAML 1.2: `no` is a word and `1e-3` is a number. True and false remain words;
the field that needs a truth value interprets them.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import yaml

Path_ = tuple[str | int, ...]
"""A place in the document: keys and list positions from the top."""

SIZE_LIMIT = 256 * 1024
"""characters of a workflow file"""
DEPTH_LIMIT = 20
"""Deeper than any setting of the catalogue, and far below Python's own limit of recursion."""
# 18 digits fit 64 bits; a longer row of digits is a name or a slip, and int() of a very long one takes quadratic time.
_INTEGER = re.compile(r"[-+]?\d{1,18}\Z")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d{1,3})?\Z")
_NOTHING = frozenset({"", "~", "null", "Null", "NULL"})


class YamlError(Exception):
    """The text is not YAML that a workflow may contain: one sentence and its line (from 1)."""

    def __init__(self, line: int, sentence: str) -> None:
        super().__init__(line, sentence)
        self.line, self.sentence = line, sentence


@dataclass(frozen=True)
class Document:
    """The content of the file, the lines of its places, and the keys it repeats."""

    value: Any
    lines: dict[Path_, int]
    repeated: tuple[tuple[Path_, int, int], ...] = ()
    """(path, line, line of the first) of keys that occur twice in one mapping; the first one counts."""

    def line(self, path: Path_) -> int:
        """The line of a place, or of the nearest enclosing place that is in the file."""
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path, 1)

    def at(self, path: Path_) -> Any:
        """The value at a place. Raises LookupError when there is none."""
        value = self.value
        for key in path:
            value = value[key] if isinstance(value, dict) else _entry(value, key)
        return value


def _entry(value: Any, key: str | int) -> Any:
    if isinstance(value, list) and isinstance(key, int):
        return value[key]
    raise LookupError(key)


def read_yaml(text: str) -> Document:
    """The document of `text`. Raises YamlError at the first thing that cannot be read."""
    # PyYAML needs seconds per megabyte, and a photograph given by mistake has many.
    if len(text) > SIZE_LIMIT:
        raise YamlError(1, f"the file has {len(text)} characters; a workflow has at most {SIZE_LIMIT}")
    builder = _Builder()
    try:
        events = yaml.parse(text, Loader=yaml.SafeLoader)
        return builder.document(events)
    except yaml.YAMLError as error:
        raise _syntax_mistake(error) from None


def _syntax_mistake(error: yaml.YAMLError) -> YamlError:
    mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
    problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "unreadable"
    line = mark.line + 1 if mark else 1
    # PyYAML's own words are kept in parentheses; they name the character, and the hint says what usually causes it.
    hint = "align the lines, and put texts that contain a colon or brackets in quotes"
    if "'\\t'" in problem:
        hint = "indent with spaces, not tabs"
    return YamlError(line, f"this is not valid YAML ({problem}); {hint}")


@dataclass
class _Builder:
    lines: dict[Path_, int] = field(default_factory=dict)
    repeated: list[tuple[Path_, int, int]] = field(default_factory=list)

    def document(self, events: Iterator[yaml.Event]) -> Document:
        value, documents = None, 0
        for event in events:
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    raise YamlError(_line(event), "a second document begins here; a workflow is a single one, so remove the '---'")
                value = self._value(next(events), events, ())
        return Document(value, self.lines, tuple(self.repeated))

    def _value(self, event: yaml.Event, events: Iterator[yaml.Event], path: Path_) -> Any:
        _refuse_machinery(event, path)
        # A key has recorded its own line before: a value that begins on the next line is found under its key.
        self.lines.setdefault(path, _line(event))
        if isinstance(event, yaml.ScalarEvent):
            return _scalar(event)
        return self._list(events, path) if isinstance(event, yaml.SequenceStartEvent) else self._mapping(events, path)

    def _list(self, events: Iterator[yaml.Event], path: Path_) -> list:
        items: list[Any] = []
        while not isinstance(event := next(events), yaml.SequenceEndEvent):
            items.append(self._value(event, events, (*path, len(items))))
        return items

    def _mapping(self, events: Iterator[yaml.Event], path: Path_) -> dict:
        items: dict[str, Any] = {}
        while not isinstance(event := next(events), yaml.MappingEndEvent):
            line = _line(event)
            if not isinstance(event, yaml.ScalarEvent):
                raise YamlError(line, "a name is needed before the colon, not a list or a mapping")
            _refuse_machinery(event, path)
            if event.value in items:
                self.repeated.append(((*path, event.value), line, self.lines[(*path, event.value)]))
                # The repeated value is read by a builder of its own, so that its lines do not replace those of the first.
                _Builder()._value(next(events), events, path)
                continue
            self.lines[(*path, event.value)] = line
            items[event.value] = self._value(next(events), events, (*path, event.value))
        return items


def _line(event: yaml.Event) -> int:
    """The line of an event, from 1; 1 for the events without a place that the stream begins and ends with."""
    return event.start_mark.line + 1 if event.start_mark else 1


def _refuse_machinery(event: yaml.Event, path: Path_) -> None:
    line = _line(event)
    if isinstance(event, yaml.AliasEvent):
        raise YamlError(
            line,
            f"'*{event.anchor}' refers to another place; aliases are not used in a workflow, so write the value "
            "out (and put texts that begin with * in quotes)",
        )
    if isinstance(event, yaml.NodeEvent) and event.anchor is not None:
        raise YamlError(line, f"'&{event.anchor}' is an anchor; anchors are not used in a workflow, so remove it")
    if isinstance(event, yaml.ScalarEvent | yaml.CollectionStartEvent) and event.tag not in (None, "!"):
        raise YamlError(line, f"'{event.tag}' is a tag; tags are not used in a workflow, so remove it")
    if len(path) > DEPTH_LIMIT:
        raise YamlError(line, f"this is nested more than {DEPTH_LIMIT} levels deep; no workflow needs that")


def _scalar(event: yaml.ScalarEvent) -> Any:
    text = event.value
    if not event.implicit[0]:  # quoted, or tagged '!': a text whatever it looks like
        return text
    if text in _NOTHING:
        return None
    if _INTEGER.match(text):
        return int(text)
    return float(text) if _NUMBER.match(text) else text
