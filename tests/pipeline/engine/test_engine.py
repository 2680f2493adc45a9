"""The engine on three toy stages: what is planned, skipped, run again, failed and resumed."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from toy_stages import MEMORY, TOTAL, Size, SmoothStage, SourceStage, SumStage, Total, pixels, run_in, session_in

from orthomill.pipeline.engine.graph import Graph, GraphError
from orthomill.pipeline.engine.runner import SequentialRunner
from orthomill.pipeline.engine.session import Session
from orthomill.pipeline.storage.store import Store
from orthomill.pipeline.workflow.workflow_checks import kind_of
from orthomill.pipeline.workflow.workflow_file import load_workflow
from orthomill.schemas.errors import ResourceError, WorkflowError
from orthomill.schemas.job import Job, Raster, Table
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import Window
from orthomill.schemas.truth import TRUTH_BLOCK, TRUTH_ORTHO, TRUTH_SURFACE, TRUTH_VISIBILITY
from orthomill.tasks.catalogue import STAGES


def test_all_stages_run_and_nothing_runs_again(tmp_path):
    first = run_in(tmp_path)
    assert len(first.done) == 1 + 4 + 4 + 1 + 1
    assert not first.failures
    second = run_in(tmp_path)
    assert not second.done and len(second.skipped) == len(first.done)


def test_a_halo_makes_tiles_equal_to_the_untiled_run(tmp_path):
    run_in(tmp_path / "small", tile=128)
    run_in(tmp_path / "large", tile=512)
    assert np.array_equal(pixels(tmp_path / "small"), pixels(tmp_path / "large"))


def test_a_changed_setting_runs_only_what_depends_on_it(tmp_path):
    run_in(tmp_path)
    again = run_in(tmp_path, SourceStage(factor=2.0), SmoothStage(), SumStage())
    assert {key[0] for key in again.done} == {"source", "smooth", "sum"}
    assert ("source", "size", 0, 0) in again.skipped
    assert set(again.reasons.values()) == {"settings changed", "inputs changed"}


def test_going_back_to_an_earlier_shape_does_not_trust_old_records(tmp_path):
    before = run_in(tmp_path) and pixels(tmp_path)
    run_in(tmp_path, SourceStage(rows=100), SmoothStage(), SumStage())
    run_in(tmp_path)
    assert np.array_equal(pixels(tmp_path), before)


def test_a_lost_raster_is_made_again(tmp_path):
    run_in(tmp_path)
    expected = pixels(tmp_path)
    Store(tmp_path / "runs" / "toy").delete("smooth/numbers")
    again = run_in(tmp_path)
    assert set(again.reasons.values()) == {"result is missing"}
    assert np.array_equal(pixels(tmp_path), expected)


def test_from_a_stage_runs_it_and_all_after(tmp_path):
    run_in(tmp_path)
    again = run_in(tmp_path, forced=frozenset({"smooth", "sum"}))
    assert {key[0] for key in again.done} == {"smooth", "sum"}


def test_a_failed_tile_blocks_only_what_needs_it(tmp_path):
    session = run_in(tmp_path, SourceStage(poison=(128, 128)), SmoothStage(), SumStage())
    assert list(session.failures) == [("source", "tile", 1, 1)]
    assert "poisoned" in session.failures["source", "tile", 1, 1]
    assert ("source", "tile", 0, 0) in session.done
    assert ("sum", "total", 0, 0) in session.blocked
    healed = run_in(tmp_path)
    assert not healed.failures and not healed.blocked
    assert healed.store.table(TOTAL).total == pytest.approx(float(pixels(tmp_path).astype(float).sum()))


def test_a_missing_stage_is_named(tmp_path):
    with pytest.raises(WorkflowError, match=r"'sum' needs the raster smooth/numbers.*add the stage 'smooth'"):
        run_in(tmp_path, SourceStage(), SumStage())


def test_a_job_too_large_for_a_worker_is_refused_before_it_runs(tmp_path):
    with pytest.raises(ResourceError, match="smaller 'tile'"):
        run_in(tmp_path, runner=SequentialRunner(100 * 2**20))
    assert not (tmp_path / "runs" / "toy" / "tables").exists()


def test_planning_writes_nothing(tmp_path):
    session = session_in(tmp_path)
    session.plan()
    assert len(session.pending) == 1
    assert session.planner.waiting_for["source"] == "the table source/size.json"
    assert not (tmp_path / "runs").exists()


def look_at_raster(truth: np.ndarray) -> Total:
    return Total(total=0.0)


def look_at_table(truth: Block) -> Total:
    return Total(total=0.0)


def planned_simulation(root: Path) -> Graph:
    """The graph of the simulated project before anything has run; nothing is written."""
    catalogue = load_workflow(Path(__file__).parents[3] / "workflows" / "volos_small.yaml", STAGES)
    session = Session(catalogue.project, catalogue.stages, root, lambda source: ())
    session.plan()
    return session.graph


@pytest.mark.parametrize(
    "region",
    [
        Raster(TRUTH_SURFACE, Window(0, 0, 64, 64)),
        Raster(TRUTH_ORTHO, Window(0, 0, 64, 64)),
        Raster(TRUTH_VISIBILITY, Window(0, 0, 64, 64)),
        TRUTH_BLOCK,
        Table("truth/block.json", Block),
    ],
    ids=str,
)
def test_the_truth_is_for_the_evaluation_only(tmp_path, region):
    graph = planned_simulation(tmp_path)
    for stage in (kind_of(stage) for stage in STAGES):
        job = Job(
            stage=stage,
            item="spy",
            function=look_at_raster if isinstance(region, Raster) else look_at_table,
            reads={"truth": region},
            writes={"total": Table(f"{stage}/spy.json", Total)},
        )
        if stage in ("simulation", "evaluation"):
            assert graph.add(job)
        else:
            with pytest.raises(GraphError, match=f"The stage {stage} may not read truth/"):
                graph.add(job)


class PeepingStage(SumStage):
    """Looks at a table of another stage while it plans."""

    def plan(self, view):
        view.table(PRIVATE)
        yield from super().plan(view)


PRIVATE = Table("source/size.json", Size, readers=("source", "smooth"))


def test_planning_may_not_look_at_what_is_not_for_it(tmp_path, monkeypatch):
    monkeypatch.setattr("toy_stages.SIZE", PRIVATE)
    with pytest.raises(GraphError, match=r"The stage sum may not read source/size\.json; only source, smooth may"):
        run_in(tmp_path, SourceStage(), SmoothStage(), PeepingStage())


@pytest.fixture(scope="module")
def client():
    from orthomill.pipeline.engine.dask_cluster import local_client

    with local_client(2, MEMORY, 8787) as found:
        yield found


def dask_runner(client):
    from orthomill.pipeline.engine.dask_runner import DaskRunner

    return DaskRunner(client, MEMORY, "two processes")


def test_dask_and_sequential_agree_bit_for_bit(tmp_path, client):
    run_in(tmp_path / "one", SourceStage(factor=0.3), SmoothStage(), SumStage())
    run_in(tmp_path / "two", SourceStage(factor=0.3), SmoothStage(), SumStage(), runner=dask_runner(client))
    assert pixels(tmp_path / "one").tobytes() == pixels(tmp_path / "two").tobytes()
    tables = [(tmp_path / which / "runs/toy/tables/sum/total.json").read_bytes() for which in ("one", "two")]
    assert tables[0] == tables[1]


def test_dask_lists_failures_and_blocks_what_depends(tmp_path, client):
    session = run_in(tmp_path, SourceStage(poison=(0, 128)), SmoothStage(), SumStage(), runner=dask_runner(client))
    assert list(session.failures) == [("source", "tile", 0, 1)]
    assert ("sum", "total", 0, 0) in session.blocked and ("source", "tile", 1, 1) in session.done


def test_a_killed_worker_costs_only_a_retry(tmp_path, client):
    lure = tmp_path / "lure"
    lure.touch()
    session = run_in(tmp_path, SourceStage(lure=str(lure)), SmoothStage(), SumStage(), runner=dask_runner(client))
    assert not lure.exists(), "the worker was to die once"
    assert not session.failures and len(session.done) == 11


def test_the_dashboard_listens_on_this_machine_only(client):
    assert client.dashboard_link.startswith("http://127.0.0.1:")
    assert client.scheduler.address.startswith("tls://127.0.0.1:")


SLOW_RUN = """
import sys
from pathlib import Path
from toy_stages import SmoothStage, SourceStage, SumStage, run_in
run_in(Path(sys.argv[1]), SourceStage(rows=500, cols=500, pause=0.05), SmoothStage(), SumStage())
"""


def test_a_run_killed_anywhere_goes_on_and_ends_the_same(tmp_path):
    stages = (SourceStage(rows=500, cols=500, pause=0.05), SmoothStage(), SumStage())
    run_in(tmp_path / "whole", *stages)
    environment = {**os.environ, "PYTHONPATH": f"{Path(__file__).parent}:{os.environ['PYTHONPATH']}"}
    process = subprocess.Popen([sys.executable, "-c", SLOW_RUN, str(tmp_path / "killed")], env=environment)
    records = tmp_path / "killed" / "runs/toy/jobs/source"
    deadline = time.monotonic() + 60
    while sum(log.read_bytes().count(b"\tdone\t") for log in records.glob("*.log")) < 4 and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    resumed = run_in(tmp_path / "killed", *stages)
    assert len(resumed.skipped) >= 4 and len(resumed.done) >= 1
    assert pixels(tmp_path / "killed").tobytes() == pixels(tmp_path / "whole").tobytes()
