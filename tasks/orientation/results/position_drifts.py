"""Whether the positions of a flight move evenly against the block: a receiver whose solution drifts, or its base."""

from collections.abc import Iterator

import numpy as np
from scipy.special import stdtrit

from orthomill.schemas.findings.contradiction_findings import PositionsDrift
from orthomill.schemas.orientation import PositionDrift
from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.testing.drift_test import drift_test
from orthomill.tasks.orientation.block.assembly import BlockResults
from orthomill.tasks.orientation.sources.causes import CHANCE

FEWEST = 6
"""positions of a flight from which on a drift is told from single errors"""


def position_drifts(results: BlockResults, photos: Photos) -> tuple[PositionDrift, ...]:
    """The drift of every flight whose photographs have times, with standard errors; none of a free block."""
    names = results.problem.names
    if results.datum.free:
        return ()
    seconds = np.array([photos[name].seconds for name in names])
    has = np.isfinite(seconds) & results.result.network.centre_weight.any(axis=1)
    moment, flight = np.zeros(len(names)), np.full(len(names), -1)
    told: list[tuple[np.ndarray, float]] = []
    numbers = np.array([photos[name].flight for name in names])
    for number in np.unique(numbers[has]):
        own = np.flatnonzero(has & (numbers == number))
        first, last = seconds[own].min(), seconds[own].max()
        if len(own) >= FEWEST and last > first:
            moment[own], flight[own] = (seconds[own] - first) / (last - first) - 0.5, len(told)
            told.append((own[np.argsort(seconds[own], kind="stable")], (last - first) / 3600.0))
    found = drift_test(results.result, moment, flight)
    rows = zip(told, found.value, found.sigma, found.freedom, strict=True)
    return tuple(
        PositionDrift(
            photos=tuple(names[i] for i in own),
            hours=float(hours),
            value=_known(value),
            sigma=_known(sigma),
            freedom=float(freedom),
        )
        for (own, hours), value, sigma, freedom in rows
        if np.isfinite(value).any()
    )


def drift_findings(drifts: tuple[PositionDrift, ...], stated: np.ndarray, names: tuple[str, ...]) -> Iterator[PositionsDrift]:
    """The drifts that chance does not make and that exceed what is stated of the positions (P, 3) m."""
    tests = max(3 * len(drifts), 1)
    for drift in drifts:
        limit = -float(stdtrit(max(drift.freedom, 1.0), 0.5 * CHANCE / tests))
        own = np.nanmedian(stated[np.isin(names, drift.photos)], axis=0)
        rows = zip(drift.value, drift.sigma, own, strict=True)
        if any(v is not None and s is not None and abs(v) > max(limit * s, of) for v, s, of in rows):
            yield PositionsDrift(photos=drift.photos, hours=drift.hours, drift=drift.value, sigma=drift.sigma)


def _known(values: np.ndarray) -> tuple[float | None, float | None, float | None]:
    x, y, z = (float(value) if np.isfinite(value) else None for value in values)
    return x, y, z
