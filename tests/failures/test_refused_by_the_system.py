"""What the system refuses (memory, long paths) is a sentence, never a traceback, and nothing is lost."""

import resource
import subprocess
import sys

import pytest
from small_site import command, make_site, photographs, start_command, write_workflow

LONG = "a" * 5000


@pytest.fixture
def site(tmp_path, monkeypatch):
    monkeypatch.chdir(make_site(tmp_path))
    return tmp_path


def limited(site, mib: int, *words: str) -> str:
    """What the command says in a shell with `ulimit -v`."""
    limit = {"preexec_fn": lambda: resource.setrlimit(resource.RLIMIT_AS, (mib * 2**20, mib * 2**20))}
    said, errors = (process := start_command(site, *words, **limit)).communicate(timeout=120)
    assert process.returncode == 2 and said == "" and len(errors.splitlines()) == 1, errors
    return errors


@pytest.mark.parametrize("mib", [600, 1000])
def test_a_shell_in_which_nothing_can_be_loaded_is_named(site, mib):
    said = limited(site, mib, "plan", "site")
    assert f"error: This shell allows a process {mib} MiB of memory (ulimit -v)" in said and "ulimit -v unlimited" in said


@pytest.mark.slow
def test_a_shell_in_which_a_job_would_be_killed_is_named_before_anything_runs(site):
    said = limited(site, 3500, "run", "site", "--workers", "1")
    assert "This shell allows a process 3500 MiB of memory (ulimit -v), but with --memory 1500 it may need 3900 MiB" in said
    assert not list((site / "runs").rglob("jobs/*/*"))


def test_a_job_that_is_refused_memory_says_so(site, monkeypatch):
    def refused(*words, **more):
        raise MemoryError("std::bad_alloc")

    monkeypatch.setattr("orthomill.pipeline.engine.execute.read_pixels", refused)
    said = command("run", "site", "--sequential", "--until", "photos", code=1)
    assert "The system refused more memory; run fewer workers" in said and "unexpected" not in said


@pytest.mark.parametrize(
    "words",
    [
        ("run", LONG),
        ("plan", f"{LONG}.yaml"),
        ("inspect", "window-size", f"{LONG}.jpg"),
        ("calibrate", LONG, "--corners", "5x6", "--square", "0.1"),
        ("init", "other", "--photos", LONG),
    ],
)
def test_a_path_that_is_too_long_is_one_sentence(site, words):
    said = command(*words, code=2)
    assert "characters) is longer than this system allows." in said and len(said) < 300


@pytest.mark.parametrize(
    "change",
    [
        {"photographs": {"kind": "folder", "path": LONG}},
        {"photographs": {"kind": "folder", "path": "a/" * 2500}},
        {"cameras": {"kind": "file", "path": LONG}},
        {"photographs": {"kind": "list", "paths": [f"{LONG}.jpg", "photos/a.jpg"]}},
    ],
)
def test_a_long_path_in_the_workflow_is_named_with_its_line(site, change):
    write_workflow(site, **change)
    said = command("run", "site", code=2)
    assert "workflows/site.yaml:" in said and "characters, longer than any path of this system" in said


@pytest.mark.slow
def test_a_locale_without_letters_shows_codes(site, monkeypatch):
    photo = photographs(site)[0]
    photo.rename(photo.with_stem("α"))
    monkeypatch.setenv("LC_ALL", "C")
    said, errors = (process := start_command(site, "plan", "site")).communicate(timeout=60)
    assert process.returncode == 0 and "Traceback" not in errors, errors
    assert "photos" in said


@pytest.mark.slow
def test_remarks_of_libraries_on_numbers_are_not_shown():
    remark = "import atexit, sys, numpy as np; atexit.register(lambda: np.ones(1) / np.zeros(1))"
    run = "sys.argv = ['orthomill', '--version']; from orthomill.pipeline.cli.environment import main; main()"
    for start, shown in ((f"{remark}; {run}", False), (remark, True)):
        ended = subprocess.run([sys.executable, "-c", start], capture_output=True, text=True, check=True)
        assert ("RuntimeWarning" in ended.stderr) == shown
