"""A text as a table: which sign separates its cells, whether decimals have a comma, and which of its lines hold data.

Spreadsheets of one country write semicolons and decimal commas, others commas and points, and programs blanks or tabs: the lines
tell which.
"""

import csv
import re
from collections.abc import Iterable
from dataclasses import dataclass

from orthomill.schemas.survey_files import written_numbers

_SHARE = 0.6
"""of the lines must hold a sign that separates cells: titles and comments do not"""
_LOOKED_AT = 200
_COMMA_NUMBER = re.compile(r"[+-]?\d+,\d+")
_POINT_NUMBER = re.compile(r"[+-]?\d+\.\d+")
_QUOTED = re.compile(r'(^|\s)"')


@dataclass(frozen=True)
class Line:
    """A line of data: its number in the file, and its cells."""

    number: int
    cells: tuple[str, ...]


@dataclass(frozen=True)
class Separation:
    """What separates cells ("" for blanks), and the sign before decimals."""

    sign: str
    decimal: str

    def cells(self, line: str) -> tuple[str, ...]:
        """The cells of one line; a quote that is not closed ends with its line, so that it spoils no other."""
        if not self.sign and not _QUOTED.search(line):
            return tuple(line.split())
        if not self.sign:
            return tuple(cell for cell in next(csv.reader([" ".join(line.split())], delimiter=" ")) if cell)
        try:
            return tuple(cell.strip() for cell in next(csv.reader([line], delimiter=self.sign, skipinitialspace=True)))
        except (csv.Error, StopIteration):  # a cell of more than 128 KiB
            return ()

    def number(self, cell: str) -> float | None:
        """The number of a cell: None where it is none, NaN where it says that it is not known."""
        return written_numbers.number(cell, self.decimal)

    def coordinate(self, cell: str) -> float | None:
        """The number of a cell that may be degrees with minutes and seconds."""
        return written_numbers.coordinate(cell, self.decimal)


def separation(lines: list[str]) -> Separation:
    """What separates the cells of lines."""
    # A sign at the end of all lines separates nothing.
    seen = [line.strip() for line in lines[:_LOOKED_AT] if line.strip()]
    for sign in ("\t", ";"):
        if _share(seen, sign) >= _SHARE:
            return Separation(sign, _decimal(cell for line in seen for cell in line.split(sign)))
    seen = [_without_thousands(line) for line in seen]
    words = [word for line in seen for word in line.split()]
    commas = sum(bool(_COMMA_NUMBER.fullmatch(word)) for word in words)
    # Three numbers with commas to a line, between blanks: with commas as separators they would be glued to their neighbours.
    if seen and commas >= 3 * _SHARE * len(seen) and not any(word.count(",") > 1 for word in words):
        return Separation("", ",")
    return Separation("," if _share(seen, ",") >= _SHARE else "", ".")


def _without_thousands(line: str) -> str:
    """Commas between thousands separate nothing, but where they are all that a line has, as in 300,300,140,300."""
    words = line.split()
    return line if len(words) == 1 else " ".join(word for word in words if not written_numbers.is_thousands(word))


def _share(lines: list[str], sign: str) -> float:
    return sum(sign in line for line in lines) / len(lines) if lines else 0.0


def _decimal(cells: Iterable[str]) -> str:
    return "," if sum(_vote(cell.strip()) for cell in cells) > 0 else "."


def _vote(cell: str) -> int:
    """1 for a number with a decimal comma, -1 for one with a point, 0 for all others."""
    comma = _COMMA_NUMBER.fullmatch(cell) or ("," in cell and written_numbers.is_thousands(cell, ","))
    point = _POINT_NUMBER.fullmatch(cell) or ("." in cell and written_numbers.is_thousands(cell, "."))
    return bool(comma) - bool(point)


@dataclass(frozen=True)
class Lines:
    """The lines of a text that hold something: `(number, line)` of comments (with #, % or //) and of the others."""

    comments: tuple[tuple[int, str], ...]
    others: tuple[tuple[int, str], ...]


def lines_of(text: str, marks: tuple[str, ...] = ("#", "%", "//")) -> Lines:
    """The lines of a text, without blank ones."""
    found = [(n, line.strip("\r\n")) for n, line in enumerate(text.lstrip("\ufeff").splitlines(), 1) if line.strip()]
    comments = tuple((n, line) for n, line in found if line.lstrip().startswith(marks))
    return Lines(comments, tuple((n, line) for n, line in found if not line.lstrip().startswith(marks)))
