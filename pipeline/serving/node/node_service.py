"""What the routes of the node do: uploads become tasks, tasks are told, stopped and begun again, each for its owner."""

import re
import uuid as uuids
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

from orthomill.pipeline.serving.node.access import Access, Token
from orthomill.pipeline.serving.node.request_fields import created_of, options_of, outputs_of, text_of
from orthomill.pipeline.serving.node.streamed_uploads import Receiver
from orthomill.pipeline.serving.node.task_options import TaskOptions
from orthomill.pipeline.serving.queue.object_places import allowed_address, apart
from orthomill.pipeline.serving.queue.task_folder import UUID, TaskFolder
from orthomill.pipeline.serving.queue.task_queue import TaskQueue
from orthomill.pipeline.serving.queue.task_state import GivenOption, TaskState, TaskStatus, now
from orthomill.pipeline.serving.queue.upload_store import UploadStore
from orthomill.schemas.errors import OrthomillError, ResourceError, WorkflowError

_WEB = re.compile(r"https?://[^\s/]+(/\S*)?")


class NotFoundError(OrthomillError):
    """There is no such task, or it is another's: nobody can tell the two apart."""


@dataclass
class NodeService:
    """The node without its web server."""

    queue: TaskQueue
    uploads: UploadStore
    access: Access
    options: TaskOptions
    webhooks: bool = True
    object_store: Callable[[str], str] = lambda address: allowed_address(address, ())
    """checks an address of photographs or results, and gives it back"""
    _committing: set[str] = field(default_factory=set)
    _lock: Lock = field(default_factory=Lock)

    def begin(self, token: Token, fields: dict[str, Any], wanted: str = "") -> TaskState:
        """An upload for a new task. Raises OrthomillError with a sentence for what the task must not have."""
        self._check_quota(token)
        state = self._described(TaskState(uuid=self._new_uuid(wanted), owner=token.name), fields)
        self.uploads.begin(state)
        return state

    def describe(self, token: Token, uuid: str, fields: dict[str, Any]) -> None:
        """Give an upload its fields afterwards: in a request with all in one they may follow the files. Raises OrthomillError."""
        upload, state = self._upload(token, uuid)
        upload.keep(self._described(state, fields))

    def give_up(self, uuid: str) -> None:
        """Forget an upload that failed."""
        if (found := self.uploads.find(uuid)) is not None:
            found[0].remove()
        self.uploads.forget(uuid)

    def _described(self, state: TaskState, fields: dict[str, Any]) -> TaskState:
        options, webhook = options_of(fields), text_of(fields, "webhook")
        self.options.wishes(options)
        if webhook and not self.webhooks:
            raise WorkflowError("This node calls no webhooks; ask for the task's info instead.")
        if webhook and not _WEB.fullmatch(webhook):
            raise WorkflowError(f"webhook {webhook[:60]!r} is no address that begins with http:// or https://.")
        places = {"read_from": self._address(fields, "readS3Path") or self._address(fields, "zipurl")}
        places["write_to"] = self._address(fields, "writeS3Path")
        apart(**places)
        return state.model_copy(
            update={
                "name": text_of(fields, "name", 200) or "Task",
                "options": options,
                "outputs": outputs_of(fields),
                "webhook": webhook,
                "created": created_of(fields, now()),
                **places,
            }
        )

    def _address(self, fields: dict[str, Any], name: str) -> str:
        given = text_of(fields, name)
        return self.object_store(given) if given else ""

    def _new_uuid(self, wanted: str) -> str:
        if not wanted:
            return str(uuids.uuid4())
        uuid = wanted.lower()
        if not UUID.fullmatch(uuid):
            raise WorkflowError(f"Invalid set-uuid: {wanted[:60]!r} is no UUID.")
        if uuid in self.queue.tasks or self.uploads.find(uuid):
            raise WorkflowError(f"Invalid set-uuid: there is a task {uuid} already.")
        return uuid

    def _check_quota(self, token: Token) -> None:
        going_on = sum(state.owner == token.name and not state.status.ended for state in list(self.queue.tasks.values()))
        if token.tasks is not None and going_on >= token.tasks:
            raise ResourceError(
                f"{going_on} of your tasks have not ended, and you may have {token.tasks}; wait for one, or cancel it."
            )
        if self.bytes_left(token) == 0:
            raise ResourceError(f"Your tasks hold the {token.gigabytes:g} GB that you may keep; remove some.")

    def bytes_left(self, token: Token) -> int | None:
        """What the bearer of a token may still keep; None without a quota."""
        if token.gigabytes is None:
            return None
        kept = sum(state.bytes for state in list(self.queue.tasks.values()) if state.owner == token.name)
        return max(int(token.gigabytes * 1e9) - kept - self.uploads.bytes_of(token.name), 0)

    def receiver(self, token: Token, uuid: str) -> Callable[[str], AbstractContextManager[Receiver]]:
        """Keeps files of an upload. Raises NotFoundError."""
        self._upload(token, uuid)
        left = self.bytes_left(token)
        quota = None if left is None else left + self.uploads.size_of(uuid)
        return lambda name: self.uploads.receiving(uuid, name, quota)

    def _upload(self, token: Token, uuid: str) -> tuple[TaskFolder, TaskState]:
        found = self.uploads.find(uuid)
        if found is None or found[1].owner != token.name:
            raise NotFoundError(f"{uuid[:36]} not found: there is no such upload; begin one by /task/new/init.")
        return found

    def commit(self, token: Token, uuid: str) -> str:
        """An upload becomes a task. Repeating it does no harm. Raises OrthomillError."""
        if (task := self.queue.tasks.get(uuid)) is not None and task.owner == token.name:
            return uuid
        upload, state = self._upload(token, uuid)
        with self._lock:
            if uuid in self._committing:
                return uuid
            self._committing.add(uuid)
        try:
            images, unused = (0, []) if state.read_from else self.uploads.sort(upload)
            if token.photographs is not None and images > token.photographs:
                raise ResourceError(f"{images} photographs were uploaded, and a task of yours may have {token.photographs}.")
            wishes = self.options.wishes(state.options)
            wishes = wishes.model_copy(update={"notes": (*wishes.notes, *unused)})
            self.queue.add(upload, state.model_copy(update={"images": images}), wishes)
            self.uploads.forget(uuid)
        finally:
            self._committing.discard(uuid)
        return uuid

    def task(self, token: Token, uuid: str) -> TaskState:
        """A task of the bearer. Raises NotFoundError."""
        state = self.queue.tasks.get(uuid)
        if state is None or state.owner != token.name:
            raise NotFoundError(f"{uuid[:36]} not found")
        return state

    def tasks(self, token: Token) -> list[TaskState]:
        """Tasks of the bearer, the newest first."""
        return sorted((s for s in list(self.queue.tasks.values()) if s.owner == token.name), key=lambda s: (-s.created, s.uuid))

    def told(self, state: TaskState, first: int | None = None) -> dict[str, Any]:
        """A task as the contract tells it; with lines of its output from `first` on."""
        folder = self.queue.of(state.uuid)
        progress = folder.progress()
        status: dict[str, Any] = {"code": int(state.status)} | ({"errorMessage": state.error} if state.error else {})
        share = 1.0 if state.status == TaskStatus.COMPLETED else 0.0 if state.status == TaskStatus.QUEUED else progress.share
        output = {} if first is None else {"output": folder.lines(first)}
        return {
            "uuid": state.uuid,
            "name": state.name,
            "dateCreated": state.created,
            "processingTime": state.processing_time,
            "status": status,
            "options": [option.model_dump() for option in state.options],
            "imagesCount": state.images + (0 if state.status.ended else progress.images),
            "progress": round(100 * share, 2),
            **output,
        }

    def cancel(self, token: Token, uuid: str, fields: dict[str, Any]) -> None:
        """Stop a task. Raises NotFoundError."""
        self.queue.cancel(self.task(token, uuid).uuid)

    def remove(self, token: Token, uuid: str, fields: dict[str, Any]) -> None:
        """Remove a task, and an upload that has not become one. Raises NotFoundError."""
        if uuid not in self.queue.tasks and self._upload(token, uuid):
            self.give_up(uuid)
            return
        self.queue.remove(self.task(token, uuid).uuid)

    def restart(self, token: Token, uuid: str, fields: dict[str, Any]) -> None:
        """Begin a task that has ended again, with the options that are given. Raises OrthomillError."""
        state = self.task(token, uuid)
        self._check_quota(token)
        if not fields.get("options"):
            self.queue.restart(uuid)
            return
        given = options_of(fields)
        wishes = self.options.wishes(given)
        # What happens once is no option of the task.
        kept: tuple[GivenOption, ...] = tuple(option for option in given if option.name != "rerun-from")
        self.queue.restart(state.uuid, kept, wishes)
