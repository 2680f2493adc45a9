"""The page of the whole, docs/mission.md: `python -m benchmarks mission` makes it from the pages of results.

No value of ours is typed: each is a cell of a page of results, with the date and commit of that page, or what a test holds.
"""

from collections.abc import Iterator
from pathlib import Path

from benchmarks.instrument.result_page import ROOT, head_of, write_page
from benchmarks.mission.blending_rows import BLENDING
from benchmarks.mission.calibration_rows import CALIBRATION
from benchmarks.mission.check_rows import CHECK
from benchmarks.mission.epipolar_rows import EPIPOLAR
from benchmarks.mission.line_locus_rows import LINE_LOCUS
from benchmarks.mission.matching_rows import MATCHING
from benchmarks.mission.published_row import Found, Row

PAGE = ROOT / "docs" / "mission.md"
WORKS: dict[str, tuple[Row, ...]] = {
    "Relative orientation, epipolar images, guided densification (Karfis 2009)": EPIPOLAR,
    "Calibration from several chessboards (Kawka 2021)": CALIBRATION,
    "Least-squares matching and its windows (Skarlatos)": MATCHING,
    "Check of a surface without reference data (Skarlatos)": CHECK,
    "Vertical line locus (Tumska, Procyk, Janczak)": LINE_LOCUS,
    "True orthoimages with blended texture (Petsa et al. 2007)": BLENDING,
}
"""title of a section and its rows"""
_COLUMNS = ("system or table", "how to reach it", "published", "ours", "where from", "if it differs, why")


def where_from(row: Row) -> str:
    """The page of results with its date and commit, or the file of a test."""
    ours = row.ours
    link = f"[{Path(ours.path).name}]({_link(ours.path)})"
    if not isinstance(ours, Found):
        return link
    head = head_of(ROOT / ours.path)
    return f"{link}, {head.date}, {head.commit}" if head else link


def _link(path: str) -> str:
    return path.removeprefix("docs/") if path.startswith("docs/") else f"../{path}"


def line_of(row: Row) -> str:
    """A row of the table."""
    system = f"[{row.system}](sources/{row.source})"
    cells = (system, f"`{row.reach}`", row.published, str(row.ours), where_from(row), row.why)
    return "| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |"


def body() -> Iterator[str]:
    """The lines below the head of the page."""
    yield (
        "Every system of the five works that orthomill stands on: where it is described, how it is reached here, the value that "
        "was "
        "printed, and ours beside it. Where the published photographs are not public the scene is simulated or a stand-in, and the "
        "pattern compares, not the digit; the last column says what is known of the difference. Fragments in braces stand in the "
        "list `stages` of a workflow. No value of ours is typed: each is taken from the page of results that is named, which tells "
        "the command that makes it again, or is held by the test that is named."
    )
    for title, rows in WORKS.items():
        yield from ("", f"## {title}", "", "| " + " | ".join(_COLUMNS) + " |", "| --- " * len(_COLUMNS) + "|")
        yield from map(line_of, rows)


def main(words: list[str]) -> None:
    """Write the page."""
    write_page("mission", words, "# The published systems, one by one\n\n" + "\n".join(body()), PAGE)
