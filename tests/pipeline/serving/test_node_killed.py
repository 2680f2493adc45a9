"""A node that is killed loses nothing that it acknowledged, and one that lives takes what is larger than its memory."""

import errno
import json
import os
import signal
import time
from pathlib import Path

import anyio
import pytest

from benchmarks.serving.killed_node import begun, killed, memory, upload_streamed
from benchmarks.serving.running_node import node, photographs
from benchmarks.serving.standin_node import ENGINE
from orthomill.pipeline.serving.node.node_routes import told
from orthomill.pipeline.serving.queue.task_folder import TaskFolder
from orthomill.pipeline.serving.queue.task_process import TaskOrder, _run_words, process_task
from orthomill.pipeline.serving.queue.task_queue import QueueRules, TaskQueue
from orthomill.pipeline.serving.queue.task_state import TaskState, TaskStatus, now
from orthomill.pipeline.serving.queue.upload_store import Receipt, UploadLimits, UploadStore
from orthomill.pipeline.serving.queue.wishes import Wishes
from orthomill.schemas.errors import ResourceError


def test_kills_at_random_moments_lose_nothing(tmp_path):
    found = killed(tmp_path / "home", kills=3, tasks=4)
    assert len(found.committed) == 4 and found.unfinished == [] and found.lost_files == 0
    assert found.repeated > 0  # the kills were noticed by somebody


def test_uploads_stream_and_the_process_of_a_task_survives_its_server(tmp_path):
    home = tmp_path / "home"
    with node(home, STANDIN_STEPS="60", STANDIN_PAUSE="0.05") as running:
        before = memory(running)
        assert upload_streamed(running, begun(running), "large.tif", 96) == {"success": True}
        assert memory(running) - before < 30
        task = running.client().create_task(photographs(tmp_path), {})
        until = time.monotonic() + 30
        while not (owner := _owner(home / "tasks" / task.uuid)) and time.monotonic() < until:
            time.sleep(0.02)
    with node(home) as again:
        assert _owner(home / "tasks" / task.uuid) == owner  # the same process goes on
        found = again.client().get_task(task.uuid)
        found.wait_for_completion(interval=0.1)
        assert "Continued after" not in (home / "tasks" / task.uuid / "output.txt").read_text()
        # One that is killed itself is begun again, and goes on.
        other = again.client().create_task(photographs(tmp_path), {})
        while not _owner(home / "tasks" / other.uuid):
            time.sleep(0.02)
        os.killpg(_owner(home / "tasks" / other.uuid), signal.SIGKILL)
        other.wait_for_completion(interval=0.1)
        assert "Continued after an interruption (attempt 2)" in (home / "tasks" / other.uuid / "output.txt").read_text()


def _owner(task: Path) -> int:
    """The process of a task, 0 before there is one."""
    try:
        return int((task / ".lock").read_text() or 0)
    except FileNotFoundError:
        return 0


def upload(queue: TaskQueue, name: str, owner: str = "user", **more) -> str:
    folder = TaskFolder(queue.home / "uploads" / name)
    folder.images.mkdir(parents=True)
    state = TaskState(uuid=name, owner=owner, created=now(), **more)
    return queue.add(folder, state, Wishes()).uuid


@pytest.fixture
def queue(tmp_path):
    """A queue whose processes end at once without a result."""
    (tmp_path / "tasks").mkdir()
    found = TaskQueue(tmp_path, QueueRules(reserve=0, memory=1))
    found._start = lambda uuid: started.append(uuid)  # type: ignore[method-assign]
    started: list[str] = []
    return found, started


def names(count: int) -> list[str]:
    return [f"{number:08d}-0000-4000-8000-000000000000" for number in range(count)]


def test_one_after_the_other_and_nobody_waits_for_anothers_hundred(queue):
    found, started = queue
    first, second, third = names(3)
    upload(found, first, "ana")
    upload(found, second, "ana")
    upload(found, third, "ben")
    found.look()
    assert started == [first] and found.tasks[first].status == TaskStatus.RUNNING
    found.rules = QueueRules(parallel=2, reserve=0, memory=1)
    found._alive = lambda uuid: True
    found.look()
    assert started == [first, third]


