"""Tells who watches a run which jobs have a worker, and serves pages on the dashboard's port. One of the three files with Dask.

The scheduler must live in this process, as that of a cluster of this machine does: what observes it is not sent anywhere. Pages
stand behind the secret of the dashboard, because they belong to the same application.
"""

from typing import Any, Protocol

from distributed import Client, Scheduler
from distributed.diagnostics.plugin import SchedulerPlugin
from tornado.web import RequestHandler

from orthomill.pipeline.records.records import Key

Route = tuple[str, type[RequestHandler], dict[str, Any]]
"""(pattern of the path, handler, arguments of its `initialize`)"""


class Observer(Protocol):
    """Whoever wants to know when jobs begin."""

    def started(self, key: Key, worker: str) -> None: ...
    def came_back(self, key: Key, failed: bool) -> None: ...


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


def observe(client: Client, observer: Observer, routes: list[Route]) -> bool:
    """Attach an observer and pages to the scheduler; False where it is of another process."""
    cluster = client.cluster
    scheduler = getattr(cluster, "scheduler", None)
    if cluster is None or not isinstance(scheduler, Scheduler):
        return False

    async def attach() -> None:
        scheduler.add_plugin(_Transitions(scheduler, observer))
        scheduler.http_application.add_handlers(".*$", routes)

    # In the thread of the scheduler: neither its plugins nor its routes may be changed while it uses them.
    cluster.sync(attach)
    return True
