"""What `orthomill plan` prints: what is planned of each stage, exactly, and what the rest will take, as a forecast."""

import os
import shutil
from collections.abc import Callable, Iterator

from rich.table import Table as Lines

from orthomill.pipeline.engine.session import Session
from orthomill.pipeline.forecast.forecast import Amount, Forecast, StageForecast
from orthomill.schemas.memory import MIB
from orthomill.schemas.stage_contract import Stage

UNKNOWN = "?"


def plan_lines(session: Session, expected: Forecast | None) -> Lines:
    """One row for each stage of a planned session: ~ is a forecast, < its bound, numbers alone are exact, ? is not known yet."""
    # One space between columns: with everything that is to be said a row still fits 80 characters.
    lines = Lines(
        "stage", "jobs to run", "MB on disk", "peak MiB", "CPU time", "why", box=None, pad_edge=False, padding=(0, 1, 0, 0)
    )
    for stage in session.stages:
        lines.add_row(stage.kind, *_row(session, stage, expected.stages.get(stage.kind) if expected else None))
    return lines


def _row(session: Session, stage: Stage, expected: StageForecast | None) -> tuple[str, ...]:
    pending = [planned for planned in session.pending if planned.job.stage == stage.kind]
    known = session.graph.jobs.keys_by_number.of_stage(stage.kind)
    waiting = session.planner.waiting_for.get(stage.kind)
    reasons = sorted({session.reasons[planned.key] for planned in pending})
    why = "; ".join(reasons) or ("waits" if waiting else "unchanged")
    if waiting:
        return (*_foreseen(len(pending), expected), why)
    written, memory = sum(planned.output_bytes for planned in pending), max((planned.memory for planned in pending), default=0)
    share = len(pending) / max(len(known), 1)
    seconds = _shown(Amount(share * expected.seconds.about, share * expected.seconds.most), _time) if expected else UNKNOWN
    jobs = f"{len(pending)} of {len(known)}"
    if len(pending) == len(known):
        # How good the forecast was can be seen beside what has become exact.
        jobs = f"{len(known)} (~{expected.jobs.about:.0f})" if expected else str(len(known))
    return jobs, f"<{written / 1e6:.0f}", f"<{memory / MIB:.0f}", seconds if pending else "0 s", why


def _foreseen(pending: int, expected: StageForecast | None) -> tuple[str, ...]:
    """The cells of a stage that is not planned completely: what is planned of it is a lower bound."""
    if expected is None:
        return _at_least(pending), UNKNOWN, UNKNOWN, UNKNOWN
    jobs = f"~{max(expected.jobs.about, pending):.0f}"
    return jobs, _shown(expected.megabytes), _shown(expected.peak_mib), _shown(expected.seconds, _time)


def _at_least(count: int) -> str:
    return f"{count} + {UNKNOWN}" if count else UNKNOWN


def _shown(amount: Amount, text: Callable[[float], str] = "{:.0f}".format) -> str:
    return f"~{text(amount.about)} <{text(amount.most)}"


def _time(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 100 * 60 else f"{seconds / 3600:.1f} h"


def plan_notes(session: Session, expected: Forecast | None) -> Iterator[str]:
    """Sentences below the rows, where some stage cannot be planned completely yet."""
    waiting = [stage.kind for stage in session.stages if stage.kind in session.planner.waiting_for]
    if not waiting:
        return
    yield (
        f"{len(waiting)} of {len(session.stages)} stages wait for results of earlier stages. ~ is a forecast and < its bound; they "
        "become exact during the run: repeat this command then."
    )
    if expected is None:
        yield "The sizes of the photographs are not known yet, so that nothing can be foreseen."
    else:
        yield _totals(session, expected)


def _totals(session: Session, expected: Forecast) -> str:
    workers, free = os.cpu_count() or 1, shutil.disk_usage(session.root).free / 1e6
    disk, seconds = expected.megabytes, expected.seconds
    known = f"{expected.runs} complete runs in this folder" if expected.runs else "four blocks measured on another machine"
    return (
        f"As a whole {expected.megapixels:.0f} megapixels of photographs take about {disk.about:.0f} MB (at most {disk.most:.0f}; "
        f"{free:.0f} are free) and {_time(seconds.about / workers)} (at most {_time(seconds.most / workers)}) on {workers} "
        f"workers, by {known}; kernels are compiled once, for a minute or two. The memory of jobs is checked before they run."
    )
