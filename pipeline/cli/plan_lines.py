"""What `orthomill plan` prints: what is known of each stage, what is not known yet, and an estimate from the photographs alone."""

from collections.abc import Iterator

from rich.table import Table as Lines

from orthomill.pipeline.engine.running import MIB
from orthomill.pipeline.engine.session import Session
from orthomill.pipeline.storage.image_files import read_header
from orthomill.schemas.errors import OrthomillError
from orthomill.schemas.stage_contract import Stage

UNKNOWN = "?"


def plan_lines(session: Session) -> Lines:
    """One row for each stage of a planned session; a question mark means that it cannot be known yet."""
    lines = Lines("stage", "jobs", "to run", "written", "peak memory", "why", box=None)
    for stage in session.stages:
        lines.add_row(stage.kind, *_row(session, stage))
    return lines


def _row(session: Session, stage: Stage) -> tuple[str, ...]:
    pending = [planned for planned in session.pending if planned.job.stage == stage.kind]
    known = [planned for key, planned in session.graph.jobs.items() if key[0] == stage.kind]
    waiting = session.planner.waiting_for.get(stage.kind)
    reasons = sorted({session.reasons[planned.key] for planned in pending})
    why = "; ".join(reasons + ([f"the rest is planned when {waiting} exists"] if waiting else [])) or "unchanged"
    written, memory = sum(planned.output_bytes for planned in pending), max((planned.memory for planned in pending), default=0)
    sizes = f"{written / MIB:.0f} MiB", f"{memory / MIB:.0f} MiB"
    # The known jobs of a stage that waits are a lower bound; the sizes of a stage without any are unknown, not zero.
    if not waiting:
        return (str(len(known)), str(len(pending)), *sizes, why)
    return (*(_at_least(len(part)) for part in (known, pending)), *(sizes if pending else (UNKNOWN, UNKNOWN)), why)


def _at_least(count: int) -> str:
    return f"{count} + {UNKNOWN}" if count else UNKNOWN


def plan_notes(session: Session) -> Iterator[str]:
    """Sentences below the rows, where some stage cannot be planned completely yet."""
    waiting = [stage.kind for stage in session.stages if stage.kind in session.planner.waiting_for]
    if not waiting:
        return
    yield (
        f"{len(waiting)} of {len(session.stages)} stages wait for results of earlier stages; what is not known yet is "
        f"marked {UNKNOWN}. They are planned during the run; repeat this command then to see more."
    )
    if estimate := _estimate(session):
        yield estimate


def _estimate(session: Session) -> str:
    """An estimate from the photographs alone; empty for simulated ones."""
    source, tile = session.project.photographs, session.project.tile
    if source.kind == "simulated":
        return ""
    try:
        headers = [read_header(session.root / path) for path in session.list_images(source)]
    except OrthomillError as error:
        return str(error)
    tiles = sum(-(-header.width // tile) * -(-header.height // tile) for header in headers)
    pixels = sum(header.width * header.height for header in headers)
    return (
        f"Estimate from the files alone: {len(headers)} photographs with {pixels / 1e6:.0f} million pixels are {tiles} tiles "
        f"of {tile} px; a stage that processes every photograph once has about as many jobs."
    )
