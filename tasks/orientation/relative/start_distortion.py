"""Approximate radial distortion of nominal cameras, found from pairs alone.

Wide-angle lenses distort so much that pairs which overlap at their borders fit no central projection: their matches are rejected,
or the block converges to a wrong shape that no bundle adjustment leaves again. Where many matches fit no relative orientation, a
few values of k1 are tried, and the one with which most matches fit is the starting value. The block adjustment refines it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.camera import Cameras
from orthomill.schemas.orientation import RelativeOrientation
from orthomill.tasks.orientation.folding import reach

# Steps of 0.05: a remaining error of 0.025 moves a corner at 0.7 c by 0.9 % of c, within reach of the bundle adjustment. Barrel
# distortion (negative) is larger than pincushion distortion in common lenses.
_TRIED = (-0.4, -0.35, -0.3, -0.25, -0.2, -0.15, -0.1, -0.05, 0.05, 0.1)
_FITTING = 0.95
"""No value is tried where this share of the matches fits: the rest are ordinary wrong matches."""
_GAIN = 1.05
"""A distortion must make this factor more matches fit than none, or chance would choose it."""
_MOST_PAIRS = 12
"""Each value relates so many pairs again; the strongest ones decide, and the time does not grow with the block."""
_ROOM = 0.95
"""The farthest corner must lie within this share of the largest radius at which a distortion can be inverted."""

LENS = slice(3, None)
"""The coefficients of the lens in the order of INTERIOR."""

Relating = Callable[[Cameras, list[tuple[str, str]]], list[RelativeOrientation]]
"""Orients pairs, given by the names of their photographs, with given cameras."""


@dataclass(frozen=True)
class Distorted:
    """The cameras of the start, and the k1 of those that were changed, by name."""

    cameras: Cameras
    k1: dict[str, float]


def start_distortion(cameras: Cameras, found: list[RelativeOrientation], relate: Relating) -> Distorted:
    """`found`: the pairs oriented without distortion. Only cameras from EXIF are considered, and of these
    none whose tags give a distortion."""
    chosen: dict[str, float] = {}
    for name, camera in cameras.cameras.items():
        own = [pair for pair in found if {cameras.of_photo[pair.left], cameras.of_photo[pair.right]} == {name}]
        measured = camera.source != "exif" or any(camera.interior[LENS])
        if measured or not own or _explained(own) >= _FITTING * sum(pair.matches for pair in own):
            continue
        strongest = sorted(own, key=lambda pair: -pair.matches)[:_MOST_PAIRS]
        names = [(pair.left, pair.right) for pair in strongest]
        corner = 0.5 * float(np.hypot(camera.width, camera.height))
        tried = [k1 for k1 in _TRIED if corner <= _ROOM * reach(camera.changed(k1=k1))]
        fits = {k1: _kept(relate(cameras.with_k1({name: k1}), names)) for k1 in tried}
        best = max(fits, key=fits.__getitem__, default=0.0)
        if best and fits[best] > _GAIN * _explained(strongest):
            chosen[name] = best
    return Distorted(cameras.with_k1(chosen), chosen)


def _kept(pairs: list[RelativeOrientation]) -> int:
    """Matches that fit a relative orientation."""
    return sum(pair.kept for pair in pairs if pair.oriented)


def _explained(pairs: list[RelativeOrientation]) -> int:
    """Matches that fit a relative orientation or a pure rotation: a distortion must not turn the latter into a base."""
    return sum(pair.kept for pair in pairs)
