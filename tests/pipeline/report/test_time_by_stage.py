"""The table 'where the time goes' adds up what the stages of a run took."""

import pytest

from benchmarks.time_by_stage import page, table, to_surface
from orthomill.pipeline.engine.run_facts import RunFacts, StageRun

STAGES = (
    StageRun("simulation", 2, 2, cpu_seconds=50.0, peak_bytes=2**30),
    StageRun("photos", 4, 4, cpu_seconds=2.0, peak_bytes=2**28),
    StageRun("densification", 4, 4, cpu_seconds=6.0, peak_bytes=2**29),
    StageRun("texture", 4, 4, cpu_seconds=8.0),
    StageRun("evaluation", 1, 1, cpu_seconds=3.0),
)
FACTS = RunFacts("p", "EPSG:2100", "0", "now", stages=STAGES)


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_shares_and_costs_leave_the_truth_of_a_simulation_out():
    rows = {cells(line)[0]: cells(line)[1:] for line in table("p", FACTS, 4.0) if line.startswith("|")}
    assert rows["texture"] == ["8.0", "50 %", "2.00", "0"]
    assert rows["simulation"] == ["50.0", "", "12.50", "1024"]
    assert rows["**photographs to surface**"] == ["8.0", "50 %", "2.00", "512"]
    assert rows["**photographs to products**"] == ["16.0", "100 %", "4.00", "512"]


def test_a_run_that_stopped_before_the_surface_counts_what_it_did():
    unfinished = RunFacts("p", "EPSG:2100", "0", "now", stages=STAGES[:2])
    assert [stage.kind for stage in to_surface(unfinished)] == ["photos"]


def test_a_folder_without_a_run_is_a_sentence(tmp_path):
    with pytest.raises(SystemExit, match="is not the folder of a run"):
        page((tmp_path,))
