"""A job that needs more than a worker's share of the memory runs alone, with the memory of all workers of the machine."""

import time
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
import pytest
from pydantic import BaseModel
from toy_stages import run_in

from orthomill.pipeline.engine.dask_cluster import local_client
from orthomill.pipeline.engine.dask_runner import DaskRunner
from orthomill.pipeline.engine.graph import PROCESS_BYTES
from orthomill.pipeline.engine.runner import SequentialRunner
from orthomill.schemas.errors import ResourceError
from orthomill.schemas.job import Job, Table
from orthomill.schemas.memory import MIB
from orthomill.schemas.stage_contract import Stage

SHARE = PROCESS_BYTES + 100 * MIB


class Beside(BaseModel):
    """Jobs that ran when this one began or ended."""

    others: int


def touch_memory(folder: str, name: str, mebibytes: int, pause: float) -> Beside:
    """Holds memory for a while; the folder has a file of every job that runs."""
    mark = Path(folder) / name
    mark.touch()
    held = np.ones(mebibytes * MIB, np.uint8)
    others = len(list(Path(folder).iterdir())) - 1
    time.sleep(pause)
    others = max(others, len(list(Path(folder).iterdir())) - 1)
    mark.unlink()
    return Beside(others=others + 0 * int(held[-1]))


class MemoryStage(Stage):
    """Small jobs with a large one among them."""

    title: ClassVar[str] = "using memory"
    kind: Literal["memory"] = "memory"
    folder: str
    large: int = 0

    def plan(self, view):
        for number in range(6):
            large = number == 2
            used = self.large if large else 10
            table = Table(f"memory/{number}.json", Beside)
            params = {"folder": self.folder, "name": str(number), "mebibytes": used, "pause": 1.5 if large else 0.3}
            yield Job(
                stage="memory",
                item=f"job{number}",
                function=touch_memory,
                reads={},
                writes={"beside": table},
                params=params,
                scratch=used * MIB,
            )


@pytest.fixture(scope="module")
def client():
    with local_client(2, SHARE, 0) as found:
        yield found


def test_a_large_job_runs_alone_with_the_memory_of_all_workers(tmp_path, client):
    folder = tmp_path / "running"
    folder.mkdir()
    runner = DaskRunner(client, SHARE, "two processes", 2 * SHARE)
    # More than a worker's share: without the room of both workers, the worker would be ended in the middle of its pause.
    session = run_in(tmp_path, MemoryStage(folder=str(folder), large=SHARE // MIB), runner=runner)
    assert not session.failures and len(session.done) == 6
    beside = [session.store.table(Table(f"memory/{number}.json", Beside)).others for number in range(6)]
    assert beside[2] == 0
    limits = client.run(lambda dask_worker: dask_worker.memory_manager.memory_limit, nanny=True)
    assert set(limits.values()) == {SHARE}, "afterwards each worker has its share again"


def test_what_exceeds_all_workers_together_is_refused(tmp_path):
    with pytest.raises(ResourceError, match=r"memory/job2/0/0 needs .* a job that runs alone may use 1400 MiB"):
        run_in(tmp_path, MemoryStage(folder=str(tmp_path), large=2 * SHARE // MIB), runner=SequentialRunner(SHARE, 2 * SHARE))
