"""The process of one task: the ordinary commands `init` and `run` in the task's folder, and what clients download.

It outlives the server that started it, and whoever is started later finds its lock, its lines and its end in the folder. When it is
killed, the next one goes on where the run stopped. It is started as `python -m orthomill.pipeline.serving.queue.task_process`.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from pydantic import BaseModel

from orthomill.pipeline.records.lock import is_running, only_run
from orthomill.pipeline.serving.outputs.delivery_archive import write_delivery
from orthomill.pipeline.serving.queue.object_places import task_rules
from orthomill.pipeline.serving.queue.run_output import RunOutput
from orthomill.pipeline.serving.queue.safe_archives import ArchiveLimits, unpacked
from orthomill.pipeline.serving.queue.task_folder import PROJECT, TaskFolder
from orthomill.pipeline.serving.queue.task_state import TaskEnd, TaskState
from orthomill.pipeline.serving.queue.upload_names import is_archive, is_image
from orthomill.pipeline.serving.queue.wishes import Wishes, write_wished_workflow
from orthomill.pipeline.storage.depots.fetched_photographs import fetched_photographs
from orthomill.schemas.errors import OrthomillError, ResourceError, WorkflowError
from orthomill.schemas.memory import GIB

ENGINE = (sys.executable, "-c", "from orthomill.pipeline.cli.environment import main; main()")
_PATIENCE = 30.0
"""seconds that a run of an earlier process of the task gets to end"""
STOPPED = 130
"""exit code of a command that was asked to stop"""


class TaskOrder(BaseModel):
    """What the server orders."""

    folder: Path
    engine: tuple[str, ...] = ENGINE
    processes: int = 0
    memory: int = 1500
    most_files: int = 100_000
    most_file_bytes: int = 4 * GIB
    most_bytes: int = 500 * GIB
    reserve: int = 2 * GIB
    paper: bool = False
    scheduler: str = ""
    """address of a Dask scheduler whose workers see the folder; "": processes of this machine"""


class _Stopped(Exception):
    """Somebody ended the command: the task has not ended."""


def process_task(order: TaskOrder) -> None:
    """Do a task to its end, which is in its folder then. Raises ResourceError where another process does it already."""
    folder = TaskFolder(order.folder)
    with only_run(folder.path):
        if folder.end() is not None:
            return
        try:
            end = _done(folder, order)
        except _Stopped:
            return
        except OrthomillError as error:
            end = TaskEnd(error=str(error))
        except OSError as error:
            end = TaskEnd(error=f"{error.filename or 'The disk'}: {error.strerror}; the task can be restarted when that is mended.")
        # A command that failed has told its error already.
        if end.error and folder.lines(-1) != [said := f"error: {end.error}"]:
            folder.say(said)
        folder.tell_end(end)


def _done(folder: TaskFolder, order: TaskOrder) -> TaskEnd:
    state = folder.state() or TaskState(uuid=folder.uuid)
    wishes = folder.wishes()
    _end_orphan(folder)
    folder.say(*([f"Continued after an interruption (attempt {state.attempts})."] if state.attempts > 1 else wishes.notes))
    limits = ArchiveLimits(order.most_files, order.most_file_bytes, order.most_bytes, reserve=order.reserve)
    if state.read_from:
        found = fetched_photographs(state.read_from, folder.images, task_rules(state.read_from, state.write_to, limits))
        count = sum(map(is_image, found.files))
        folder.say(f"{state.read_from}: {count} photographs, {found.left} other objects left out.")
        folder.tell_progress(folder.progress().model_copy(update={"images": count}))
    _unpack(folder, limits)
    start, workflow = (folder.path / "workflows" / f"{name}.yaml" for name in ("start", PROJECT))
    if not start.exists():
        workflow.unlink(missing_ok=True)
        crs = wishes.settings.get("crs")
        _command(order, folder, ["init", PROJECT, "--photos", folder.images.name, *(["--crs", str(crs)] if crs else [])])
        workflow.rename(start)
    folder.say(*write_wished_workflow(start, workflow, wishes))
    output = RunOutput(folder.progress())
    _command(order, folder, _run_words(order, wishes, begun=output.progress.share > 0), output)
    folder.say("Files are written for the client.")
    lines = write_delivery(
        folder, state, wishes, lambda words: _command(order, folder, words, quiet=True), output.verdict, order.paper
    )
    folder.say(*lines)
    folder.tell_progress(output.progress.model_copy(update={"share": 1.0, "left_seconds": 0.0, "stage": ""}))
    return TaskEnd(verdict=output.verdict)


def _unpack(folder: TaskFolder, limits: ArchiveLimits) -> None:
    """Archives of the upload become photographs; each goes when it is unpacked."""
    for archive in sorted(path for path in folder.images.iterdir() if is_archive(path.name)):
        count, told = unpacked(archive, folder.images, limits)
        folder.say(f"{archive.name}: {count} photographs.", *told)
        progress = folder.progress()
        folder.tell_progress(progress.model_copy(update={"images": progress.images + count}))
        archive.unlink()


def _run_words(order: TaskOrder, wishes: Wishes, begun: bool = False) -> list[str]:
    """`begun`: an earlier attempt has begun again where it was wished, and this one goes on."""
    again = ["--from", wishes.rerun_from] if wishes.rerun_from and not begun else []
    if order.scheduler:
        return ["run", PROJECT, "--json", "--scheduler", order.scheduler, *again]
    processes = min(wishes.processes or order.processes, order.processes or wishes.processes)
    return ["run", PROJECT, "--json", "--workers", str(processes), "--memory", str(order.memory), *again]


def _command(order: TaskOrder, folder: TaskFolder, words: list[str], output: RunOutput | None = None, quiet: bool = False) -> None:
    """Run a command of the engine, and say what it says unless `quiet`. Raises WorkflowError with its sentence where it fails."""
    output = output or RunOutput(folder.progress())
    before = output.progress
    with subprocess.Popen(
        [*order.engine, *words],
        cwd=folder.path,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        encoding="utf-8",
        errors="backslashreplace",
    ) as child:
        assert child.stdout is not None
        for line in child.stdout:
            if (lines := output.take(line)) and not quiet:
                folder.say(*lines)
            if output.progress != before:
                before = output.progress
                folder.tell_progress(before)
    if output.traced:
        sys.stderr.write("\n".join(output.traced) + "\n")
    if child.returncode == STOPPED or child.returncode < 0:
        raise _Stopped
    if child.returncode:
        raise WorkflowError(output.error or f"orthomill {words[0]} ended with code {child.returncode}; the output says more.")


def _end_orphan(folder: TaskFolder) -> None:
    """End a run whose task's process was killed: nobody hears it."""
    if not is_running(folder.run):
        return
    for number in (signal.SIGTERM, signal.SIGKILL):
        owner = (folder.run / ".lock").read_text().strip()
        if owner.isdecimal():
            with suppress(ProcessLookupError):
                os.kill(int(owner), number)
        if _comes_true(lambda: not is_running(folder.run), _PATIENCE):
            return
    raise ResourceError("An earlier run of this task does not end; restart the machine, or end its process by hand.")


def _comes_true(question: Callable[[], bool], seconds: float) -> bool:
    until = time.monotonic() + seconds
    while not question():
        if time.monotonic() > until:
            return False
        time.sleep(0.05)
    return True


def main() -> None:
    """Entry point: the order is the only argument, as JSON."""
    order = TaskOrder.model_validate_json(sys.argv[1])
    try:
        process_task(order)
    except OrthomillError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(2)


if __name__ == "__main__":
    main()
