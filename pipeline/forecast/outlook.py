"""What `init` expects of a project: of its block, as the catalogue tells it, and of the machine: hours, memory and disk."""

import os
from pathlib import Path

from orthomill.pipeline.forecast.forecast import Forecast, block_forecast
from orthomill.pipeline.forecast.rates import rates_here
from orthomill.pipeline.workflow.starting_workflow import Look
from orthomill.pipeline.workflow.workflow_checks import kind_of
from orthomill.schemas.findings.flight_findings import FirstLook, PositionsBeside
from orthomill.schemas.photo import Header
from orthomill.schemas.project import Project
from orthomill.schemas.stage_contract import Stage


def outlook(look_ahead: Look, stages: tuple[type[Stage], ...], root: Path) -> Look:
    """The look at photographs that tells, besides, what a run on this machine takes."""

    def look(headers: tuple[Header, ...], crs: str | None, beside: PositionsBeside | None) -> FirstLook:
        seen = look_ahead(headers, crs, beside)
        used = set(seen.used)
        megapixels = sum(header.width * header.height for header in headers if header.path in used) / 1e6
        kinds = [kind_of(stage) for stage in stages if stage.for_own_photographs]
        tile = Project.model_fields["tile"].default
        # No run of this project exists yet, so that no folder has to be left out.
        effort = effort_sentence(block_forecast(kinds, megapixels, tile, rates_here(root / "runs", but=root)))
        return seen.model_copy(update={"expected": seen.expected.model_copy(update={"effort": effort})})

    return look


def effort_sentence(expected: Forecast) -> str:
    """Time, memory and disk of a run of all stages."""
    workers = os.cpu_count() or 1
    peak = max(stage.peak_mib.most for stage in expected.stages.values())
    known = f"{expected.runs} complete runs in this folder" if expected.runs else "blocks measured on another machine"
    return (
        f"A run takes about {_time(expected.seconds.about / workers)} (at most {_time(expected.seconds.most / workers)}) on "
        f"{workers} workers of up to {peak / 1024:.1f} GB, and {_gigabytes(expected.megabytes.about)} of disk; by {known}, for "
        f"{expected.megapixels:{'.1f' if expected.megapixels < 10 else '.0f'}} megapixels."
    )


def _gigabytes(megabytes: float) -> str:
    return f"{megabytes / 1000:.1f} GB" if megabytes >= 100 else f"{max(megabytes, 1):.0f} MB"


def _time(seconds: float) -> str:
    return f"{max(seconds / 60, 1):.0f} min" if seconds < 90 * 60 else f"{seconds / 3600:.1f} h"
