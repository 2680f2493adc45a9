"""Where the names of columns may stand: in the first line, below titles, or in a comment (Metashape's #Label)."""

from collections.abc import Iterator
from dataclasses import dataclass

from orthomill.schemas.survey_files.column_words import Column, columns
from orthomill.schemas.survey_files.sniffed_table import Lines, Separation, separation

_TITLES = 5
"""lines above the names of columns"""
_NUMBERS = 2
"""in a title, at most; lines with more are data"""
Numbered = tuple[tuple[int, str], ...]
"""(number, line)"""


@dataclass(frozen=True)
class TableHead:
    """Names of columns and what they mean, what separates cells, and the lines of data below."""

    names: tuple[str, ...]
    columns: tuple[Column, ...]
    separation: Separation
    data: Numbered

    @property
    def meanings(self) -> frozenset[str]:
        """What the columns mean."""
        return frozenset(column.meaning for column in self.columns) - {""}

    @property
    def has_places(self) -> bool:
        """Whether its lines hold places in plan."""
        return {"x", "y"} <= self.meanings or {"lon", "lat"} <= self.meanings

    @property
    def has_marks(self) -> bool:
        """Whether its lines hold places in photographs."""
        return {"photo", "col", "row"} <= self.meanings


def possible_heads(lines: Lines) -> Iterator[TableHead]:
    """Lines that may name columns, the likeliest first."""
    for i, (_, line) in enumerate(lines.others[: _TITLES + 1]):
        yield _head(line, lines.others[i + 1 :])
        sign = separation([line])
        if sum(sign.number(cell) is not None and cell != "" for cell in sign.cells(line)) > _NUMBERS:
            break
    for _, line in reversed(lines.comments):
        yield _head(line.lstrip("#%/ \t"), lines.others)


def _head(line: str, data: Numbered) -> TableHead:
    sign = separation([text for _, text in data] or [line])
    sign = sign if len(sign.cells(line)) >= 3 else separation([line])
    names = sign.cells(line)
    return TableHead(names, columns(names), sign, data)
