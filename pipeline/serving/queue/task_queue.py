"""The queue of tasks: what is on the disk is the truth, and one look at it after another brings everything forward.

Each look ends what has ended, begins what can begin, and stops what was cancelled. A server that is killed has only missed looks:
the processes of the tasks go on without it.
"""

import os
import signal
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import DEVNULL, Popen
from threading import RLock

import psutil

from orthomill.pipeline.records.lock import is_running
from orthomill.pipeline.serving.queue.task_folder import UUID, TaskFolder
from orthomill.pipeline.serving.queue.task_process import ENGINE, TaskOrder
from orthomill.pipeline.serving.queue.task_state import TaskState, TaskStatus, now
from orthomill.pipeline.serving.queue.wishes import Wishes
from orthomill.schemas.errors import ResourceError, StoreError
from orthomill.schemas.memory import GIB, MIB

MOST_LOSSES = 3
"""processes of a task that may be ended by others before it is given up"""
PATIENCE = 20.0
"""seconds that a cancelled task gets to end by itself"""
DAY = 86_400_000
"""ms"""


@dataclass(frozen=True)
class QueueRules:
    """How tasks are done, and how long they are kept."""

    parallel: int = 1
    """tasks at a time"""
    memory: int = 1500
    """of a worker process, MiB"""
    keep_days: float = 30.0
    """days after which a task that has ended is removed; 0: never"""
    upload_days: float = 2.0
    """days after which an upload that nobody continued is removed"""
    most_bytes: int = 500 * GIB
    """that the archives of a task may be unpacked to"""
    reserve: int = 2 * GIB
    """bytes of the disk that are left free: nothing is taken or begun beyond"""
    paper: bool = True
    """whether reports are printed as PDF where the machine has a browser"""
    scheduler: str = ""
    """address of a Dask scheduler whose workers see the tasks' folders; "": tasks use the cores of this machine"""
    engine: tuple[str, ...] = ENGINE

    @property
    def processes(self) -> int:
        """Worker processes of a task."""
        return max((os.cpu_count() or 1) // self.parallel, 1)


def _to_the_medium(upload: TaskFolder) -> None:
    """A power cut does not take what an upload became; its files were flushed one by one when they came."""
    for path in (upload.path / "task.json", upload.path / "wishes.json", upload.images, upload.path, upload.path.parent):
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@dataclass
class TaskQueue:
    """All tasks below a folder. Its methods may be called from any thread."""

    home: Path
    rules: QueueRules = field(default_factory=QueueRules)
    notify: Callable[[TaskState], None] = lambda state: None
    """told of each task that has ended with a webhook, until `told` is called"""
    tasks: dict[str, TaskState] = field(default_factory=dict)
    trouble: str = ""
    """why tasks wait although nothing runs"""
    _children: dict[str, Popen[bytes]] = field(default_factory=dict)
    _stopping: dict[str, float] = field(default_factory=dict)
    _lock: RLock = field(default_factory=RLock)

    def __post_init__(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        for path in sorted(self.folder.iterdir()):
            if path.name.startswith(".gone-"):
                TaskFolder(path).remove()
            elif UUID.fullmatch(path.name) and (state := TaskFolder(path).state()) is not None:
                self.tasks[path.name] = state
                if state.status != TaskStatus.RUNNING and is_running(path):
                    self._stopping[path.name] = time.monotonic()

    @property
    def folder(self) -> Path:
        """Folder of the tasks."""
        return self.home / "tasks"

    def of(self, uuid: str) -> TaskFolder:
        """The folder of a task."""
        return TaskFolder(self.folder / uuid)

    def add(self, upload: TaskFolder, state: TaskState, wishes: Wishes) -> TaskState:
        """Take an upload that is whole as a task. Raises StoreError; what was uploaded is kept then."""
        ready = state.model_copy(update={"status": TaskStatus.QUEUED, "queued": now(), "bytes": upload.bytes_used()})
        upload.keep_wishes(wishes)
        upload.keep(ready)
        _to_the_medium(upload)
        # From this rename on the task exists, whatever happens.
        try:
            upload.path.rename(self.folder / ready.uuid)
        except OSError as error:
            raise StoreError(f"The task cannot be taken: {error.strerror}.") from error
        with self._lock:
            self.tasks[ready.uuid] = ready
        return ready

    def cancel(self, uuid: str) -> None:
        """Stop a task, or take it out of the queue; one that has ended stays as it is."""
        with self._lock:
            if self.tasks[uuid].status.ended:
                return
            self._end(uuid, status=TaskStatus.CANCELED, ended=now(), told=not self.tasks[uuid].webhook)
            self._stopping[uuid] = time.monotonic()
            self._signal(uuid, signal.SIGTERM)

    def remove(self, uuid: str) -> None:
        """Stop a task and remove everything of it."""
        with self._lock:
            if not self.tasks[uuid].status.ended:
                self._change(uuid, status=TaskStatus.CANCELED, ended=now())
            self._signal(uuid, signal.SIGKILL)
            child = self._children.pop(uuid, None)
            if child is not None:
                child.wait(PATIENCE)
            self._stopping.pop(uuid, None)
            self.of(uuid).remove()
            del self.tasks[uuid]

    def restart(self, uuid: str, options: tuple | None = None, wishes: Wishes | None = None) -> None:
        """Put a task that has ended into the queue again, with other options where they are given. Raises ResourceError for one
        that has not ended."""
        with self._lock:
            state, folder = self.tasks[uuid], self.of(uuid)
            if not state.status.ended:
                raise ResourceError("Only a task that has ended can be restarted; cancel it first.")
            # From where an earlier restart began is not asked for again.
            folder.keep_wishes(wishes or folder.wishes().model_copy(update={"rerun_from": ""}))
            folder.begin_again()
            changes = {} if options is None else {"options": options}
            # Photographs of a store are counted anew by the process of the task.
            images = 0 if state.read_from else state.images
            fresh = {"begun": -1, "ended": -1, "attempts": 0, "losses": 0, "error": "", "told": True, "images": images}
            self._change(uuid, status=TaskStatus.QUEUED, queued=now(), **fresh, **changes)

    def told(self, uuid: str) -> None:
        """The webhook of a task was called."""
        with self._lock:
            if uuid in self.tasks:
                self._change(uuid, told=True)

    def look(self) -> None:
        """Bring every task forward. What the disk refuses is `trouble`, and tried again at the next look."""
        with self._lock:
            try:
                for uuid, state in list(self.tasks.items()):
                    if state.status == TaskStatus.RUNNING:
                        self._watch(uuid)
                self._stop()
                self._begin()
                for state in list(self.tasks.values()):
                    if state.status.ended and not state.told:
                        self.notify(state)
            except (StoreError, OSError) as error:
                self.trouble = str(error)

    def tidy(self) -> None:
        """Remove what is older than the rules keep."""
        with self._lock:
            if self.rules.keep_days:
                oldest = now() - self.rules.keep_days * DAY
                for uuid in [uuid for uuid, state in self.tasks.items() if state.status.ended and 0 <= state.ended < oldest]:
                    self.remove(uuid)

    def _change(self, uuid: str, **changes: object) -> None:
        state = self.tasks[uuid].model_copy(update=changes)
        self.of(uuid).keep(state)
        self.tasks[uuid] = state

    def _end(self, uuid: str, **changes: object) -> None:
        """The photographs of archives are counted by the process of the task, whose progress is forgotten at a restart."""
        images = self.tasks[uuid].images + self.of(uuid).progress().images
        self._change(uuid, images=images, **changes)

    def _alive(self, uuid: str) -> bool:
        child = self._children.get(uuid)
        if child is not None and child.poll() is None:
            return True
        # A process that an earlier server started is known by the lock that it holds.
        return is_running(self.of(uuid).path)

    def _watch(self, uuid: str) -> None:
        state, end = self.tasks[uuid], self.of(uuid).end()
        if end is not None:
            status = TaskStatus.FAILED if end.error else TaskStatus.COMPLETED
            changes = {"status": status, "error": end.error, "ended": now(), "told": not state.webhook}
            self._end(uuid, bytes=self.of(uuid).bytes_used(), **changes)
        elif not self._alive(uuid):
            watched = self._children.pop(uuid, None) is not None
            losses = state.losses + watched
            if losses < MOST_LOSSES:
                self._change(uuid, status=TaskStatus.QUEUED, losses=losses)
                return
            error = (
                f"The process of the task was ended {losses} times by others, most often for want of memory; a restart goes on "
                "where it stopped, with fewer processes (max-concurrency) or smaller tiles (tile) it needs less."
            )
            self._end(uuid, status=TaskStatus.FAILED, losses=losses, error=error, ended=now(), told=not state.webhook)

    def _stop(self) -> None:
        for uuid, since in list(self._stopping.items()):
            if uuid not in self.tasks or not (self._alive(uuid) or is_running(self.of(uuid).run)):
                del self._stopping[uuid]
                self._children.pop(uuid, None)
            else:
                self._signal(uuid, signal.SIGKILL if time.monotonic() - since > PATIENCE else signal.SIGTERM)

    def _signal(self, uuid: str, number: int) -> None:
        """A signal to the process of a task and to all that it started."""
        folder, groups = self.of(uuid), set()
        child = self._children.get(uuid)
        if child is not None and child.poll() is None:
            groups.add(child.pid)
        for held in (folder.path, folder.run):
            # The lock tells the process, and that it lives: numbers are given to others when it does not.
            with suppress(OSError, ValueError):
                if is_running(held):
                    groups.add(os.getpgid(int((held / ".lock").read_text())))
        for group in groups - {os.getpgid(0)}:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(group, number)

    def _begin(self) -> None:
        running = [state for state in self.tasks.values() if state.status == TaskStatus.RUNNING]
        waiting = [state for state in self.tasks.values() if state.status == TaskStatus.QUEUED and state.uuid not in self._stopping]
        self.trouble = ""
        if not waiting or len(running) >= self.rules.parallel:
            return
        need = self.rules.processes * self.rules.memory * MIB
        if running and psutil.virtual_memory().available < need:
            return
        free = psutil.disk_usage(str(self.folder)).free
        if free < self.rules.reserve:
            self.trouble = f"Tasks wait: {free / GIB:.1f} GiB of the disk are free, {self.rules.reserve / GIB:.1f} are kept."
            return
        # Whoever has fewest running comes first, so that one user's hundred tasks do not keep another's single one waiting.
        busy = Counter(state.owner for state in running)
        chosen = min(waiting, key=lambda state: (busy[state.owner], state.queued, state.uuid))
        begun = chosen.begun if chosen.attempts else now()
        self._change(chosen.uuid, status=TaskStatus.RUNNING, begun=begun, attempts=chosen.attempts + 1)
        self._start(chosen.uuid)

    def _start(self, uuid: str) -> None:
        folder = self.of(uuid)
        rules = self.rules
        order = TaskOrder(
            folder=folder.path.resolve(),
            engine=rules.engine,
            processes=rules.processes,
            memory=rules.memory,
            most_bytes=rules.most_bytes,
            reserve=rules.reserve,
            paper=rules.paper,
            scheduler=rules.scheduler,
        )
        program = [ENGINE[0], "-m", "orthomill.pipeline.serving.queue.task_process", order.model_dump_json()]
        with open(folder.path / "process.log", "ab") as log:
            # A session of its own: signals for the server are none for the task, and a signal for the task reaches all of it.
            self._children[uuid] = Popen(program, stdin=DEVNULL, stdout=log, stderr=log, start_new_session=True)
