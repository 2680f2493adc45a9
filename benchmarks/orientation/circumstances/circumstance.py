"""A circumstance: photographs that are altered in one way, and what has to be said of it, or what has to come out."""

import html
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.measured_run import MeasuredRun, orthomill
from benchmarks.orientation.circumstances.altered_photographs import Altered, Flown
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import OrthomillError
from orthomill.schemas.orientation import BLOCK, Block

DOUBTFUL = re.compile(r"^doubtful (.*)$", re.MULTILINE)
"""a sentence of the terminal about what puts every result in doubt"""
REFUSED = re.compile(r"error: (.*)$", re.MULTILINE)
"""the sentence that ends a command"""


@dataclass(frozen=True)
class Circumstance:
    """One input: its `kind` and what is altered (`what`); the words of a sentence that `init` says (None: none is needed), and of
    the first doubt after a run (`first`; "": the run need not be made); `right`: whether the block came out as it should,
    beside the flight before it was altered; `options` of `init`."""

    kind: str
    what: str
    photographs: Altered
    says: str | None = None
    first: str = ""
    right: Callable[[Flown, Block], bool] | None = None
    options: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """How a circumstance ended: exit codes (None: not run), whether the sentences were said, what was said first, whether the cause
    is among the warnings, and whether the block is right (None: nothing to compare)."""

    case: Circumstance
    codes: tuple[int, int | None]
    said: bool
    first: str
    warned: bool
    right: bool | None

    @property
    def verdict(self) -> str:
        """right, named first, refused, named, wrong, named in `init`, or silent."""
        named = bool(self.case.first) and self.case.first in self.first
        if self.right:
            return "right, and named first" if named else "right" if not self.case.first else "right, but not named first"
        if any(self.codes):
            return "refused"
        if named:
            return "named first"
        if self.warned:
            return "named"
        if self.right is False:
            return "**wrong**"
        return "named by `init`" if self.case.says and self.said else "**silent**"


def ended(case: Circumstance, flown: Flown, root: Path) -> Outcome:
    """The outcome of `init` and, where something is expected of it, `run` to the orientation in the new folder `root`."""
    flown.written(root / "photos", case.photographs)
    started = orthomill(root, "init", "site", "--photos", "photos", *case.options)
    said = case.says is None or case.says in " ".join(started.output.split())
    if started.code or not (case.first or case.right):
        return Outcome(case, (started.code, None), said, _sentence(started), False, None)
    done = orthomill(root, "run", "site", "--until", "orientation", "--sequential")
    run = root / "runs" / "site"
    right = _right(case, flown, run) if case.right and not done.code else None
    warned = bool(case.first) and not done.code and case.first in html.unescape((run / "report.html").read_text())
    return Outcome(case, (0, done.code), said, _sentence(done), warned, right)


def _sentence(done: MeasuredRun) -> str:
    """The error that ended a command, or the first doubt; "": neither."""
    found = (REFUSED if done.code else DOUBTFUL).search(done.output)
    return found.group(1) if found else ""


def _right(case: Circumstance, flown: Flown, run: Path) -> bool:
    assert case.right
    try:
        return case.right(flown, Store(run).table(BLOCK))
    except OrthomillError:
        return False
