"""Every kind of input that contradicts itself, several of each, through `init` and `run`: right, named first, or silent?

    python -m benchmarks circumstances [FOLDER] [only=KIND]

FOLDER holds the photographs of brighton (default ../shared/data/brighton), of which small copies are made.
"""

import tempfile
from collections import Counter
from pathlib import Path

from benchmarks.instrument.result_page import write_page
from benchmarks.orientation.circumstances.altered_photographs import Flown
from benchmarks.orientation.circumstances.circumstance import Outcome, ended
from benchmarks.orientation.circumstances.kinds import circumstances

LONGEST = 140
"""letters of a sentence that the page shows"""


def main(words: list[str]) -> None:
    """All circumstances, and the page."""
    only = next((word.removeprefix("only=") for word in words if word.startswith("only=")), None)
    given = [word for word in words if "=" not in word]
    flown = Flown(Path(given[0] if given else "../shared/data/brighton").resolve())
    rows = []
    with tempfile.TemporaryDirectory(prefix="orthomill_circumstances_") as folder:
        for number, case in enumerate(circumstances()):
            if only is None or case.kind == only:
                rows.append(ended(case, flown, Path(folder) / str(number)))
                print(_row(rows[-1]), flush=True)
    if only is None:
        write_page("circumstances", words, page(rows))


def page(rows: list[Outcome]) -> str:
    """The table of all circumstances."""
    count = Counter(row.verdict for row in rows)
    return "\n".join(
        [
            "# Inputs that contradict themselves",
            "",
            f"{len(rows)} inputs: " + ", ".join(f"{number} {verdict}" for verdict, number in count.most_common()) + ".",
            "",
            "Copies of brighton of 400 x 225 px, each altered in one way, through `init` and, where the photographs have "
            "to show it, `run --until orientation`, all defaults. *Named first*: the first doubt on the terminal names the cause; "
            "*named*: a warning of the report does; *refused*: a sentence ends the command. Control is points of the unaltered "
            "block; *right* is then a block that rests on it and lies within 1 m of the unaltered one.",
            "",
            "| kind | what is altered | exit codes | outcome | the first doubt, or the error |",
            "| --- | --- | --- | --- | --- |",
            *map(_row, rows),
        ]
    )


def _row(row: Outcome) -> str:
    codes = " / ".join("-" if code is None else str(code) for code in row.codes)
    first = row.first if len(row.first) <= LONGEST else f"{row.first[:LONGEST]}..."
    return f"| {row.case.kind} | {row.case.what} | {codes} | {row.verdict} | {first} |"
