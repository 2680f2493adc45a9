"""What the jobs whose results are valid have taken, added up as they are found or done: no record need be read again for that."""

from dataclasses import dataclass, field

from orthomill.pipeline.records.records import Record


@dataclass
class StageSum:
    """Of the jobs of a stage: s, bytes."""

    seconds: float = 0.0
    cpu_seconds: float = 0.0
    written: int = 0
    peak_bytes: int | None = None

    def add(self, record: Record) -> None:
        """One more."""
        self.seconds += record.seconds
        self.cpu_seconds += record.cpu_seconds
        self.written += sum(kept.size for kept in record.files.values())
        self.peak_bytes = max(self.peak_bytes or 0, record.peak_bytes)


@dataclass
class RecordSums:
    """By stage, and by the earlier runs that did the jobs."""

    stages: dict[str, StageSum] = field(default_factory=dict)
    spans: dict[str, tuple[float, float]] = field(default_factory=dict)
    """by run: when the first of its jobs began, and the last ended, s"""

    def of(self, stage: str) -> StageSum:
        """Those of a stage."""
        return self.stages.get(stage, StageSum())

    def add(self, record: Record, earlier: bool) -> None:
        """One more; `earlier`: this run did not do it."""
        self.stages.setdefault(record.stage, StageSum()).add(record)
        if earlier:
            begun, ended = self.spans.get(record.run, (record.started, 0.0))
            self.spans[record.run] = min(begun, record.started), max(ended, record.started + record.seconds)

    def clear(self) -> None:
        """As if nothing were valid."""
        self.stages.clear()
        self.spans.clear()
