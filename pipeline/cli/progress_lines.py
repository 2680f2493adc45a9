"""What the terminal shows during a run: one line per stage with counts and the remaining time.

On a terminal the lines are redrawn in place; in a log a line is printed when a stage advances by a tenth or ends.
"""

import sys
import time
from dataclasses import dataclass

from rich.console import Console
from rich.live import Live
from rich.table import Table as Lines

from orthomill.pipeline.engine.runner import Finished
from orthomill.pipeline.records.records import Key


@dataclass
class StageCount:
    """Counts of one stage's jobs so far."""

    planned: int = 0
    skipped: int = 0
    done: int = 0
    failed: int = 0
    blocked: int = 0
    seconds: float = 0.0

    @property
    def ended(self) -> int:
        return self.skipped + self.done + self.failed + self.blocked


class ProgressLines:
    """Counts jobs by stage and shows them. Use as a context manager; the remaining work is divided among `workers`."""

    def __init__(self, titles: dict[str, str], workers: int, console: Console) -> None:
        self.counts = {kind: StageCount() for kind in titles}
        self._titles, self._workers, self._console = titles, max(workers, 1), console
        self._printed: dict[str, int] = {}
        self._started = time.monotonic()
        # A terminal can be redrawn; in a log file every redrawing would be a line of its own.
        self._live = Live(get_renderable=self._lines, console=console, refresh_per_second=2) if console.is_terminal else None

    def __enter__(self) -> "ProgressLines":
        if self._live:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()

    def planned(self, key: Key) -> None:
        self.counts[key[0]].planned += 1

    def skipped(self, key: Key) -> None:
        self.counts[key[0]].skipped += 1

    def finished(self, finished: Finished, seconds: float) -> None:
        count = self.counts[finished.key[0]]
        if finished.status == "done":
            count.done += 1
            count.seconds += seconds
        elif finished.status == "failed":
            count.failed += 1
        else:
            count.blocked += 1
        if not self._live:
            self._log(finished.key[0], count)

    def remaining(self, count: StageCount) -> float | None:
        """Seconds that a stage's planned jobs still need on all workers; None before the first has ended."""
        if not count.done:
            return None
        # The mean of the jobs done now: skipped ones took no time, and failed ones may have ended early.
        return count.seconds / count.done * (count.planned - count.ended) / self._workers

    def _log(self, kind: str, count: StageCount) -> None:
        # Ten lines per stage keep the log of a run with thousands of tiles readable.
        tenth = 10 * count.ended // max(count.planned, 1)
        if tenth != self._printed.get(kind) or count.ended == count.planned:
            self._printed[kind] = tenth
            print(f"[{time.monotonic() - self._started:6.1f} s] {kind:14} {self._state(count)}", file=sys.stderr, flush=True)

    def _state(self, count: StageCount) -> str:
        numbers = ((count.skipped, "unchanged"), (count.failed, "failed"), (count.blocked, "blocked"))
        parts = [f"{count.ended}/{count.planned} jobs", *(f"{number} {word}" for number, word in numbers if number)]
        left = self.remaining(count)
        if left is not None and count.ended < count.planned:
            parts.append(f"about {left:.0f} s left")
        return ", ".join(parts)

    def _lines(self) -> Lines:
        lines = Lines(box=None, pad_edge=False, show_header=False)
        for kind, count in self.counts.items():
            share = count.ended / count.planned if count.planned else 0.0
            bar = "━" * round(20 * share)
            colour = "red" if count.failed else "green" if count.planned and share == 1.0 else "cyan"
            state = self._state(count) if count.planned else "[dim]not planned yet[/dim]"
            lines.add_row(f"[bold]{kind}[/bold]", f"[{colour}]{bar:<20}[/{colour}]", state)
        return lines
