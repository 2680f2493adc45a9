"""Starts or finds the Dask cluster that jobs run on. One of the two files that import Dask.

Everything listens on 127.0.0.1 only. If the dashboard's port is taken, the next free one is used. Each worker is one process with
one thread, because numba kernels and OpenCV gain nothing from sharing a process, and memory can then be counted per job.
"""

import logging
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker

import dask
from distributed import Client, LocalCluster, Worker
from distributed.comm import CommClosedError

from orthomill.schemas.errors import ResourceError

MEMORY = "orthomill_memory"
"""Name of the worker resource, in bytes."""

ANSWER = "20s"
"""How long the scheduler of an existing cluster may take to answer."""

_SETTINGS = {
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
    "distributed.admin.system-monitor.interval": "2s",
    "distributed.scheduler.work-stealing-interval": "500ms",
    # On a machine with all cores busy the client can wait longer than Dask's 30 s for its own scheduler.
    "distributed.comm.timeouts.connect": "60s",
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 32 * 2**20,
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 256 * 2**20,
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


@contextmanager
def local_client(workers: int, memory: int, port: int) -> Iterator[Client]:
    """A client of `workers` processes with `memory` bytes each; the dashboard listens on `port` or the next free one.

    Raises ResourceError when the processes do not start.
    """
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with dask.config.set(_SETTINGS):
        try:
            with _ctrl_c_blocked():
                cluster = LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    memory_limit=memory,
                    dashboard_address=f"127.0.0.1:{free_port(port)}",
                    silence_logs=logging.CRITICAL,
                    resources={MEMORY: memory},
                )
        except (RuntimeError, OSError, TimeoutError) as error:
            raise ResourceError(
                f"The {workers} worker processes could not be started ({error}); check memory and installation with "
                "'orthomill doctor', or run with --sequential, which needs none."
            ) from error
        with cluster, Client(cluster) as client:
            yield client


@contextmanager
def _ctrl_c_blocked() -> Iterator[None]:
    """Threads started inside, and all processes that they start, never receive Ctrl-C, which a terminal sends to the whole process
    group: only this thread is to handle it, after it has left this context."""
    resource_tracker.ensure_running()  # started by a thread inside, it would unblock the signal for that thread
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def remote_client(address: str, memory: int) -> Iterator[Client]:
    """A client of an existing cluster whose workers see the project's folder. Raises ResourceError."""
    # The errors of a lost connection are reported below in one sentence; Dask would log them with tracebacks.
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=ANSWER)
    except (OSError, TimeoutError, ValueError) as error:
        raise ResourceError(
            f"No Dask scheduler answers at {address} ({error}); start one with 'dask scheduler' or leave --scheduler out."
        ) from error
    try:
        with client:
            if not client.scheduler_info(n_workers=-1)["workers"]:
                raise ResourceError(f"The Dask scheduler at {address} has no workers; start some with 'dask worker {address}'.")
            # Workers that somebody else started do not offer the resource that the jobs ask for, and would never get one.
            client.run(_declare_memory, memory)
            yield client
    except CommClosedError as error:
        raise ResourceError(
            f"The Dask scheduler at {address} was lost in the middle of the run; finished jobs are kept, so restart the cluster "
            "and run the same command again to continue."
        ) from error


async def _declare_memory(memory: int, dask_worker: Worker) -> None:
    # Dask passes the worker to a parameter of this name.
    await dask_worker.set_resources(**{MEMORY: memory})
