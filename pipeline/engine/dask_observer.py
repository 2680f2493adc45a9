"""Tells who watches a run which jobs have a worker, and serves pages on the dashboard's port. One of the three files with Dask.

A scheduler that lives in this process, as that of a cluster of this machine does, tells of every transition, and its dashboard has
the pages, behind its secret and in its menu. The scheduler of another process is asked: nothing of orthomill is sent to it. That a
job is tried again by the same worker is then known from its record only, when it has ended.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from threading import Event, Thread
from typing import Any, Protocol

from distributed import Client, Scheduler
from distributed.dashboard.scheduler import template_variables
from distributed.diagnostics.plugin import SchedulerPlugin
from tornado.web import RequestHandler

from orthomill.pipeline.engine.dask_cluster import LOST
from orthomill.pipeline.records.numbered_names import Key

ASKED = 1.0
"""seconds after which a scheduler elsewhere is asked again what its workers do"""

Route = tuple[str, type[RequestHandler], dict[str, Any]]
"""(pattern of the path, handler, arguments of its `initialize`)"""


class Observer(Protocol):
    """Whoever wants to know when jobs begin."""

    def started(self, key: Key, worker: str) -> None:
        """A worker has begun a job."""

    def came_back(self, key: Key, failed: bool) -> None:
        """A job that had begun is no longer worked on: it failed, or its worker was lost."""


@dataclass(frozen=True)
class EachJob:
    """Tells an observer of every job of a task; `jobs_of` gives them by that which the task is named after."""

    observer: Observer
    jobs_of: Callable[[Key], tuple[Key, ...]]

    def started(self, key: Key, worker: str) -> None:
        """A worker has got all of them."""
        for one in self.jobs_of(key):
            self.observer.started(one, worker)

    def came_back(self, key: Key, failed: bool) -> None:
        """None of them is worked on any longer."""
        for one in self.jobs_of(key):
            self.observer.came_back(one, failed)


class _Transitions(SchedulerPlugin):
    name = "orthomill"

    def __init__(self, scheduler: Scheduler, observer: Observer) -> None:
        self._scheduler, self._observer = scheduler, observer

    def transition(self, key: Any, start: str, finish: str, *args: Any, stimulus_id: str, **more: Any) -> None:
        # The last part of a key is the run; ends are told by the session, which survives what the scheduler forgets.
        if not isinstance(key, tuple) or len(key) != 5:
            return
        # With attempts left, a failed job goes back to wait; only the name of the event tells that from a worker that was lost.
        if start == "processing" and finish == "released":
            self._observer.came_back(key[:4], failed=stimulus_id.startswith("task-erred"))
        elif finish == "processing":
            task = self._scheduler.tasks.get(key)
            worker = task.processing_on.address if task and task.processing_on else ""
            self._observer.started(key[:4], worker)


def observe(client: Client, observer: Observer, routes: list[Route], page: str) -> bool:
    """Attach an observer and pages to the scheduler, `page` first in its menu; False where it is of another process."""
    cluster = client.cluster
    scheduler = getattr(cluster, "scheduler", None)
    if cluster is None or not isinstance(scheduler, Scheduler):
        return False

    async def attach() -> None:
        scheduler.add_plugin(_Transitions(scheduler, observer))
        scheduler.http_application.add_handlers(".*$", routes)
        menu = template_variables(scheduler)["pages"]
        # The graph of tasks draws every job at once; with a hundred thousand the workers would wait for the picture.
        menu[:] = [page, *(name for name in menu if name not in (page, "graph"))]

    # In the thread of the scheduler: neither its plugins nor its routes may be changed while it uses them.
    cluster.sync(attach)
    return True


@contextmanager
def asking(client: Client, observer: Observer) -> Iterator[None]:
    """Inside, an observer is told what the workers of a scheduler elsewhere have got."""
    ended = Event()
    thread = Thread(target=_ask, args=(client, observer, ended), name="what workers do", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(5)


def _ask(client: Client, observer: Observer, ended: Event) -> None:
    told: dict[Any, str] = {}
    while not ended.wait(ASKED):
        # When the scheduler is lost, the run ends with a sentence; the map has nothing to add to it.
        with suppress(*LOST):
            for worker, keys in client.processing().items():
                for key in keys:
                    if isinstance(key, tuple) and len(key) == 5 and told.get(key) != worker:
                        told[key] = worker
                        observer.started(key[:4], worker)
