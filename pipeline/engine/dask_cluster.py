"""Starts or finds the Dask cluster that jobs run on. One of the four files that import Dask.

A Dask cluster runs whatever it is told by anyone who reaches it. A cluster of this machine therefore listens on 127.0.0.1 only,
talks TLS with a certificate that exists in the memory of its processes, for this run, and has a dashboard with a secret address. If
the dashboard's port is taken, the next free one is used. Each worker is one process with one thread, because numba kernels and
OpenCV gain nothing from sharing a process, and memory can then be counted per job.
"""

import logging
import os
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import dask
from distributed import Client, Nanny, Scheduler, SpecCluster, Worker
from distributed.comm import CommClosedError
from distributed.security import Security

from orthomill.pipeline.engine.dashboard_guard import Guard, new_secret
from orthomill.pipeline.engine.interruption import stop_if_asked
from orthomill.pipeline.engine.runner import SchedulerLost
from orthomill.pipeline.engine.workers.worker_terms import INSTALL, Terms, objection
from orthomill.schemas.errors import ResourceError
from orthomill.schemas.memory import MIB

ANSWER = "20s"
"""How long the scheduler of an existing cluster may take to answer."""
READY = 600.0
"""Seconds in which a worker must have started, and then have loaded the program; with all cores busy that takes minutes."""
CLOSING = 20
"""Seconds that client and cluster may take to close; after that their processes end with this one."""
ASKED = 60.0
"""Seconds that the workers of an existing cluster may take to say what they are."""
PROGRAM = ("orthomill:__version__", "orthomill.pipeline.engine.dask_runner:execute_sent")
"""What a worker must be able to load: how jobs are done, and the version by which they were planned."""
NOTHING = logging.CRITICAL + 1
"""Level of logging for libraries that call the loss of a connection critical, with a traceback."""
LOST = (CommClosedError, TimeoutError, OSError, RuntimeError, AttributeError)
"""What Dask raises when it is used after its scheduler has gone: besides its own error whatever the missing parts cause."""

SETTINGS = {
    "distributed.scheduler.allowed-failures": 2,
    # Results are keys, not arrays: spilling them frees nothing, and a worker that keeps freed memory (see below) would stay paused.
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.pause": False,
    # A job beyond its limit is killed by Dask, which reports it, before the kernel kills an arbitrary process.
    "distributed.worker.memory.terminate": 0.98,
    "distributed.worker.memory.monitor-interval": "300ms",
    "distributed.worker.profile.enabled": True,
    "distributed.worker.profile.interval": "100ms",
    "distributed.admin.tick.interval": "500ms",
    # So many messages are kept of what was sent to the scheduler and to each worker, with the jobs in them: a thousand, the usual
    # number, are gigabytes for a thousand workers.
    "distributed.admin.low-level-log-length": 100,
    "distributed.admin.system-monitor.interval": "2s",
    "distributed.scheduler.work-stealing-interval": "500ms",
    # On a machine with all cores busy a process can wait minutes for its turn. A process that has ended closes its connections, and
    # that is noticed at once; these limits only decide how long silence is taken for life.
    "distributed.comm.timeouts.connect": "300s",
    "distributed.comm.timeouts.tcp": "300s",
    "distributed.scheduler.worker-ttl": "60 minutes",
    # Workers answer no questions over HTTP: nothing here asks them, and the ports would be open to everybody on the machine.
    "distributed.worker.http.routes": [],
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 32 * MIB,
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 256 * MIB,
}
"""A worker keeps freed memory for the arrays of its next job: glibc's own thresholds, and Dask's, return the pages of every tile to
the kernel, which then clears them for the next tile. That took a fifth of the CPU time of a run.

Scheduler, nannies and workers monitor themselves less often than by Dask's defaults: jobs take seconds, and polling up to a hundred
times a second took 0.1 s of CPU time per second of a run, whatever was running."""


def free_port(wanted: int) -> int:
    """`wanted`, or the next free port of 127.0.0.1; 0 (any) when fifty in a row are taken."""
    for port in range(wanted, min(wanted + 50, 65536)):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
    return 0  # any free port, by the convention of sockets


