"""The output of `orthomill run --json`, as lines for people and as progress: stages and findings, not a line for every job."""

import json
import re
from dataclasses import dataclass, field
from typing import Any

from orthomill.pipeline.serving.queue.task_state import TaskProgress

_OF_THIS_MACHINE = re.compile(r"https?://(127\.|localhost)")
"""Addresses of the dashboard and the map hold their secrets, and are for nobody elsewhere."""
_STEPS = 20
"""lines of progress of a run, at most"""
_FOR_THE_TERMINAL = "is written; read it, then:"
"""what `init` advises whoever sits there"""
_UNCOLOURED = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")


@dataclass
class RunOutput:
    """Takes the lines of a run one by one."""

    progress: TaskProgress = field(default_factory=TaskProgress)
    error: str = ""
    """the last error that was told"""
    verdict: str = ""
    products: tuple[str, ...] = ()
    traced: list[str] = field(default_factory=list)
    """lines of a traceback: for whoever runs the node, not for those who gave the task"""
    _tracing: bool = False
    _foreseen: float = 0.0
    """the share of the work that was done by the last forecast"""
    _step: int = 0

    def take(self, line: str) -> list[str]:
        """The lines that people are told for a line of the run."""
        text = _UNCOLOURED.sub("", line).rstrip()
        if self._traced(text):
            return []
        record = _object(text)
        if record is None:
            if text.startswith("error:"):
                self.error = text.removeprefix("error:").strip()
            return [text] if text and not _OF_THIS_MACHINE.search(text) and _FOR_THE_TERMINAL not in text else []
        if record.get("event") == "progress":
            return self._progress(record)
        if record.get("event") == "end":
            return self._end(record)
        note = str(record.get("text", ""))
        return [note] if note and not _OF_THIS_MACHINE.search(note) else []

    def _traced(self, text: str) -> bool:
        """Whether a line is of a traceback; its last one, which has the error, becomes the error of the task."""
        if text.startswith("Traceback (most recent call last)"):
            self._tracing = True
        if not self._tracing:
            return False
        self.traced.append(text)
        if text and not text.startswith((" ", "Traceback")):
            self._tracing = False
            self.error = f"This is a defect of orthomill ({text[:200]}); whoever runs the node finds more in process.log."
        return True

    def _progress(self, record: dict[str, Any]) -> list[str]:
        share, left = record.get("share"), record.get("left_seconds")
        known = self._grown(float(share)) if isinstance(share, int | float) else self.progress.share
        seconds = left if isinstance(left, int | float) else None
        stage, counts = self.progress.stage, ""
        for kind, count in record.get("stages", {}).items():
            ended = sum(count.get(name, 0) for name in ("skipped", "done", "failed", "blocked"))
            if ended < (planned := count.get("planned", 0)):
                stage, counts = kind, f"; {kind}: {ended} of {planned} jobs"
                break
        shown_now = {"share": min(known, 1.0), "left_seconds": seconds, "stage": stage}
        self.progress = self.progress.model_copy(update=shown_now)
        step = int(_STEPS * known)
        if step <= self._step:
            return []
        self._step = step
        remaining = f", about {seconds / 60:.0f} min left" if seconds is not None and seconds >= 90 else ""
        return [f"[{record.get('seconds', 0):.0f} s] {100 * min(known, 0.99):.0f} % of the work{remaining}{counts}"]

    def _grown(self, share: float) -> float:
        """The share that is shown, which never falls: where a stage turns out larger than was foreseen, what is left to be shown
        goes on at the pace of what is left to be done."""
        before, self._foreseen = self._foreseen, min(share, 1.0)
        shown = self.progress.share
        return shown + (1.0 - shown) * max(self._foreseen - before, 0.0) / max(1.0 - before, 1e-6)

    def _end(self, record: dict[str, Any]) -> list[str]:
        self.verdict = str(record.get("verdict", ""))
        failed = record.get("failed", [])
        if not record.get("complete", True):
            self.error = f"{failed[0]['tile']}: {failed[0]['sentence']}" if failed else self.verdict
        warnings = [f"{one.get('stage')}: {one.get('sentence')}" for one in record.get("warnings", [])]
        self.products = tuple(str(one.get("path")) for one in record.get("products", []))
        return [
            f"Verdict: {self.verdict}",
            *(f"  {reason}" for reason in record.get("reasons", [])),
            *warnings,
            *(f"failed {one.get('tile')}: {one.get('sentence')}" for one in failed),
        ]


def _object(text: str) -> dict[str, Any] | None:
    if not text.startswith("{"):
        return None
    try:
        found = json.loads(text)
    except ValueError:
        return None
    return found if isinstance(found, dict) else None
