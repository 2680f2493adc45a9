"""Workers that die at their jobs again and again, so that none of them ends.

Somebody is always at work then, and each job is handed out again many times before it is given up: a run of thousands of jobs would
go on for days. Jobs that are long, on workers that live, end nothing for hours either; what tells the two apart is who is gone.
"""

from orthomill.schemas.errors import ResourceError

ENOUGH = 20
"""workers that died at work, for each that is at work, without a single job that ended"""


class LostWorkers:
    """Those that had a job at one look, and were gone at the next; `now` is the time of a look, s."""

    def __init__(self, now: float) -> None:
        self.ended(now)
        self._busy: frozenset[str] = frozenset()

    def ended(self, now: float) -> None:
        """A job has ended: there is progress."""
        self._since, self._died = now, 0

    def seen(self, there: set[str], busy: frozenset[str]) -> None:
        """The addresses of the workers that are there, and of those that have jobs."""
        self._died += len(self._busy - there)
        self._busy = busy

    def check(self, now: float, patience: float) -> None:
        """Raises ResourceError when no job has ended for so many seconds, and enough workers died at work since."""
        if now - self._since > patience and self._died >= ENOUGH * max(len(self._busy), 1):
            raise ResourceError(
                f"No job has ended for {(now - self._since) / 60:.0f} minutes, and {self._died} workers died at work since: they "
                "do not live as long as a job takes, or their memory is too small. Finished jobs are kept; let workers live longer "
                "or choose a smaller 'tile', then run the same command again."
            )
