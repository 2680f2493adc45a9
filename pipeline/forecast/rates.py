"""What a stage takes for a megapixel of photographs: in complete runs of this machine, and in four blocks measured at release.

Jobs, bytes and time of every stage grow with the pixels of the photographs, whatever the block: over simulated film, two drone
blocks and a wood in near infrared they differ by a factor of two or so. Memory grows with the tile, not with the block.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from orthomill.pipeline.engine.run_facts import RunFacts, StageRun, read_facts
from orthomill.schemas.memory import MIB

_MEGA = 1e6
TILE = 512
"""px: the tile to which jobs and memory are reduced"""
PROCESS_MIB = 600.0
"""of a worker apart from its job, which do not grow with the tile"""


@dataclass(frozen=True)
class Rate:
    """For a megapixel of photographs: jobs with tiles of TILE, MB stored, CPU-s; and the largest worker, MiB, with such tiles."""

    jobs: float
    megabytes: float
    seconds: float
    peak_mib: float


@cache
def rates_of_release() -> dict[str, tuple[Rate, ...]]:
    """The rates of the blocks measured at release, by stage.

    They are of volos (34 megapixels), brighton (41), caliterra and seneca (66), terrain also of a second town (34) and a closed
    wood (10), projections of a portal (35), a registration of nine scans as for a portal, with all settings at their defaults, by
    two cores of one machine; `python -m benchmarks forecast_rates RUN...` prints what a run adds to rates.json.
    """
    shipped = json.loads((Path(__file__).parent / "rates.json").read_text())
    return {stage: tuple(Rate(*numbers) for numbers in blocks.values()) for stage, blocks in shipped.items()}


def rate_of(stage: StageRun, facts: RunFacts) -> Rate:
    """What a stage of a complete run took."""
    megapixels, scale = facts.pixels / _MEGA, (facts.tile / TILE) ** 2
    # A stage of a few jobs has as many with any tile, but it has few.
    return Rate(
        jobs=stage.jobs * scale / megapixels,
        megabytes=stage.written / _MEGA / megapixels,
        seconds=stage.cpu_seconds / megapixels,
        peak_mib=PROCESS_MIB + max((stage.peak_bytes or 0) / MIB - PROCESS_MIB, 0.0) / scale,
    )


def rates_here(runs: Path, but: Path) -> dict[str, tuple[Rate, ...]]:
    """The rates of all complete runs in a folder of runs but one, by stage."""
    found: dict[str, tuple[Rate, ...]] = {}
    for facts in _complete(runs, but):
        for stage in facts.stages:
            found[stage.kind] = (*found.get(stage.kind, ()), rate_of(stage, facts))
    return found


def _complete(runs: Path, but: Path) -> Iterator[RunFacts]:
    for folder in sorted(runs.glob("*")):
        facts = read_facts(folder) if folder != but else None
        # Facts of earlier versions do not say how many pixels they are for.
        if facts and facts.complete and facts.pixels and facts.tile:
            yield facts
