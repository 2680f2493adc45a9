"""The up direction in photographs, for blocks whose tilt nothing else determines.

Known attitudes give it. Without them a photograph is assumed to look straight down, as from an aeroplane, or to be level and
upright, as when held in the hand. The block itself often shows which of the two: photographs that look along the line of their
positions, or to all sides, do not look down.
"""

from typing import Literal

import numpy as np

from orthomill.tasks.orientation.orientation_settings import Looking

Basis = Literal["attitude", "down", "level"]

DOWN, TOP = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
"""The up direction in the image system (x right, y up, z backwards) of a photograph that looks straight down, and of a level and
upright one."""
ALONG = np.sin(np.radians(45.0))
"""Photographs whose axes are within 45 degrees of the line of their centres do not look down, because lines of flight are nearly
level."""
TOGETHER = 0.7
"""Photographs whose mean axis, of unit vectors, is shorter look to all sides; 0.7 is a cone of 45 degrees about the mean."""


def expected_up(
    rotation: np.ndarray, known: np.ndarray, top: np.ndarray, looking: Looking, line: np.ndarray
) -> tuple[np.ndarray, Basis]:
    """The up directions (P, 3) in the image systems of the photographs (NaN: unknown), and what they are based on.

    `rotation` (P, 3, 3) and `line` (3,), the direction of the known points, refer to the model; `known` (P, 3) are the up
    directions by attitudes (NaN: unknown), `top` (P, 3) those of level photographs.
    """
    # A single attitude is better than any assumption: the mean over the block needs one only.
    if np.isfinite(known).all(axis=1).any():
        return known, "attitude"
    if looking == "auto":
        looking = "down" if _may_look_down(rotation[:, 2], line) else "level"
    return (np.tile(DOWN, (len(rotation), 1)) if looking == "down" else top), looking


def up_direction(rotation: np.ndarray, up: np.ndarray) -> np.ndarray:
    """The up direction (3,) of the model: the mean of those of its photographs, `up` (P, 3) in their image systems (NaN:
    unknown)."""
    has = np.isfinite(up).all(axis=1)
    mean = np.einsum("pij,pi->j", rotation[has], up[has])
    return mean / max(float(np.linalg.norm(mean)), 1e-12)


def _may_look_down(axes: np.ndarray, line: np.ndarray) -> bool:
    # The median of the angles with the line, because a few oblique photographs in a vertical block change nothing.
    return float(np.median(np.abs(axes @ line))) < ALONG and float(np.linalg.norm(axes.mean(axis=0))) > TOGETHER
