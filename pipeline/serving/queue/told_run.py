"""What `orthomill run --json` tells, as lines for people and as progress: stages and findings, not a line for every job."""

import json
import re
from dataclasses import dataclass, field
from typing import Any

from orthomill.pipeline.serving.queue.task_state import TaskProgress

_OF_THIS_MACHINE = re.compile(r"https?://(127\.|localhost)")
"""Addresses of the dashboard and the map hold their secrets, and are for nobody elsewhere."""
_UNCOLOURED = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")


@dataclass
class ToldRun:
    """Takes the lines of a run one by one."""

    progress: TaskProgress = field(default_factory=TaskProgress)
    error: str = ""
    """the last error that was told"""
    verdict: str = ""
    products: tuple[str, ...] = ()
    traced: list[str] = field(default_factory=list)
    """lines of a traceback: for whoever runs the node, not for those who gave the task"""
    _tracing: bool = False
    _ended: set[str] = field(default_factory=set)

    def take(self, line: str) -> list[str]:
        """The lines that people are told for a line of the run."""
        text = _UNCOLOURED.sub("", line).rstrip()
        if self._traced(text):
            return []
        told = _object(text)
        if told is None:
            if text.startswith("error:"):
                self.error = text.removeprefix("error:").strip()
            return [text] if text and not _OF_THIS_MACHINE.search(text) else []
        if told.get("event") == "progress":
            return self._progress(told)
        if told.get("event") == "end":
            return self._end(told)
        note = str(told.get("text", ""))
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

    def _progress(self, told: dict[str, Any]) -> list[str]:
        share, left = told.get("share"), told.get("left_seconds")
        lines, current = [], self.progress.stage
        for kind, count in told.get("stages", {}).items():
            ended = sum(count.get(name, 0) for name in ("skipped", "done", "failed", "blocked"))
            planned = count.get("planned", 0)
            if planned and ended >= planned and kind not in self._ended:
                self._ended.add(kind)
                failed = f", {count['failed']} failed" if count.get("failed") else ""
                lines.append(f"[{told.get('seconds', 0):.0f} s] {kind}: {planned} jobs done{failed}")
            elif planned and ended < planned:
                current = kind
        seconds = left if isinstance(left, int | float) else None
        known = max(float(share), self.progress.share) if isinstance(share, int | float) else self.progress.share
        self.progress = self.progress.model_copy(update={"share": min(known, 1.0), "left_seconds": seconds, "stage": current})
        return lines

    def _end(self, told: dict[str, Any]) -> list[str]:
        self.verdict = str(told.get("verdict", ""))
        failed = told.get("failed", [])
        if not told.get("complete", True):
            self.error = f"{failed[0]['tile']}: {failed[0]['sentence']}" if failed else self.verdict
        warnings = [f"{one.get('stage')}: {one.get('sentence')}" for one in told.get("warnings", [])]
        self.products = tuple(str(one.get("path")) for one in told.get("products", []))
        return [
            f"Verdict: {self.verdict}",
            *(f"  {reason}" for reason in told.get("reasons", [])),
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
