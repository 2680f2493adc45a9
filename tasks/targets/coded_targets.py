"""Targets that name themselves: square codes (AprilTag, ArUco) and codes on a ring about a dot."""

import numpy as np

from orthomill.schemas.marks import FoundTarget
from orthomill.tasks.targets.leaning_circle import WIDE
from orthomill.tasks.targets.ring_coded_dots import ring_coded_dots
from orthomill.tasks.targets.square_codes import square_codes


def coded_targets(grey: np.ndarray, c: float = WIDE) -> list[FoundTarget]:
    """The coded targets of a grey image (rows, cols) uint8, sorted by name; c: the camera constant, px."""
    found: dict[str, FoundTarget | None] = {}
    for one in all_coded_targets(grey, c):
        # Twice in a photograph is a copy of it, on paper or in a window: neither is known to be the point.
        found[one.name] = None if one.name in found else one
    return [one for _, one in sorted(found.items()) if one is not None]


def all_coded_targets(grey: np.ndarray, c: float = WIDE) -> list[FoundTarget]:
    """As `coded_targets`, with those that show more than once."""
    return [*square_codes(grey), *ring_coded_dots(grey, c)]
