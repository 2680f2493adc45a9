"""A stage whose jobs wait for a gate to be opened, so that a test knows what happens while they are under way."""

import os
import time
from pathlib import Path
from typing import ClassVar, Literal

from pydantic import BaseModel

from orthomill.schemas.job import Job, Table
from orthomill.schemas.stage_contract import Stage

PATIENCE = 200.0
"""seconds for which a gate is waited for"""


class Passed(BaseModel):
    process: int


def pass_gate(gate: str) -> Passed:
    deadline = time.monotonic() + PATIENCE
    while gate and not Path(gate).exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    return Passed(process=os.getpid())


class HeldStage(Stage):
    """Its first jobs need not wait."""

    title: ClassVar[str] = "waiting"
    kind: Literal["held"] = "held"
    gate: str
    free: int = 2
    count: int = 6

    def plan(self, view):
        for number in range(self.count):
            gate = self.gate if number >= self.free else ""
            writes = {"passed": Table(f"held/{number}.json", Passed)}
            yield Job(stage="held", item="job", row=number, function=pass_gate, reads={}, writes=writes, params={"gate": gate})