def test_a_process_that_is_ended_three_times_by_others_ends_the_task_with_a_sentence(queue):
    found, _ = queue
    (name,) = names(1)
    upload(found, name)
    for _ in range(8):
        found.look()
        if found.tasks[name].status == TaskStatus.RUNNING:
            found._children[name] = type("Gone", (), {"poll": lambda self: -9})()
    assert found.tasks[name].status == TaskStatus.FAILED and "want of memory" in found.tasks[name].error
    assert found.tasks[name].attempts == 3


def test_a_restart_of_the_machine_is_no_fault_of_the_task(queue):
    found, started = queue
    (name,) = names(1)
    upload(found, name)
    for _ in range(10):
        found.look()
    assert found.tasks[name].status == TaskStatus.RUNNING and found.tasks[name].losses == 0 and len(started) >= 5


def test_a_full_disk_is_a_sentence_and_tasks_wait(queue):
    found, started = queue
    (name,) = names(1)
    upload(found, name)
    found.rules = QueueRules(reserve=2**60)
    found.look()
    assert "of the disk are free" in found.trouble and started == [] and found.tasks[name].status == TaskStatus.QUEUED


def test_a_stage_that_a_restart_began_at_is_begun_again_once(queue):
    found, _ = queue
    (name,) = names(1)
    upload(found, name)
    found.cancel(name)
    found.look()
    found.restart(name, (), Wishes(rerun_from="texture", dem_cell=0.5))
    order, wishes = TaskOrder(folder=found.of(name).path), found.of(name).wishes()
    assert _run_words(order, wishes)[-2:] == ["--from", "texture"] and "--from" not in _run_words(order, wishes, begun=True)
    found.cancel(name)
    found.look()
    found.restart(name)
    assert found.of(name).wishes() == Wishes(dem_cell=0.5)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device here that is always full")
def test_a_disk_that_fills_while_a_file_comes_refuses_it_with_a_sentence(tmp_path):
    with open("/dev/full", "wb", buffering=0) as stream, pytest.raises(ResourceError, match=r"a\.jpg cannot be kept: No space"):
        Receipt(stream, "a.jpg", {}, 10**9, UploadStore(tmp_path, UploadLimits(reserve=0))).write(b"x")

    async def refused(request):
        raise OSError(errno.ENOSPC, "No space left on device")

    answer = anyio.run(told(refused), None)
    assert answer.status_code == 200 and b"refuses it (No space left on device)" in answer.body


def test_an_error_is_told_once(tmp_path):
    folder = TaskFolder(tmp_path)
    folder.images.mkdir()
    (folder.images / "a.jpg").touch()
    process_task(TaskOrder(folder=tmp_path, engine=ENGINE))
    end = folder.end()
    assert end is not None and folder.lines() == [f"error: {end.error}"] == ["error: There are no two photographs in images."]


def test_old_tasks_go_by_the_rule_and_others_stay(queue):
    found, _ = queue
    old, recent, waiting = names(3)
    for name in (old, recent, waiting):
        upload(found, name)
    day = 86_400_000
    found._change(old, status=TaskStatus.COMPLETED, ended=now() - 31 * day)
    found._change(recent, status=TaskStatus.FAILED, ended=now() - 29 * day)
    found.tidy()
    assert found.tasks.keys() == {recent, waiting} and not found.of(old).path.exists()


def test_what_another_server_left_is_found(queue):
    found, _ = queue
    kept, broken = names(2)
    upload(found, kept)
    upload(found, broken)
    (found.of(broken).path / "task.json").write_text("{")
    again = TaskQueue(found.home, found.rules)
    assert again.tasks.keys() == {kept} and again.tasks[kept] == found.tasks[kept]


def test_a_webhook_is_told_once_and_remembered_until_then(queue):
    found, _ = queue
    (name,) = names(1)
    told = []
    found.notify = told.append
    upload(found, name, webhook="http://127.0.0.1:9/x")
    found.cancel(name)
    found.look()
    assert [state.uuid for state in told] == [name]
    found.told(name)
    found.look()
    assert len(told) == 1 and json.loads((found.of(name).path / "task.json").read_text())["told"]
