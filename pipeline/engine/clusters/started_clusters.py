"""Starts the cluster that a file names, lets it grow and shrink with the work, and ends it with the run.

The libraries that speak to SLURM, Kubernetes and gateways are loaded here only, and are no part of an ordinary installation.
"""

import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import dask
from distributed import Client
from distributed.security import Security

from orthomill.pipeline.engine.clusters.cluster_file import GatewayCluster, KubernetesCluster, SlurmCluster, StartedCluster
from orthomill.pipeline.engine.dashboard_guard import new_secret
from orthomill.pipeline.engine.dask_cluster import CLOSING, LOST, SETTINGS, GuardedScheduler, free_port, opened, silence
from orthomill.pipeline.engine.interruption import stop_if_asked
from orthomill.schemas.errors import ResourceError

PLACES = {"slurm": "queue", "kubernetes": "pods and their events", "gateway": "log"}
"""where a cluster says what became of its scheduler"""


@contextmanager
def started_client(cluster: StartedCluster, port: int, say: Callable[[str], None] = lambda line: None) -> Iterator[Client]:
    """A client of a cluster that is started now and ends with this context; the dashboard listens on `port` or the next free one.
    `say` tells the user a sentence.

    Raises ResourceError where a library is missing or the cluster does not start, SchedulerLost when its scheduler goes.
    """
    silence()
    secret = new_secret()
    link = {"distributed.dashboard.link": f"{{scheme}}://{{host}}:{{port}}/{secret}/status"} if _is_here(cluster) else {}
    with dask.config.set(SETTINGS | link):
        running = _begun(cluster, secret, port, say)
        try:
            with opened(Client(running), f"of the cluster ({cluster.kind})", f"look at its {PLACES[cluster.kind]}") as client:
                yield client
        finally:
            with suppress(*LOST):
                # A gateway takes the time that it takes.
                running.close(**({} if cluster.kind == "gateway" else {"timeout": CLOSING}))


def _is_here(cluster: StartedCluster) -> bool:
    """Whether the scheduler is in this process."""
    return cluster.kind == "slurm"


def _begun(cluster: StartedCluster, secret: str, port: int, say: Callable[[str], None]) -> Any:
    try:
        if isinstance(cluster, SlurmCluster):
            return _slurm(cluster, secret, port)
        return _kubernetes(cluster, say) if isinstance(cluster, KubernetesCluster) else _gateway(cluster)
    except ImportError as error:
        raise ResourceError(
            f"Clusters of the kind {cluster.kind} need a library that is not installed ({error.name}); type: "
            f"pip install 'orthomill[{cluster.kind}]'"
        ) from error
    except (OSError, RuntimeError, ValueError, TimeoutError) as error:
        raise ResourceError(f"The cluster ({cluster.kind}) could not be started: {error}") from error


def _slurm(asked: SlurmCluster, secret: str, port: int) -> Any:
    from dask_jobqueue import SLURMCluster

    cluster = SLURMCluster(
        queue=asked.queue,
        account=asked.account,
        cores=asked.workers_per_job,
        processes=asked.workers_per_job,
        memory=f"{asked.memory * asked.workers_per_job:.3f}GiB",
        walltime=asked.walltime,
        interface=asked.interface,
        local_directory=asked.scratch,
        job_script_prologue=list(asked.prologue),
        job_extra_directives=list(asked.directives),
        python=asked.python or sys.executable,
        # Before its walltime a worker hands back what it has not begun, at a time of its own: not all at once.
        worker_extra_args=["--lifetime", f"{asked.lifetime}s", "--lifetime-stagger", f"{max(asked.lifetime // 10, 1)}s"],
        # Nodes and this machine share a folder anyway; who cannot read it cannot speak to the scheduler.
        protocol="tls://",
        security=Security.temporary(),
        shared_temp_directory=str(_private_folder()),
        scheduler_cls=GuardedScheduler,
        scheduler_options={"secret": secret, "dashboard": True, "dashboard_address": f"127.0.0.1:{free_port(port)}"},
        silence_logs=False,
    )
    try:
        _try_out(cluster.job_script())
    except ResourceError:
        cluster.close(timeout=CLOSING)
        raise
    cluster.adapt(minimum_jobs=_jobs(asked, asked.least), maximum_jobs=_jobs(asked, asked.workers))
    return cluster


def _try_out(script: str) -> None:
    """Ask SLURM whether it would take a batch job. Raises ResourceError with its answer: later nobody would hear it."""
    sbatch = shutil.which("sbatch")
    if sbatch is None:
        raise ResourceError("There is no SLURM on this machine (sbatch is not found); start the run on a login node.")
    try:
        answer = subprocess.run([sbatch, "--test-only"], input=script, capture_output=True, text=True, timeout=60)  # noqa: S603 (a list, no shell)
    except subprocess.TimeoutExpired:
        raise ResourceError("SLURM does not answer (sbatch, 60 seconds); look at it with sinfo.") from None
    if answer.returncode:
        said = " ".join(answer.stderr.replace("allocation failure: ", "").split())
        raise ResourceError(
            f"SLURM refuses the batch jobs of this cluster ({said}); compare queue, memory and walltime with sinfo."
        )


def _private_folder() -> Path:
    """A folder that all nodes see and no other user reads, for the certificate of this run."""
    folder = Path.home() / ".orthomill"
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder


def _jobs(asked: SlurmCluster, workers: int) -> int:
    """Batch jobs for so many workers."""
    return -(-workers // asked.workers_per_job)


def _kubernetes(asked: KubernetesCluster, say: Callable[[str], None]) -> Any:
    from orthomill.pipeline.engine.clusters.operated_pods import OperatedPods

    try:
        return OperatedPods(asked, say)
    except ResourceError:
        stop_if_asked()
        raise


def _gateway(asked: GatewayCluster) -> Any:
    from dask_gateway import Gateway, GatewayClusterError, GatewayServerError

    try:
        cluster = Gateway(asked.address).new_cluster()
    except (GatewayClusterError, GatewayServerError) as error:
        raise ResourceError(f"The gateway does not start a cluster ({error}); look at its log.") from error
    cluster.adapt(minimum=asked.least, maximum=asked.workers)
    return cluster
