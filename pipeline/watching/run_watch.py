"""Several watchers of one run as one."""

from collections.abc import Sequence

from orthomill.pipeline.engine.planned.planned_jobs import PlannedJob
from orthomill.pipeline.engine.runner import Finished
from orthomill.pipeline.engine.session import Watcher
from orthomill.pipeline.records.numbered_names import Key
from orthomill.pipeline.records.records import Record


class Watchers:
    """Tells every watcher what one is told, in their order."""

    def __init__(self, watchers: Sequence[Watcher]) -> None:
        self._watchers = tuple(watchers)

    def planned(self, planned: PlannedJob) -> None:
        """A job has been planned."""
        for watcher in self._watchers:
            watcher.planned(planned)

    def skipped(self, key: Key) -> None:
        """A job is unchanged."""
        for watcher in self._watchers:
            watcher.skipped(key)

    def finished(self, finished: Finished, record: Record | None) -> None:
        """A job has ended."""
        for watcher in self._watchers:
            watcher.finished(finished, record)
