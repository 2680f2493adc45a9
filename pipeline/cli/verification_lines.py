"""What `orthomill verify` prints: how much was examined, the first of what is damaged, and what happens next; and what `status`
tells of the stages of a run."""

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

from rich.markup import escape

from orthomill.pipeline.engine.run_facts import read_facts
from orthomill.pipeline.engine.running import DASHBOARD, MIB
from orthomill.pipeline.engine.session import TIME_FORMAT, key_text
from orthomill.pipeline.records.lock import is_running
from orthomill.pipeline.records.records import Record
from orthomill.pipeline.records.verification import Verification

SHOWN = 10


def verification_lines(found: Verification, project: str) -> Iterator[str]:
    """The lines of the terminal."""
    for path, what in sorted(found.damaged.items())[:SHOWN]:
        yield f"{path} is {what}"
    if len(found.damaged) > SHOWN:
        yield f"... and {len(found.damaged) - SHOWN} more"
    if found.mended:
        yield f"written again: {', '.join(found.mended[:SHOWN])}"
    size = f"{found.files} files with {found.size / 2**20:.0f} MiB"
    if found.damaged:
        yield f"{len(found.damaged)} of {size} are lost or damaged; compute them again with: orthomill run {project}"
    else:
        yield f"{size} are whole"


def begun_at(folder: Path) -> float | None:
    """When the run in progress began, s since 1970; None when there is none."""
    facts = read_facts(folder) if is_running(folder) else None
    return datetime.strptime(facts.started, TIME_FORMAT).timestamp() if facts else None


def status_row(records: tuple[Record, ...], begun: float | None) -> Iterator[str]:
    """The cells of a stage; with the jobs begun since `begun`, where a run is in progress."""
    failed = [record for record in records if record.status == "failed"]
    yield str(sum(record.status == "done" for record in records))
    if begun:
        yield str(sum(record.started >= begun for record in records))
    yield str(len(failed))
    yield f"{sum(record.seconds for record in records):.1f}"
    yield f"{max((record.peak_bytes for record in records), default=0) / MIB:.0f} MiB"
    yield escape(f"{key_text(failed[-1].key)}: {failed[-1].error}") if failed else ""


def dashboard_address(folder: Path, held_by: str = DASHBOARD) -> str:
    """The address that a run on Dask keeps while it is in progress; empty where there is none."""
    # The file alone proves nothing: a killed run leaves it behind, but the operating system frees its lock.
    path = folder / held_by
    return path.read_text() if is_running(folder) and path.exists() else ""