class GuardedScheduler(Scheduler):
    """A scheduler whose web pages are found under its secret only."""

    def __init__(self, secret: str, **options: Any) -> None:
        self._secret = secret
        super().__init__(http_prefix=f"/{secret}", **options)

    def start_http_server(self, *words: Any, **options: Any) -> None:
        super().start_http_server(*words, **options)
        # No request can have been answered yet: the event loop has had no turn since the server listens.
        self.http_server.request_callback = Guard(self.http_application, self._secret)


@contextmanager
def local_client(workers: int, memory: int, port: int) -> Iterator[Client]:
    """A client of `workers` processes with `memory` bytes each; the dashboard listens on `port` or the next free one.

    Raises ResourceError when the processes do not start, SchedulerLost when their scheduler goes.
    """
    silence()
    secret = new_secret()
    link = {"distributed.dashboard.link": f"{{scheme}}://{{host}}:{{port}}/{secret}/status"}
    with dask.config.set(SETTINGS | link):
        try:
            with _ctrl_c_blocked():
                cluster = _started(workers, memory, port, secret)
        except (RuntimeError, OSError, TimeoutError) as error:
            # Who asks for a stop while processes start may be heard as their failure.
            stop_if_asked()
            reason = f"{error} {error.__cause__!r}" if error.__cause__ else str(error)
            raise ResourceError(
                f"The {workers} worker processes could not be started ({reason}); check memory and installation with "
                "'orthomill doctor', or run with --sequential, which needs none."
            ) from error
        try:
            with opened(Client(cluster), "of this machine", "free memory or processors if the machine is overloaded") as client:
                _check_program(client, "its files may have changed meanwhile, so run the same command again")
                yield client
        finally:
            with suppress(*LOST):
                cluster.close(timeout=CLOSING)


def _started(workers: int, memory: int, port: int, secret: str) -> SpecCluster:
    """A cluster, at the second attempt if need be: a worker that is killed while it starts takes the whole cluster with it."""
    try:
        return _cluster(workers, memory, port, secret)
    except RuntimeError:
        stop_if_asked()
        return _cluster(workers, memory, port, secret)


def _cluster(workers: int, memory: int, port: int, secret: str) -> SpecCluster:
    """A scheduler in this process, and worker processes of this machine."""
    common = {"host": "127.0.0.1", "protocol": "tls://", "security": Security.temporary()}
    scheduler = {"secret": secret, "port": 0, "dashboard": True, "dashboard_address": f"127.0.0.1:{free_port(port)}"}
    worker = {"nthreads": 1, "memory_limit": memory, "silence_logs": NOTHING, "death_timeout": READY}
    return SpecCluster(
        scheduler={"cls": GuardedScheduler, "options": common | scheduler},
        workers={number: {"cls": Nanny, "options": common | worker} for number in range(workers)},
        security=common["security"],
        silence_logs=NOTHING,
    )


def _check_program(client: Client, advice: str) -> None:
    """Raises ResourceError where a worker does not load this version of the program."""
    try:
        for worker, why in _other_programs(client, READY).items():
            raise ResourceError(f"The worker {worker} {why}; {advice}.")
    except TimeoutError as error:
        raise ResourceError(f"A worker did not load orthomill within {READY / 60:.0f} minutes; {advice}.") from error


def _other_programs(client: Client, patience: float) -> dict[str, str]:
    """What is wrong with the program of each worker that does not load this version. Raises TimeoutError."""
    found: dict[str, str] = {}
    # By a function of Python's own: what a worker cannot load breaks its connection, and its jobs would be waited for in vain.
    for name in PROGRAM:
        answers = client.run(resolve_name, name, on_error="return", callback_timeout=patience)
        for worker, answer in answers.items():
            # One that ended in the middle says nothing of the program; its successor is asked with its first order.
            if isinstance(answer, (CommClosedError, TimeoutError)):
                continue
            if isinstance(answer, Exception):
                found.setdefault(worker, f"cannot load orthomill ({type(answer).__name__}: {answer})")
            elif answer != (own := resolve_name(name)):
                found.setdefault(worker, f"has orthomill {answer}, and this is {own}")
    return found


def workers_of(client: Client) -> dict[str, Any]:
    """What the scheduler knows of its workers, by address."""
    # The scheduler itself is asked: what a client holds of it is overwritten every other second by an answer that names no worker.
    assert client.scheduler is not None
    answer: dict[str, Any] = client.sync(client.scheduler.identity, n_workers=-1)
    return answer.get("workers", {})


