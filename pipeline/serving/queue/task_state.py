"""What is kept of a task: who gave it, what was asked for, how it stands."""

import time
from enum import IntEnum
from typing import Any

from pydantic import BaseModel, ConfigDict


class TaskStatus(IntEnum):
    """Codes of the NodeODM contract."""

    QUEUED = 10
    RUNNING = 20
    FAILED = 30
    COMPLETED = 40
    CANCELED = 50

    @property
    def ended(self) -> bool:
        return self in (TaskStatus.FAILED, TaskStatus.COMPLETED, TaskStatus.CANCELED)


class GivenOption(BaseModel):
    """An option as the client sent it."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    name: str
    value: Any = None


class TaskState(BaseModel):
    """One task. Times are milliseconds since 1970, -1 for what has not happened."""

    model_config = ConfigDict(frozen=True)

    uuid: str
    name: str = "Task"
    owner: str = ""
    """name of the token that it was given with"""
    options: tuple[GivenOption, ...] = ()
    outputs: tuple[str, ...] = ()
    """paths below the results that are wanted; empty: all"""
    webhook: str = ""
    read_from: str = ""
    """prefix of an object store that the photographs are read from"""
    write_to: str = ""
    """prefix of an object store that the results are written to"""
    created: int = 0
    status: TaskStatus = TaskStatus.QUEUED
    images: int = 0
    begun: int = -1
    ended: int = -1
    queued: int = 0
    attempts: int = 0
    """how often a process of it was started"""
    losses: int = 0
    """how often one was ended by others while the server watched"""
    bytes: int = 0
    """what its folder holds, counted when it was given and when it ended"""
    error: str = ""
    told: bool = True
    """whether the webhook has been told of the present end"""

    @property
    def processing_time(self) -> int:
        """Milliseconds since it began, or that it took; -1 before."""
        if self.begun < 0:
            return -1
        return max((self.ended if self.ended >= 0 else now()) - self.begun, 0)


def now() -> int:
    """Milliseconds since 1970."""
    return int(1000 * time.time())


class TaskProgress(BaseModel):
    """How far a task is, as its process last said."""

    model_config = ConfigDict(frozen=True)

    share: float = 0.0
    left_seconds: float | None = None
    stage: str = ""
    images: int = 0
    """photographs that were found in archives"""


class TaskEnd(BaseModel):
    """How a task ended, as its process wrote it down: without an error it has results."""

    model_config = ConfigDict(frozen=True)

    error: str = ""
    verdict: str = ""
