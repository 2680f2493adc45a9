"""Where the sky is in a photograph, when nothing but the photographs tells how the block is tilted.

Known attitudes say it. Without them a photograph is taken to look straight down, as from an aeroplane, or to be held level and
upright, as in a hand; which of the two, the block itself can often tell: photographs from a line of flight that look along this
line, or to all sides, do not look down.
"""

from typing import Literal

import numpy as np

Looking = Literal["auto", "down", "level"]
Basis = Literal["attitude", "down", "level"]

DOWN, TOP = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
"""The zenith in the image system (x right, y up, z backwards) of a photograph that looks straight down, and of a level one that
stands upright."""
ALONG = np.sin(np.radians(45.0))
"""Photographs whose axes are nearer to the line of their centres than 45 degrees do not look down."""
TOGETHER = 0.7
"""Photographs whose mean axis, of unit vectors, is shorter look to all sides."""
SENTENCES: dict[Basis, str] = {
    "attitude": "on the attitudes that came with the photographs",
    "down": "on the assumption that the photographs look straight down on average",
    "level": "on the assumption that the photographs were held level and upright on average",
}


def expected_zenith(
    rotation: np.ndarray, known: np.ndarray, top: np.ndarray, looking: Looking, line: np.ndarray
) -> tuple[np.ndarray, Basis]:
    """The zenith (P, 3) in the image systems of the photographs, NaN for those that say nothing of it, and what it rests on (a key
    of SENTENCES). `rotation` (P, 3, 3) and `line` (3,), the direction of the known points, are of the model; `known` (P, 3) is
    the zenith by attitudes (NaN: unknown), `top` (P, 3) the zenith of level photographs."""
    if np.isfinite(known).all(axis=1).any():
        return known, "attitude"
    if looking == "auto":
        looking = "down" if _may_look_down(rotation[:, 2], line) else "level"
    return (np.tile(DOWN, (len(rotation), 1)) if looking == "down" else top), looking


def upward(rotation: np.ndarray, zenith: np.ndarray) -> np.ndarray:
    """The direction (3,) of the model that the photographs call up, on average."""
    has = np.isfinite(zenith).all(axis=1)
    up = np.einsum("pij,pi->j", rotation[has], zenith[has])
    return up / max(float(np.linalg.norm(up)), 1e-12)


def _may_look_down(axes: np.ndarray, line: np.ndarray) -> bool:
    return float(np.median(np.abs(axes @ line))) < ALONG and float(np.linalg.norm(axes.mean(axis=0))) > TOGETHER
