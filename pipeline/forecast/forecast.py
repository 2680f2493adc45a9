"""Jobs, disk, memory and time of every stage of a project, from the pixels of its photographs alone.

About: the median of what other blocks took for a megapixel. At most: twice as much as the most demanding of them, or little more. A
stage that is planned replaces both by exact numbers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from orthomill.pipeline.engine.foresight import photograph_pixels
from orthomill.pipeline.engine.session import Session
from orthomill.pipeline.forecast.known_costs import MARGIN
from orthomill.pipeline.forecast.rates import PROCESS_MIB, TILE, Rate, rates_here, rates_of_release

ONCE = 15.0
"""Jobs of a stage that it has for any block, at most: without them a block of a few megapixels would have none."""
PEAK_MARGIN = 1.4
"""The same for the memory of a worker, which grows with the tile and hardly with the block."""
_MEGA = 1e6


@dataclass(frozen=True)
class Amount:
    """About how much, and up to how much."""

    about: float
    most: float

    def __add__(self, other: "Amount") -> "Amount":
        return Amount(self.about + other.about, self.most + other.most)


NOTHING = Amount(0.0, 0.0)


@dataclass(frozen=True)
class StageForecast:
    """What a stage takes: `jobs`, `megabytes` stored, CPU-`seconds`, and the largest worker in MiB."""

    jobs: Amount
    megabytes: Amount
    seconds: Amount
    peak_mib: Amount


@dataclass(frozen=True)
class Forecast:
    """All stages by kind, for `megapixels` of photographs; `runs`: complete runs of this machine whose time was used, 0: none."""

    megapixels: float
    stages: dict[str, StageForecast]
    runs: int

    @property
    def megabytes(self) -> Amount:
        """Disk that all stages need."""
        return sum((stage.megabytes for stage in self.stages.values()), NOTHING)

    @property
    def seconds(self) -> Amount:
        """Processor time of all stages."""
        return sum((stage.seconds for stage in self.stages.values()), NOTHING)


def forecast(session: Session) -> Forecast | None:
    """The forecast for a planned session; None while the sizes of its photographs are not known."""
    pixels = photograph_pixels(session)
    if not pixels:
        return None
    # Not from its own earlier run: a forecast that knows the answer could not be judged by it.
    here = rates_here(session.root / "runs", but=session.folder)
    return block_forecast([stage.kind for stage in session.stages], pixels / _MEGA, session.project.tile, here)


def block_forecast(kinds: Sequence[str], megapixels: float, tile: int, here: Mapping[str, tuple[Rate, ...]]) -> Forecast:
    """The forecast of the stages `kinds` for photographs of so many megapixels; `here`: the rates of this machine."""
    released = rates_of_release()
    known = {kind: (*here.get(kind, ()), *released.get(kind, ())) for kind in kinds}
    stages = {
        kind: stage_forecast(rates, here.get(kind) or rates, megapixels, (tile / TILE) ** 2)
        for kind, rates in known.items()
        if rates
    }
    return Forecast(megapixels, stages, max(map(len, here.values()), default=0))


def stage_forecast(rates: tuple[Rate, ...], timed: tuple[Rate, ...], megapixels: float, scale: float) -> StageForecast:
    """`timed`: the rates of this machine, where it has any; `scale`: area of a tile in those of TILE."""
    peaks = [PROCESS_MIB + (rate.peak_mib - PROCESS_MIB) * scale for rate in rates]
    return StageForecast(
        _amount([rate.jobs * megapixels / scale for rate in rates]) + Amount(0.0, ONCE),
        _amount([rate.megabytes * megapixels for rate in rates]),
        _amount([rate.seconds * megapixels for rate in timed]),
        _amount(peaks, PEAK_MARGIN),
    )


def _amount(values: list[float], margin: float = MARGIN) -> Amount:
    return Amount(median(values), margin * max(values))
