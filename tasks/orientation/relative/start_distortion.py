"""Rough radial distortion of nominal cameras, found from pairs alone.

Wide lenses bend the picture so much that pairs which overlap at their borders fit no central projection: their matches are thrown
out, or the block settles in a wrong shape that no bundle adjustment leaves again. Where many matches fit no relative orientation,
a few values of k1 are tried, and the one with which most matches fit is taken as the start. The block adjustment finds the rest.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.camera import Cameras
from orthomill.schemas.orientation import RelativeOrientation
from orthomill.tasks.orientation.folding import reach

_TRIED = (-0.2, -0.15, -0.1, -0.05, 0.05, 0.1)
_FITTING = 0.95
"""Nothing is tried where this share of the matches fits."""
_GAIN = 1.05
"""A distortion must make so many times more matches fit than none."""
_MOST_PAIRS = 12
_ROOM = 0.95
"""The farthest corner must lie within this share of the largest radius that a distortion can reach."""

Relating = Callable[[Cameras, list[tuple[str, str]]], list[RelativeOrientation]]
"""Relates pairs, by the names of their photographs, with given cameras."""


@dataclass(frozen=True)
class Distorted:
    """The cameras to begin with, and k1 by the name of those that were changed."""

    cameras: Cameras
    k1: dict[str, float]


def start_distortion(cameras: Cameras, found: list[RelativeOrientation], relate: Relating) -> Distorted:
    """`found`: the pairs without distortion; only cameras from EXIF, which have none, are looked at."""
    chosen: dict[str, float] = {}
    for name, camera in cameras.cameras.items():
        own = [pair for pair in found if {cameras.of_photo[pair.left], cameras.of_photo[pair.right]} == {name}]
        if camera.source != "exif" or not own or _explained(own) >= _FITTING * sum(pair.matches for pair in own):
            continue
        strongest = sorted(own, key=lambda pair: -pair.matches)[:_MOST_PAIRS]
        names = [(pair.left, pair.right) for pair in strongest]
        corner = 0.5 * float(np.hypot(camera.width, camera.height))
        tried = [k1 for k1 in _TRIED if corner <= _ROOM * reach(camera.model_copy(update={"k1": k1}))]
        fits = {k1: _kept(relate(cameras.with_k1({name: k1}), names)) for k1 in tried}
        best = max(fits, key=fits.__getitem__, default=0.0)
        if best and fits[best] > _GAIN * _explained(strongest):
            chosen[name] = best
    return Distorted(cameras.with_k1(chosen), chosen)


def _kept(pairs: list[RelativeOrientation]) -> int:
    return sum(pair.kept for pair in pairs if pair.oriented)


def _explained(pairs: list[RelativeOrientation]) -> int:
    """Matches that fit something, a mere turn of the camera too: no distortion shall make a base of it."""
    return sum(pair.kept for pair in pairs)
