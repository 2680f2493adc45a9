"""One run of a project at a time, and a stop that is never lost."""

import os
import signal
import subprocess
import sys

import pytest

from orthomill.pipeline.engine import interruption
from orthomill.pipeline.engine.interruption import listen, stop_if_asked
from orthomill.pipeline.records.lock import is_running, only_run
from orthomill.schemas.errors import ResourceError


def test_a_second_run_is_refused_with_the_process_of_the_first(tmp_path):
    with (
        only_run(tmp_path / "site"),
        pytest.raises(ResourceError, match=rf"site is already running \(process {os.getpid()}\)"),
        only_run(tmp_path / "site"),
    ):
        pass


def test_the_lock_is_free_again_after_a_run_however_it_ends(tmp_path):
    with pytest.raises(ValueError, match="anything"), only_run(tmp_path):
        raise ValueError("anything")
    with only_run(tmp_path):
        assert is_running(tmp_path)
    assert not is_running(tmp_path)


def test_asking_whether_a_project_runs_writes_nothing(tmp_path):
    assert not is_running(tmp_path / "nowhere")
    assert not (tmp_path / "nowhere").exists()


KILLED = """
import os, signal, sys
from pathlib import Path
from orthomill.pipeline.records.lock import only_run
with only_run(Path(sys.argv[1])):
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_process_leaves_no_lock(tmp_path):
    ended = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)])
    assert ended.returncode == -signal.SIGKILL and (tmp_path / ".lock").exists()
    assert not is_running(tmp_path)
    with only_run(tmp_path):
        assert (tmp_path / ".lock").read_text() == str(os.getpid())


def test_a_folder_that_cannot_be_made_is_a_sentence(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(ResourceError, match="cannot be written"), only_run(tmp_path / "file" / "site"):
        pass


@pytest.fixture
def listening(monkeypatch):
    """Signals are handled as in the command; afterwards as before."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    listen()
    yield
    interruption._STOP_REQUESTED.clear()
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_interrupts_at_once_and_is_remembered(listening, number):
    stop_if_asked()
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), number)
        stop_if_asked()  # Python runs the handler between two instructions, at the latest here
    with pytest.raises(KeyboardInterrupt):
        stop_if_asked()
