"""The workers of a Dask cluster while a run lasts: who may take a job, who may not, and what is said when nobody does anything.

Workers come and go: they join late, reach their walltime, are killed and started again, on machines of other sizes. Nothing is
declared to the scheduler, which would have to be repeated for each of them; a worker that fulfils the terms gets jobs as soon as it
is there. One that does not is named and sent away. A job that needs more memory than some workers have is given to the others only.
"""

import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

from orthomill.pipeline.engine.dask_cluster import LOST, objections, workers_of
from orthomill.pipeline.engine.workers.lost_workers import LostWorkers
from orthomill.pipeline.engine.workers.worker_terms import Terms
from orthomill.schemas.errors import ResourceError
from orthomill.schemas.memory import MIB

LOOKED = 10.0
"""seconds after which it is looked again what the workers do"""
TOLD = 30.0
"""seconds without anybody at work after which that is said"""
DESERTED = 600.0
"""seconds without anybody at work after which a run is given up; on an overloaded machine a new worker takes minutes to start"""
UNFIT = 5
"""workers that were sent away, with no other there, after which none of those that will join is expected to fit"""
NOBODY = "tcp://0.0.0.0:1"
"""address of no worker: a job that no worker has the memory for waits, and is handed out again when one has joined"""
_NO_WORKER = "there is none"


class Workforce:
    """What is known of the workers of a `client`; `say` tells the user a sentence. The run is given up when nobody has been at work
    for `patience` seconds."""

    def __init__(self, client: Any, say: Callable[[str], None] = lambda line: None, patience: float = DESERTED) -> None:
        self._client, self._say, self._patience = client, say, patience
        self._room: dict[str, float] = {}
        """bytes of every worker that was there at the last look"""
        self._dismissed: set[str] = set()
        self._at_work = self._looked = time.monotonic()
        self._lost = LostWorkers(self._at_work)
        self._told = False

    @property
    def number(self) -> int:
        """Workers at the last look, at least one."""
        return max(len(self._room), 1)

    def suited(self, memory: int) -> list[str] | None:
        """The workers that have so many bytes; None where all have, and those that join later are welcome."""
        if all(room >= memory for room in self._room.values()):
            return None
        return [address for address, room in self._room.items() if room >= memory] or [NOBODY]

    def there(self, addresses: Iterable[str]) -> bool:
        """Whether any of these workers was there at the last look."""
        return not self._room.keys().isdisjoint(addresses)

    def has_only(self, address: str, room: float) -> None:
        """A worker told how many bytes it has."""
        self._room[address] = room

    def muster(self, terms: Terms) -> None:
        """Ask the workers that are there before the first job. Raises ResourceError where none of them may do any."""
        workers = self._update()
        if not workers:
            return self._say(f"The cluster has no workers yet; this run waits {_long(self._patience)} for those that join.")
        unfit = objections(self._client, terms)
        if unfit and len(unfit) >= len(workers):
            worker, why = next(iter(unfit.items()))
            others = f" The other {len(unfit) - 1} may do no job either." if len(unfit) > 1 else ""
            raise ResourceError(f"The worker {worker} {why}.{others}")
        for worker, why in unfit.items():
            self.dismiss(worker, why)

    def dismiss(self, address: str, why: str) -> None:
        """Name a worker that may do no job, and send it away: its scheduler would give it one after the other.

        Raises ResourceError where nobody else comes: whoever starts the workers starts the same ones again and again.
        """
        if address in self._dismissed:
            return
        self._dismissed.add(address)
        self._room.pop(address, None)
        self._say(f"The worker {address} {why}. It gets no jobs.")
        with suppress(*LOST):
            self._client.retire_workers(workers=[address], close_workers=True)
            if len(self._dismissed) >= UNFIT and not self._update():
                raise ResourceError(f"None of {len(self._dismissed)} workers may do a job; the last one, {address}, {why}.")

    def ended(self) -> None:
        """A job has ended: somebody is at work."""
        self._at_work, self._told = time.monotonic(), False
        self._lost.ended(self._at_work)

    @property
    def due(self) -> bool:
        """Whether it is time to look again."""
        return time.monotonic() - self._looked >= LOOKED

    def look(self, needed: int) -> bool:
        """While jobs are waited for, of which the largest needs so many bytes: whether all of them should be handed out again.

        Raises ResourceError when nobody has been at work for very long, or whoever was has died at it: what is waited for would
        never be done.
        """
        now = time.monotonic()
        self._looked = now
        state: str | None = _NO_WORKER
        # When the scheduler is lost, all futures are cancelled, and that is what the run ends with.
        with suppress(*LOST):
            workers = self._update()
            self._lost.seen(set(workers), self._busy(workers))
            if now - self._at_work > LOOKED and (state := self._idle(workers, needed)) is None:
                self._at_work, self._told = time.monotonic(), False
        self._lost.check(now, self._patience)
        idle = now - self._at_work
        if idle > self._patience:
            raise ResourceError(
                f"No worker has done anything for {_long(self._patience)}: {state}; finished jobs are kept. If nobody ended "
                "them, look for memory and disk ('orthomill doctor'), then run the same command again."
            )
        if idle > TOLD and not self._told:
            self._told = True
            left = _long(self._patience - idle)
            self._say(f"No worker does anything: {state}. Finished jobs are kept, and this run waits {left} for others.")
            return bool(self._room)
        return False

    def _update(self) -> dict[str, Any]:
        """What the scheduler knows of the workers that may take jobs, by address."""
        known = workers_of(self._client)
        workers = {address: about for address, about in known.items() if address not in self._dismissed}
        # Dask counts no limit as 0.
        self._room = {address: about.get("memory_limit") or float("inf") for address, about in workers.items()}
        return workers

    def _busy(self, workers: Iterable[str]) -> frozenset[str]:
        """Those that have been given a job."""
        # Asked for all: where one that is named has gone meanwhile, the scheduler answers with an error.
        given = self._client.processing()
        return frozenset(address for address in workers if given.get(address))

    def _idle(self, workers: dict[str, Any], needed: int) -> str | None:
        """Why nobody does anything, None where somebody does."""
        if not workers:
            return _NO_WORKER
        if any(about.get("metrics", {}).get("task_counts", {}).get("executing") for about in workers.values()):
            return None
        running = [address for address, about in workers.items() if about.get("status", "running") == "running"]
        if not running:
            return "all workers are paused, perhaps because their memory is full"
        # A worker that computes may be too busy to report it; it has been given a job, and is not paused.
        if self._busy(running):
            return None
        largest = max(self._room.values())
        if largest < needed:
            return f"a job needs {needed / MIB:.0f} MiB, and the largest worker has {largest / MIB:.0f} MiB; start larger ones"
        return f"the scheduler gives {len(running)} of them no job"


def _long(seconds: float) -> str:
    return f"{seconds / 60:.0f} minutes" if seconds < 7200 else f"{seconds / 3600:.0f} hours"
