"""Runs that are killed at a job of one's choice."""

from collections.abc import Callable

from toy_stages import MEMORY

from orthomill.pipeline.engine.execute import JobOrder
from orthomill.pipeline.engine.runner import Finished, SequentialRunner


class Killed(BaseException):
    """The end of a process."""


class KilledRunner(SequentialRunner):
    """Is killed before the first job that `when` tells, or behind it."""

    def __init__(self, when: Callable[[tuple], bool], behind: bool = False) -> None:
        super().__init__(MEMORY)
        self._when, self._behind = when, behind

    def next(self) -> Finished:
        work: JobOrder = self._waiting[0][0]
        if self._when(work.job.key):
            if self._behind:
                super().next()
            raise Killed
        return super().next()
