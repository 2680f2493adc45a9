"""Cells of the tables of a page of results, by heading, row and column: what the page of the whole takes over is found there."""

import re
from dataclasses import dataclass
from pathlib import Path

from benchmarks.instrument.result_page import ROOT


@dataclass(frozen=True)
class Line:
    """A row of a table: the heading above it, the names of its columns, and its cells."""

    heading: str
    columns: tuple[str, ...]
    cells: tuple[str, ...]


def lines_of(page: Path) -> list[Line]:
    """All rows of all tables of a page."""
    heading, columns, found = "", (), []
    for text in page.read_text().splitlines():
        if text.startswith("#"):
            heading, columns = text.lstrip("# "), ()
        elif not text.startswith("|"):
            columns = ()
        elif cells := tuple(cell.strip().strip("*") for cell in text.strip().strip("|").split("|")):
            if all(re.fullmatch(r":?-+:?", cell) for cell in cells):
                continue
            if columns:
                found.append(Line(heading, columns, cells))
            else:
                columns = cells
    return found


def cell_of(page: str, heading: str, row: str, column: str | int) -> str:
    """One cell: of the first row whose first cells begin with `row` (parts between " | "), below a heading that begins so. Raises
    LookupError with what was looked for."""
    wanted = row.split(" | ")
    for line in lines_of(ROOT / page):
        fits = all(cell.startswith(part) for cell, part in zip(line.cells, wanted, strict=False)) and len(line.cells) >= len(wanted)
        if line.heading.startswith(heading) and fits:
            place = column if isinstance(column, int) else next((k for k, n in enumerate(line.columns) if n.startswith(column)), -1)
            if 0 <= place < len(line.cells) and line.cells[place]:
                return line.cells[place]
    raise LookupError(f"{page} has no cell '{column}' in a row '{row}' below '{heading}'")
