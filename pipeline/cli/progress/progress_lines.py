"""What the terminal shows during a run: one line for the whole with the remaining time, and one for every stage.

On a terminal the lines are redrawn in place; in a log a line is printed when the run advances by a twentieth, when a stage ends,
and when nothing was told for some minutes; as JSON every such line is an object for other programs.
"""

import json
import sys
import time
from dataclasses import dataclass

from rich.console import Console
from rich.live import Live
from rich.table import Table as Lines

from orthomill.pipeline.engine.planned.planned_jobs import PlannedJob
from orthomill.pipeline.engine.runner import Finished
from orthomill.pipeline.records.numbered_names import Key
from orthomill.pipeline.records.records import Record
from orthomill.pipeline.watching.cost_model import CostModel, Remaining

STEPS = 20
"""parts of the run after each of which a log gets a line"""
SILENT = 120.0
"""seconds without a line after which the next job gives one: a twentieth of a large block, or of a stage that turned out larger
than was foreseen, takes hours"""
SETTLED = 10.0
"""seconds before which no remaining time is told: the first jobs load and compile what the others use"""
BAR = 30


@dataclass
class StageCount:
    """Counts of one stage's jobs so far."""

    planned: int = 0
    skipped: int = 0
    done: int = 0
    failed: int = 0
    blocked: int = 0

    @property
    def ended(self) -> int:
        return self.skipped + self.done + self.failed + self.blocked

    @property
    def began(self) -> bool:
        """Whether any of its jobs has been done, tried or found unchanged."""
        return self.ended > 0


class ProgressLines:
    """Counts jobs by stage and shows them, with the time that the model says is left. Use as a context manager."""

    def __init__(self, titles: dict[str, str], model: CostModel, console: Console, as_json: bool = False) -> None:
        self.counts = {kind: StageCount() for kind in titles}
        self._titles, self._model, self._console, self._as_json = titles, model, console, as_json
        self._step, self._ended = -1, set[str]()
        self._started = self._told = time.monotonic()
        # A terminal can be redrawn; in a log file every redrawing would be a line of its own.
        redrawn = console.is_terminal and not as_json
        self._live = Live(get_renderable=self._lines, console=console, refresh_per_second=2) if redrawn else None

    def __enter__(self) -> "ProgressLines":
        if self._live:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()

    def planned(self, planned: PlannedJob) -> None:
        """A job is part of the run from now on."""
        self.counts[planned.key[0]].planned += 1

    def skipped(self, key: Key) -> None:
        """A job is unchanged since an earlier run."""
        self.counts[key[0]].skipped += 1

    def finished(self, finished: Finished, record: Record | None) -> None:
        """A job has ended."""
        count = self.counts[finished.key[0]]
        if finished.status == "done":
            count.done += 1
        elif finished.status == "failed":
            count.failed += 1
        else:
            count.blocked += 1
        if not self._live:
            self._log(finished.key[0], count)

    def remaining(self) -> Remaining | None:
        """What is left of the run; None in the first seconds, whose jobs say little about the others."""
        return self._model.shown() if time.monotonic() - self._started >= SETTLED else None

    def _log(self, kind: str, count: StageCount) -> None:
        # The end of a stage may come more than once, as further jobs of it are planned: one line is enough.
        stage_ends = count.ended == count.planned and kind not in self._ended
        left = self._model.remaining()
        step = int(STEPS * left.share) if left else 0
        now = time.monotonic()
        if not stage_ends and step <= self._step and now - self._told < SILENT:
            return
        self._step, self._told = max(step, self._step), now
        if stage_ends:
            self._ended.add(kind)
        elapsed = now - self._started
        line = (
            json.dumps(self._facts(elapsed)) if self._as_json else f"[{elapsed:6.1f} s] {self._total()}; {kind} {state_text(count)}"
        )
        print(line, file=sys.stdout if self._as_json else sys.stderr, flush=True)

    def _facts(self, elapsed: float) -> dict[str, object]:
        left = self.remaining()
        return {
            "event": "progress",
            "seconds": round(elapsed, 1),
            "share": round(left.share, 4) if left else None,
            "left_seconds": round(left.seconds, 1) if left else None,
            "left_range": [round(end, 1) for end in left.range] if left else None,
            "stages": {kind: vars(count) for kind, count in self.counts.items()},
        }

    def _total(self) -> str:
        left = self.remaining()
        if left is None:
            return "remaining time not known yet"
        return f"{100 * min(left.share, 0.99):.0f} % of the work, {about(left)} left"

    def _lines(self) -> Lines:
        lines = Lines(box=None, pad_edge=False, show_header=False)
        left = self.remaining()
        filled = "━" * round(BAR * (left.share if left else 0.0))
        lines.add_row("[bold]whole run[/bold]", f"[cyan]{filled:<{BAR}}[/cyan]", self._total())
        for kind, count in self.counts.items():
            bar = "━" * round(BAR * count.ended / count.planned) if count.began else ""
            colour = "red" if count.failed else "green" if count.ended == count.planned else "cyan"
            state = state_text(count) if count.planned else "[dim]not planned yet[/dim]"
            lines.add_row(kind, f"[{colour}]{bar:<{BAR}}[/{colour}]", state)
        return lines


def state_text(count: StageCount) -> str:
    """The counts of a stage in words."""
    numbers = ((count.skipped, "unchanged"), (count.failed, "failed"), (count.blocked, "blocked"))
    return ", ".join([f"{count.ended}/{count.planned} jobs", *(f"{number} {word}" for number, word in numbers if number)])


def about(left: Remaining) -> str:
    """A duration with no more digits than its uncertainty allows: about 2 min (1 to 3)."""
    low, high = left.range
    if _rounded(high, 5) == 0:
        # Jobs that a stage will plan when its tables are there are not known yet: nothing is never left before the end.
        return "under 5 s of known work"
    if left.seconds < 90:
        return f"about {_rounded(left.seconds, 5)} s ({_rounded(low, 5)} to {_rounded(high, 5)})"
    if left.seconds < 5400:
        return f"about {left.seconds / 60:.0f} min ({low / 60:.0f} to {high / 60:.0f})"
    return f"about {left.seconds / 3600:.1f} h ({low / 3600:.1f} to {high / 3600:.1f})"


def _rounded(value: float, step: int) -> int:
    return step * round(value / step)
