"""What the command does on a cluster, for projects whose stages are a study's own."""

from orthomill.pipeline.engine.dask_cluster import remote_client
from orthomill.pipeline.engine.dask_runner import DaskRunner
from orthomill.pipeline.engine.session import Session, Unwatched
from orthomill.pipeline.engine.workers.worker_terms import shown
from orthomill.pipeline.engine.workers.workforce import DESERTED
from orthomill.schemas.errors import OrthomillError

JOINED = 300.0
"""seconds in which the workers must have joined"""


def run_session(session: Session, address: str, workers: int, memory: int, patience: float = DESERTED) -> None:
    """Run it on the scheduler at `address` once so many workers are there, and end the process: with 0 where no job failed.

    A job has `memory` bytes; without anybody at work the run is given up after `patience` seconds.
    """
    try:
        with remote_client(address) as client, shown(session.folder, session.mark) as terms:
            client.wait_for_workers(workers, timeout=JOINED)
            runner = DaskRunner(client, memory, "elsewhere", memory, terms, print, patience)
            runner.workforce.muster(terms)
            session.run(runner, Unwatched())
            runner.close()
    except OrthomillError as error:
        raise SystemExit(f"error: {error}") from None
    raise SystemExit(int(bool(session.failures)))
