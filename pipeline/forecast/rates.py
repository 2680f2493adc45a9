"""What a stage takes for a megapixel of photographs: in complete runs of this machine, and in four blocks measured at release.

Jobs, bytes and time of every stage grow with the pixels of the photographs, whatever the block: over simulated film, two drone
blocks and a wood in near infrared they differ by a factor of two or so. Memory grows with the tile, not with the block.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from orthomill.pipeline.engine.run_facts import RunFacts, StageRun, read_facts

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


REFERENCE: dict[str, tuple[Rate, ...]] = {
    "simulation": (Rate(21.2, 12.1, 1.47, 559),),
    "photos": (Rate(3.5, 4.0, 0.07, 990), Rate(4.1, 3.8, 0.09, 723), Rate(3.0, 3.1, 0.07, 607), Rate(3.0, 3.8, 0.07, 793)),
    "calibration": (Rate(1.2, 0.22, 0.28, 990), Rate(0.02, 0.01, 0.01, 335)),
    "tie_points": (Rate(2.2, 1.2, 0.39, 850), Rate(7.7, 1.6, 0.83, 885), Rate(7.8, 1.0, 0.50, 808), Rate(5.9, 1.2, 1.19, 851)),
    "orientation": (Rate(0.4, 0.16, 0.06, 854), Rate(0.3, 0.13, 0.15, 896), Rate(0.2, 0.12, 0.35, 862), Rate(0.2, 0.11, 0.30, 904)),
    "epipolar": (Rate(9.4, 1.8, 0.13, 855), Rate(11.3, 2.1, 0.17, 896), Rate(12.7, 1.9, 0.19, 862), Rate(13.8, 2.2, 0.21, 904)),
    "densification": (
        Rate(24.4, 11, 1.64, 993),
        Rate(30.4, 6.8, 2.55, 896),
        Rate(31.2, 6.9, 2.72, 1200),
        Rate(45.0, 14, 5.59, 1430),
    ),
    "dsm_check": (Rate(8.5, 6.3, 0.79, 1097), Rate(17.0, 3.7, 0.91, 875), Rate(13.8, 1.9, 0.47, 1200), Rate(30.3, 4.6, 1.34, 1443)),
    "texture": (Rate(6.8, 7.0, 1.42, 1157), Rate(8.2, 4.7, 1.30, 917), Rate(7.3, 2.8, 1.44, 1201), Rate(8.1, 4.7, 1.12, 1444)),
    "evaluation": (Rate(7.7, 3.5, 0.48, 1157),),
}
"""Measured with `python -m benchmarks forecast_rates RUN...` on volos (34 megapixels), brighton (41), caliterra and seneca (66),
with all settings at their defaults and two cores of one machine."""


def rate_of(stage: StageRun, facts: RunFacts) -> Rate:
    """What a stage of a complete run took."""
    megapixels, scale = facts.pixels / _MEGA, (facts.tile / TILE) ** 2
    # A stage of a few jobs has as many with any tile, but it has few.
    return Rate(
        jobs=stage.jobs * scale / megapixels,
        megabytes=stage.written / _MEGA / megapixels,
        seconds=stage.cpu_seconds / megapixels,
        peak_mib=PROCESS_MIB + max((stage.peak_bytes or 0) / 2**20 - PROCESS_MIB, 0.0) / scale,
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
