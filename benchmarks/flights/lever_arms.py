"""Simulated RTK flights whose antenna sits beside the lens, or whose heights drift: what the block makes of it.

    python -m benchmarks lever_arms [count=N]

The positions of flights as those of `flights`, with fixed solutions, are moved by a lever arm in the system of the image, or by a
height that drifts evenly during the flight. The block has no control. Every estimated lever arm is compared with the planted one in
its standard errors, and so is every drift, which is tested and no unknown: the centres are compared with what is stated of them.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from benchmarks.flights.judged_flight import LEAST_MATCHES, REJECTION, VERTICAL
from benchmarks.flights.measured_flight import Flight, Kind, flight
from benchmarks.instrument.result_page import write_page
from orthomill.schemas.observations import Control
from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.model.interior_settings import WeightedInterior
from orthomill.tasks.orientation.exterior.adjusted_block import orient_block
from orthomill.tasks.orientation.exterior.block_choices import BlockChoices
from orthomill.tasks.orientation.relative.pairs import relate_pairs
from orthomill.tasks.orientation.results.block_tables import BlockTables

FLIGHTS = 12
LAYOUTS = ("grid", "crossed", "oblique")
LEVER, STATED = (0.12, -0.08, 0.25), 0.3
"""m: planted, and the standard error that the user states of 0"""
DRIFT = 0.2
"""m in height from the first photograph to the last"""

Move = Callable[[Flight], np.ndarray]


class Arm(NamedTuple):
    """A flight with what was estimated and stated, m (3,): its lever arm or drift, and root mean square errors of the centres."""

    layout: str
    value: np.ndarray
    sigma: np.ndarray
    centres: np.ndarray
    stated: np.ndarray
    said: str


def by_lever(flown: Flight) -> np.ndarray:
    """(N, 3) m by which antennas lie beside the projection centres."""
    return np.array([view.rotation.T @ np.array(LEVER) for view in flown.views])


def by_drift(flown: Flight) -> np.ndarray:
    """(N, 3) m of a height that drifts."""
    along = np.linspace(-0.5, 0.5, len(flown.views)) * DRIFT
    return np.column_stack([0 * along, 0 * along, along])


def oriented(seed: int, move: Move, lever_sigma: float | None) -> Arm:
    """A flight whose positions are moved, through the functions of the product."""
    flown = flight(Kind(LAYOUTS[seed % len(LAYOUTS)], "rolling", "RTK fixed", True, seed % 2 == 0), seed)
    photos = Photos(
        photos=tuple(
            photo.model_copy(
                update={"position": tuple(np.array(photo.position) + by), "time": f"2026-06-01T10:{k // 30:02d}:{2 * (k % 30):02d}"}
            )
            for k, (photo, by) in enumerate(zip(flown.photos.photos, move(flown), strict=True))
        )
    )
    choices = BlockChoices(
        interior=WeightedInterior(kind="weighted"),
        gnss_shift="auto",
        vertical_sigma=VERTICAL,
        rejection=REJECTION,
        lever_sigma=lever_sigma,
    )
    relative = relate_pairs(photos, flown.cameras, flown.tie_points, LEAST_MATCHES)
    found = orient_block(photos, flown.cameras, flown.tie_points, Control(), relative, "EPSG:2100", choices)
    return _arm(flown, found, lever_sigma is not None)


def _arm(flown: Flight, found: BlockTables, lever: bool) -> Arm:
    precision, truth = found.precision, {view.name: view.centre for view in flown.views}
    error = np.array([np.array(photo.centre) - truth[photo.photo] for photo in found.block.photos])
    variance = np.array([np.diag(np.array(photo.covariance))[:3] for photo in found.block.photos])
    said = ", ".join(sorted({type(one).__name__ for one in precision.findings})) or "nothing"
    drift = precision.drifts[0]
    estimated = (precision.lever_arm, precision.lever_arm_sigma) if lever else (drift.value, drift.sigma)
    value, sigma = (np.array(one, float) for one in estimated)
    return Arm(flown.kind.layout, value, sigma, _rms(error), np.sqrt(variance.mean(axis=0)), said)


def _rms(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt((values**2).mean(axis=0)))


def _words(values: np.ndarray) -> str:
    return ", ".join(f"{1000 * value:.0f}" for value in values)


def _within(ratio: np.ndarray, limit: float) -> str:
    return f"{100 * float((np.abs(ratio) <= limit).mean()):.0f}"


def page(levers: list[Arm], drifts: list[Arm]) -> str:
    """Lever arms beside the planted one, then what drifts do."""
    ratio = np.array([(arm.value - np.array(LEVER)) / arm.sigma for arm in levers])
    amiss = np.array([(arm.value - (0.0, 0.0, DRIFT)) / arm.sigma for arm in drifts])
    apart = ", ".join(f"{value:.2f}" for value in _rms(ratio))
    return "\n".join(
        [
            "# Antennas beside the lens, and heights that drift",
            "",
            f"{len(levers)} flights of each kind with fixed solutions, without control; camera and lens are those of `flights`.",
            f"Planted lever arm: {_words(np.array(LEVER))} mm (x right, y up, z backwards); stated: 0 with {1000 * STATED:.0f} mm.",
            "",
            f"Of {ratio.size} estimated coordinates {_within(ratio, 1)} % lie within 1 and {_within(ratio, 2)} % within 2 of their",
            f"standard errors (root mean square by axis: {apart}).",
            "",
            "| layout | estimated mm | standard error mm | errors of centres mm (x, y, z) | stated mm | said |",
            "| --- | --- | --- | --- | --- | --- |",
            *(
                f"| {arm.layout} | {_words(arm.value)} | {_words(arm.sigma)} | {_words(arm.centres)} | {_words(arm.stated)} "
                f"| {arm.said} |"
                for arm in levers
            ),
            "",
            f"## Heights that drift by {1000 * DRIFT:.0f} mm, default settings",
            "",
            "Positions are stated to 10, 15 and 20 mm; a drift is no unknown of the block, it is tested.",
            f"Of {amiss.size} tested coordinates {_within(amiss, 1)} % lie within 1 and {_within(amiss, 2)} % within 2 of their",
            "standard errors from what was planted.",
            "",
            "| layout | drift tested mm (x, y, z) | standard error mm | errors of centres mm | stated mm | said |",
            "| --- | --- | --- | --- | --- | --- |",
            *(
                f"| {arm.layout} | {_words(arm.value)} | {_words(arm.sigma)} | {_words(arm.centres)} | {_words(arm.stated)} "
                f"| {arm.said} |"
                for arm in drifts
            ),
        ]
    )


def main(words: list[str]) -> None:
    """Orient all flights, and write the page."""
    given = dict(word.split("=") for word in words if "=" in word)
    seeds = range(int(given.get("count", FLIGHTS)))
    levers = [oriented(seed, by_lever, STATED) for seed in seeds]
    drifts = [oriented(seed, by_drift, None) for seed in seeds]
    write_page("lever_arms", words, page(levers, drifts))
