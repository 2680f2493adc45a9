"""Interrupted runs, by the user or by the machine: what is done is kept, and the results are the same bit for bit."""

import os
import resource
import signal
import time
from pathlib import Path

import psutil
import pytest
from small_site import command, finished_site, jobs_done, make_site, results_of, start_command, write_workflow

pytestmark = pytest.mark.slow


@pytest.fixture
def site(tmp_path, monkeypatch):
    monkeypatch.chdir(make_site(tmp_path))
    # Up to the last stage of many jobs: every run here loads what its stages need.
    write_workflow(tmp_path, stages=["photos", "calibration", "tie_points"])
    return tmp_path


@pytest.fixture(scope="module")
def undisturbed():
    """The results of a run without interruption, one job after another."""
    return {name: held for name, held in results_of(finished_site()[0]).items() if "orientation" not in name.split("/")}


def started(site: Path, workers: int, jobs: int = 3):
    """A run that has done some jobs already and has many still to do."""
    process = start_command(site, "run", "site", "--workers", str(workers))
    deadline = time.monotonic() + 120
    while jobs_done(site) < jobs and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    assert process.poll() is None, process.communicate()
    return process


def workers_of(process) -> list[psutil.Process]:
    return [child for child in psutil.Process(process.pid).children(recursive=True) if "spawn_main" in " ".join(child.cmdline())]


def assert_goes_on_to(undisturbed: dict[str, bytes], site: Path) -> None:
    kept = jobs_done(site)
    assert kept
    assert f" {kept} unchanged, 0 failed" in command("run", "site", "--sequential")
    assert results_of(site) == undisturbed


def assert_stopped_in_one_sentence(process) -> None:
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors.endswith("Stopped. Finished jobs are kept; run the same command again to continue.\n")
    assert "Traceback" not in errors and "leaked" not in errors


def test_a_stopped_run_says_so_in_one_sentence(site):
    process = started(site, 1)
    process.terminate()
    assert_stopped_in_one_sentence(process)
    assert jobs_done(site)


def test_a_run_stopped_by_ctrl_c_goes_on(site, undisturbed):
    process = started(site, 2)
    os.killpg(process.pid, signal.SIGINT)  # a terminal sends Ctrl-C to all processes, not only to the first
    assert_stopped_in_one_sentence(process)
    assert "not running" in command("status", "site")
    assert "report.html" in command("report", "site")
    assert_goes_on_to(undisturbed, site)


def test_ctrl_c_while_libraries_are_loaded_is_one_sentence(site):
    process = start_command(site, "run", "site")
    deadline = time.monotonic() + 60
    while "_multiarray" not in Path(f"/proc/{process.pid}/maps").read_text() and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    said, errors = process.communicate(timeout=60)
    assert (process.returncode, said, errors) == (130, "", "Stopped before anything was done.\n")


def test_a_killed_run_leaves_no_process_and_goes_on(site, undisturbed):
    process = started(site, 1)
    workers = workers_of(process)
    assert workers
    process.kill()
    process.communicate(timeout=60)
    _, alive = psutil.wait_procs(workers, timeout=60)
    assert not alive
    assert "not running" in command("status", "site") and "is not running" in command("dashboard", "site")
    assert_goes_on_to(undisturbed, site)


def test_a_killed_worker_costs_nothing_but_time(site, undisturbed):
    process = started(site, 2)
    workers_of(process)[0].kill()
    said, errors = process.communicate(timeout=180)
    assert process.returncode == 0 and " 0 failed" in said, errors
    assert results_of(site) == undisturbed


def test_a_disk_that_fills_up_during_a_run_is_reported_and_nothing_is_lost(site, undisturbed):
    limit = {"preexec_fn": lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))}
    said, errors = (process := start_command(site, "run", "site", "--sequential", **limit)).communicate(timeout=120)
    assert process.returncode == 1 and "Traceback" not in errors + said
    assert "cannot be written: File too large; make room on the disk, then run again." in errors
    assert_goes_on_to(undisturbed, site)
