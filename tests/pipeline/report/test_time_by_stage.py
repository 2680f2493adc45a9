"""The table 'where the time goes' adds up what the stages of a run took, and what whole commands took and delivered."""

import sys
from pathlib import Path

import numpy as np
import pytest
import rasterio

from benchmarks.flight_peer import Delivery, own_delivery, peer_delivery
from benchmarks.measured_run import MeasuredRun, measured_command
from benchmarks.time_by_stage import CommandRun, page, side_by_side, table, to_surface
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
    with pytest.raises(SystemExit, match="neither a finished run nor a shipped project"):
        page((str(tmp_path / "nothing"),))
    (tmp_path / "jobs").mkdir()
    with pytest.raises(SystemExit, match="is not the folder of a run"):
        page((str(tmp_path),))


def test_processor_time_is_that_of_all_processes_of_a_command(tmp_path):
    busy = "import time\nwhile time.process_time() < 0.4: pass"
    twice = f"import subprocess, sys\n{busy}\nsubprocess.run([sys.executable, '-c', {busy!r}])"
    run = measured_command([sys.executable, "-c", twice], tmp_path)
    assert run.code == 0
    assert 0.8 <= run.cpu_seconds < 1.6


def test_commands_stand_beside_each_other_with_what_they_deliver():
    made = Delivery(("dsm.tif", "ortho.tif"), surface=200.0, measured=150.0, surface_cell=0.04, ortho=180.0, ortho_cell=0.02)
    lines = side_by_side((CommandRun("ours", MeasuredRun(10.0, 16.0, 2**30, 0, ""), made),), 4.0)
    row = next(line for line in lines if line.startswith("| ours"))
    assert cells(row) == ["ours", "16.0", "4.00", "10", "1024", "200", "75 %", "0.0400", "180", "0.0200"]
    assert "- products of ours: dsm.tif, ortho.tif" in lines


def write(path: Path, values: np.ndarray, cell: float, **more: object) -> None:
    place = rasterio.Affine(cell, 0, 0, 0, -cell, 0)
    height, width = values.shape
    with rasterio.open(path, "w", "GTiff", width, height, 1, dtype=values.dtype, transform=place, **more) as target:
        target.write(values, 1)


def test_a_delivery_counts_the_ground_that_is_covered_and_what_is_measured_of_it(tmp_path):
    heights = np.array([[1, 2, -9999], [3, np.nan, 5]], np.float32)
    write(tmp_path / "dsm.tif", heights, 0.5, nodata=-9999.0)
    write(tmp_path / "dsm_support.tif", np.array([[1, 2, 1], [1, 1, 0]], np.uint8), 0.5)
    write(tmp_path / "dsm_provenance.tif", np.array([[2, 4, 2], [5, 2, 6]], np.uint8), 0.5)
    for name in ("ortho.tif", "orthophoto.tif"):
        write(tmp_path / name, np.array([[7, 7, 0, 7]], np.uint8), 0.25, nodata=0)
    for delivery in (own_delivery(tmp_path), peer_delivery(tmp_path)):
        assert (delivery.surface, delivery.measured, delivery.ortho) == (4 * 0.25, 2 * 0.25, 3 * 0.0625)
        assert (delivery.surface_cell, delivery.ortho_cell) == (0.5, 0.25)
