"""Simulated flights to be surveyed: each has its own town, camera, lens, receiver, control, and errors of what is known of them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.flights.flight_knowledge import RECEIVERS, Receiver

SIDE = 400
"""px: side of a frame, which bounds what a flight costs"""
FRAME_MM = 50.0
LAYOUTS = ((2, 4, 0.65, 0.4), (2, 5, 0.75, 0.35), (3, 3, 0.6, 0.5), (3, 4, 0.7, 0.55))
"""strips, photographs of a strip, overlap along and across"""
KNOWN = (("RTK fixed", 0), ("RTK fixed", 5), ("RTK float", 6), ("GPS", 5), ("RTK fixed", 4), ("RTK float", 0), ("GPS", 8))
"""receiver and number of control points"""
POINTS = 100
"""check points of a flight, some surveys of 20"""


@dataclass(frozen=True)
class Plan:
    """A flight, and how well everything about it is known. `calibrated`: the camera comes from a calibration with its covariance,
    else from its tags, with a rounded focal length and no lens; lengths in m, `mark_sigma` in px."""

    number: int
    strips: int
    photos: int
    forward: float
    across: float
    pixel: float
    opening: float
    buildings: int
    noise: float
    receiver: str
    control: int
    calibrated: bool
    control_sigma: float
    survey_sigma: float
    mark_sigma: float

    @property
    def name(self) -> str:
        """Of both projects and their files."""
        return f"flight_{self.number:02d}"

    @property
    def positions(self) -> Receiver:
        """The receiver with its errors."""
        return RECEIVERS[self.receiver]

    @property
    def simulation(self) -> dict[str, Any]:
        """Settings of the stage that renders the photographs."""
        pixel_um = 1000 * FRAME_MM / SIDE
        return {
            "kind": "simulation",
            "seed": 3900 + self.number,
            "pixel_um": pixel_um,
            "frame_mm": FRAME_MM,
            "c_mm": self.opening * FRAME_MM,
            "scale": 1e6 * self.pixel / pixel_um,
            "base_m": (1 - self.forward) * SIDE * self.pixel,
            "side_overlap": self.across,
            "strips": self.strips,
            "photos_per_strip": self.photos,
            "scene_cell": max(0.75 * self.pixel, 0.1),
            "noise_sigma": self.noise,
            "buildings": self.buildings,
            "board_photos": 0,
            "control": 0,
            "check": 0,
        }


def plans(count: int) -> list[Plan]:
    """`count` flights; every one is drawn by itself, so that more of them begin with the same."""
    return [_plan(number) for number in range(1, count + 1)]


def _plan(number: int) -> Plan:
    rng = np.random.default_rng([39, number])
    strips, photos, forward, across = LAYOUTS[number % len(LAYOUTS)]
    receiver, control = KNOWN[number % len(KNOWN)]
    return Plan(
        number=number,
        strips=strips,
        photos=photos,
        forward=forward,
        across=across,
        pixel=round(float(np.exp(rng.uniform(*np.log((0.25, 0.6))))), 3),
        opening=round(float(rng.uniform(0.62, 0.95)), 3),
        buildings=int(rng.integers(2, 9)),
        noise=round(float(rng.uniform(1.0, 5.0)), 1),
        receiver=receiver,
        control=control,
        calibrated=number % 2 == 0,
        control_sigma=round(float(rng.uniform(0.01, 0.03)), 3),
        survey_sigma=round(float(rng.uniform(0.01, 0.03)), 3),
        mark_sigma=round(float(rng.uniform(0.2, 0.5)), 2),
    )
