"""What `status` tells of the stages of a run, and where the pages of one in progress are."""

from collections.abc import Iterable, Iterator
from datetime import datetime
from pathlib import Path

from rich.markup import escape

from orthomill.pipeline.engine.run_facts import DASHBOARD, TIME_FORMAT, read_facts
from orthomill.pipeline.records.lock import is_running
from orthomill.pipeline.records.records import Record, key_text
from orthomill.schemas.memory import MIB


def begun_at(folder: Path) -> float | None:
    """When the run in progress began, s since 1970; None when there is none."""
    facts = read_facts(folder) if is_running(folder) else None
    return datetime.strptime(facts.started, TIME_FORMAT).timestamp() if facts else None


def status_row(records: Iterable[Record], begun: float | None) -> Iterator[str]:
    """The cells of a stage; with the jobs begun since `begun`, where a run is in progress."""
    done = now = failed = peak = 0
    seconds, last = 0.0, ""
    for record in records:
        done += record.status == "done"
        now += begun is not None and record.started >= begun
        seconds, peak = seconds + record.seconds, max(peak, record.peak_bytes)
        if record.status == "failed":
            failed, last = failed + 1, f"{key_text(record.key)}: {record.error}"
    yield str(done)
    if begun:
        yield str(now)
    yield str(failed)
    yield f"{seconds:.1f}"
    yield f"{peak / MIB:.0f} MiB"
    yield escape(last)


def dashboard_address(folder: Path, held_by: str = DASHBOARD) -> str:
    """The address that a run on Dask keeps while it is in progress; empty where there is none."""
    # The file alone proves nothing: a killed run leaves it behind, but the operating system frees its lock.
    path = folder / held_by
    return path.read_text() if is_running(folder) and path.exists() else ""