def objections(client: Client, terms: Terms) -> dict[str, str]:
    """Why workers of an existing cluster may do no job of a run, by address.

    One that does not answer in time is asked with its first order.
    """
    with suppress(TimeoutError):
        found = {worker: f"{why}; {INSTALL}" for worker, why in _other_programs(client, ASKED).items()}
        able = [worker for worker in workers_of(client) if worker not in found]
        answers = client.run(_objection, terms, workers=able, on_error="return", callback_timeout=ASKED) if able else {}
        return found | {worker: why for worker, why in answers.items() if isinstance(why, str)}
    return {}


def _objection(terms: Terms, dask_worker: Worker) -> str | None:
    # Dask passes the worker to a parameter of this name.
    return objection(terms, dask_worker.state.nthreads)


def allow_memory(client: Client, memory: int) -> None:
    """From now on a worker of this machine is ended only where it uses more than `memory` bytes."""
    client.run(_allow_memory, memory, nanny=True)


def _allow_memory(memory: int, dask_worker: Nanny) -> None:
    # Dask passes the nanny to a parameter of this name.
    dask_worker.memory_manager.memory_limit = memory


@contextmanager
def opened(client: Client, where: str, advice: str) -> Iterator[Client]:
    """A client, whose end never hides the reason for which the run ends. Raises SchedulerLost."""
    try:
        yield client
    except LOST as error:
        # A client that is still connected has nothing to do with errors that Dask may cause by its loss.
        if client.status == "running" and not isinstance(error, CommClosedError):
            raise
        raise SchedulerLost(
            f"The Dask scheduler {where} was lost in the middle of the run; finished jobs are kept, so {advice} "
            "and run the same command again to continue."
        ) from error
    finally:
        _close(client)


def _close(client: Client) -> None:
    """The end of a client. Whatever an attempt to reconnect that was under way raises comes out here, errors of tornado among them;
    what could not be closed is not to be closed once more when the interpreter ends, with a traceback on the terminal."""
    try:
        client.close(timeout=CLOSING)
    except Exception:  # see above
        client.status = "closed"


def silence() -> None:
    """What these libraries would log with tracebacks, the loss of a connection above all, is reported in one sentence."""
    for name in ("distributed", "distributed.client", "tornado", "asyncio", "bokeh"):
        logging.getLogger(name).setLevel(NOTHING)


@contextmanager
def _ctrl_c_blocked() -> Iterator[None]:
    """Threads started inside, and all processes that they start, never receive Ctrl-C, which a terminal sends to the whole process
    group: only this thread is to handle it, after it has left this context."""
    with _environment("PYTHONWARNINGS", "ignore::UserWarning:multiprocessing.resource_tracker"):
        resource_tracker.ensure_running()  # started by a thread inside, it would unblock the signal for that thread
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _environment(name: str, value: str) -> Iterator[None]:
    """An environment variable for processes that are started inside. What a process killed by Dask leaves behind is removed by the
    tracker in any case; its warning would be the last line on the terminal, below the result."""
    before = os.environ.get(name)
    os.environ[name] = value
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before


@contextmanager
def remote_client(address: str, tls: tuple[Path, Path, Path] | None = None) -> Iterator[Client]:
    """A client of an existing cluster. Raises ResourceError.

    With `tls` (certificate of an authority, own certificate, own key) everything is encrypted, and both sides must have a
    certificate of that authority.
    """
    silence()
    try:
        reached = Client(address, timeout=ANSWER, security=_security(tls))
    except (OSError, TimeoutError, ValueError, TypeError, RuntimeError) as error:
        raise ResourceError(
            f"No Dask scheduler answers at {address} ({error}); start one with 'dask scheduler' or leave --scheduler out."
        ) from error
    with opened(reached, f"at {address}", "restart the cluster") as client:
        yield client


def _security(tls: tuple[Path, Path, Path] | None) -> Security | None:
    if tls is None:
        return None
    authority, certificate, key = map(str, tls)
    return Security(require_encryption=True, tls_ca_file=authority, tls_client_cert=certificate, tls_client_key=key)
