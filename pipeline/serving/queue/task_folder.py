"""The folder of one task. Each of its files has one writer, and is written whole: a kill leaves the old one or the new one.

task.json       the state, written by the server
wishes.json     what the options ask for, written by the server
images/         the photographs, and the lists beside them (gcp_list.txt, geo.txt)
unused/         files of the upload that orthomill has no use for
workflows/, runs/task/   the project, written by the ordinary commands
output.txt, progress.json, end.json   what the process of the task tells
all.zip         the results
.lock           held by the process of the task
"""

import re
import shutil
from pathlib import Path

from pydantic import ValidationError

from orthomill.pipeline.serving.queue.task_state import TaskEnd, TaskProgress, TaskState
from orthomill.pipeline.serving.queue.wishes import Wishes
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.errors import StoreError

UUID = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")
PROJECT = "task"
"""name of the project in each folder"""
MOST_LINES = 5000
"""of the output of a task that one answer holds"""


class TaskFolder:
    """Paths and files of a task."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.images, self.unused = path / "images", path / "unused"
        self.results, self.output_file = path / "all.zip", path / "output.txt"
        self.run = path / "runs" / PROJECT

    @property
    def uuid(self) -> str:
        return self.path.name

    def state(self) -> TaskState | None:
        """The state, None where there is none that can be read."""
        try:
            return TaskState.model_validate_json((self.path / "task.json").read_bytes())
        except (OSError, ValidationError):
            return None

    def keep(self, state: TaskState) -> None:
        """Write the state. Raises StoreError."""
        write_whole(self.path / "task.json", state.model_dump_json(indent=1).encode())

    def wishes(self) -> Wishes:
        """What the options of the task ask for."""
        path = self.path / "wishes.json"
        return Wishes.model_validate_json(path.read_bytes()) if path.exists() else Wishes()

    def keep_wishes(self, wishes: Wishes) -> None:
        """Write what the options ask for. Raises StoreError."""
        write_whole(self.path / "wishes.json", wishes.model_dump_json(indent=1).encode())

    def progress(self) -> TaskProgress:
        """How far the task is."""
        try:
            return TaskProgress.model_validate_json((self.path / "progress.json").read_bytes())
        except (OSError, ValidationError):
            return TaskProgress()

    def tell_progress(self, progress: TaskProgress) -> None:
        """Write how far the task is. Raises StoreError."""
        write_whole(self.path / "progress.json", progress.model_dump_json().encode())

    def end(self) -> TaskEnd | None:
        """How the task ended; None while it has not."""
        try:
            return TaskEnd.model_validate_json((self.path / "end.json").read_bytes())
        except (OSError, ValidationError):
            return None

    def tell_end(self, end: TaskEnd) -> None:
        """Write how the task ended. Raises StoreError."""
        write_whole(self.path / "end.json", end.model_dump_json().encode())

    def begin_again(self) -> None:
        """Forget what the last attempt told; what it computed is kept."""
        for name in ("end.json", "progress.json", "output.txt", "all.zip"):
            (self.path / name).unlink(missing_ok=True)

    def lines(self, first: int = 0) -> list[str]:
        """Lines of the output from `first` on; a negative one counts from the end."""
        try:
            text = self.output_file.read_text(encoding="utf-8", errors="replace")
        except OSError:
            return []
        # The last line may be in the making.
        return text.split("\n")[:-1][first:][:MOST_LINES]

    def say(self, *lines: str) -> None:
        """Add lines to the output. Raises StoreError."""
        try:
            with open(self.output_file, "a", encoding="utf-8", errors="backslashreplace") as file:
                file.write("".join(f"{' '.join(line.splitlines())}\n" for line in lines))
        except OSError as error:
            raise StoreError(f"{self.output_file} cannot be written: {error.strerror}.") from error

    def bytes_used(self) -> int:
        """What the folder holds on the disk."""
        return sum(path.stat().st_size for path in self.path.rglob("*") if path.is_file() and not path.is_symlink())

    def remove(self) -> None:
        """Remove the folder with everything in it. It loses its name first: half of a task is none."""
        gone = self.path.with_name(f".gone-{self.path.name}")
        try:
            self.path.rename(gone)
        except FileNotFoundError:
            return
        except OSError:
            gone = self.path
        shutil.rmtree(gone, ignore_errors=True)
