"""A run on a cluster that somebody else started: the same results, and one sentence when its scheduler goes away."""

import json
import subprocess
import sys
import time
from threading import Event

import pytest
from distributed import SpecCluster
from distributed.security import Security
from small_site import command, finished_site, make_site, results_of, start_command

pytestmark = pytest.mark.slow


@pytest.fixture
def tls(tmp_path):
    """The words for a certificate of an authority, a certificate and a key, as Dask's programs and the command take them."""
    own, files = Security.temporary(), {name: tmp_path / f"{name}.pem" for name in ("ca", "cert", "key")}
    for path, content in zip(files.values(), (own.tls_ca_file, own.tls_client_cert, own.tls_client_key), strict=True):
        path.write_text(content)
    return [word for name, path in files.items() for word in (f"--tls-{name}", str(path))]


@pytest.fixture
def cluster(tmp_path, tls, request):
    """A scheduler with two workers, as processes of their own; (its process, its address, what the command must be told of it)."""
    file = tmp_path / "scheduler.json"
    common = ["--scheduler-file", str(file), "--no-dashboard"]
    if request.param == "tls":
        common += ["--protocol", "tls", *(word.replace("--tls-ca", "--tls-ca-file") for word in tls)]
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", *common], **silent
    )
    workers = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_worker", "--nworkers", "2", "--nthreads", "1", *common], cwd=tmp_path, **silent
    )
    deadline = time.monotonic() + 60
    while not file.exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    time.sleep(3)
    yield scheduler, json.loads(file.read_text())["address"], tls if request.param == "tls" else []
    for process in (workers, scheduler):
        process.terminate()
        process.wait(timeout=30)


@pytest.mark.parametrize("cluster", ["tcp"], indirect=True)
def test_a_cluster_without_certificates_is_used_and_named(cluster, tmp_path, monkeypatch):
    _, address, _ = cluster
    monkeypatch.chdir(make_site(tmp_path / "there"))
    said = command("run", "site", "--until", "photos", "--scheduler", address)
    assert " 0 failed" in said and "is not encrypted, and whoever reaches that scheduler can run code as you" in said


@pytest.mark.parametrize("cluster", ["tls"], indirect=True)
def test_another_cluster_gives_the_same_and_its_loss_is_one_sentence(cluster, tmp_path):
    scheduler, address, words = cluster
    there = make_site(tmp_path / "there")
    said, errors = (run := start_command(there, "run", "site", "--scheduler", address, *words)).communicate(timeout=120)
    assert run.returncode == 0 and " 0 failed" in said, errors
    assert "not encrypted" not in said
    assert results_of(there) == results_of(finished_site()[0])

    run = start_command(there, "run", "site", "--from", "photos", "--scheduler", address, *words)
    while "dashboard" not in run.stdout.readline():
        assert run.poll() is None
    scheduler.kill()
    _, errors = run.communicate(timeout=120)
    assert run.returncode != 0 and "Traceback" not in errors
    assert f"The Dask scheduler at {address} was lost in the middle of the run; finished jobs are kept" in errors


def test_workers_that_do_not_start_are_one_sentence(tmp_path, monkeypatch):
    def broken(**settings):
        raise RuntimeError("Nanny failed to start.")

    monkeypatch.chdir(make_site(tmp_path))
    monkeypatch.setattr("orthomill.pipeline.engine.dask_cluster.SpecCluster", broken)
    said = command("run", "site", "--workers", "2", code=2)
    assert "The 2 worker processes could not be started (Nanny failed to start.)" in said


def test_workers_that_are_killed_while_they_start_are_started_again(tmp_path, monkeypatch):
    started = []

    def killed_once(**settings):
        started.append(settings)
        if len(started) == 1:
            raise RuntimeError("Nanny failed to start.")
        return SpecCluster(**settings)

    monkeypatch.chdir(make_site(tmp_path))
    monkeypatch.setattr("orthomill.pipeline.engine.dask_cluster.SpecCluster", killed_once)
    assert " 0 failed" in command("run", "site", "--workers", "1", "--until", "photos") and len(started) == 2


def test_workers_that_cannot_load_the_program_are_one_sentence(tmp_path, monkeypatch):
    monkeypatch.chdir(make_site(tmp_path))
    monkeypatch.setattr("orthomill.pipeline.engine.dask_cluster.PROGRAM", ("orthomill.changed_meanwhile:execute",))
    said = command("run", "site", "--workers", "1", code=2)
    assert "cannot load orthomill (ModuleNotFoundError: No module named 'orthomill.changed_meanwhile'); its files may have" in said


def test_a_stop_while_workers_start_is_not_their_failure(tmp_path, monkeypatch):
    def stopped(**settings):
        monkeypatch.setattr("orthomill.pipeline.engine.interruption._STOP_REQUESTED", asked)
        raise RuntimeError("Nanny failed to start.") from TimeoutError()

    asked = Event()
    asked.set()
    monkeypatch.chdir(make_site(tmp_path))
    monkeypatch.setattr("orthomill.pipeline.engine.dask_cluster.SpecCluster", stopped)
    assert "Finished jobs are kept" in command("run", "site", "--workers", "2", code=130)


def test_a_scheduler_that_does_not_answer_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(make_site(tmp_path))
    monkeypatch.setattr("orthomill.pipeline.engine.dask_cluster.ANSWER", "2s")
    said = command("run", "site", "--scheduler", "tcp://127.0.0.1:9", code=2)
    assert "No Dask scheduler answers at tcp://127.0.0.1:9" in said


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        (["--tls-ca", "ca.pem"], "--tls-ca, --tls-cert and --tls-key are given together"),
        (["--tls-ca", "no.pem", "--tls-cert", "no.pem", "--tls-key", "no.pem"], "There is no file no.pem"),
    ],
)
def test_incomplete_certificates_are_answered_before_anything_starts(tmp_path, monkeypatch, words, answer):
    monkeypatch.chdir(make_site(tmp_path))
    assert answer in command("run", "site", "--scheduler", "tls://127.0.0.1:9", *words, code=2)
