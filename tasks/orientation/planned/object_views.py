"""Photographs that show a wall or an object and no ground from above: how they look at it, and what is to be done."""

import numpy as np

AROUND = np.radians(180.0)
"""Part of the horizon that the directions of view cover where an object was photographed from all sides."""
ALONG = np.radians(60.0)
"""Part that they cover at most where one wall was."""
OBLIQUE = np.radians(25.0)
"""Views that lean less show the tops of things, and no sides that would matter."""
_OBJECT = (
    "an object from all sides, of which a surface with one height at a place shows the upper side only: orient them (run --until "
    "orientation) and put the photographs on a mesh of another program (docs/guide.md, 'Walls, columns, statues')"
)
_WALL = (
    "one wall: its surface and orthoimage are made on its plane (grid: {kind: plane}; docs/guide.md, 'A facade from its "
    "photographs alone')"
)
_SCALE = "measured distances or control points give the scale"
UNKNOWN_VIEWS = (
    "If they show a wall or an object and not the ground from above, docs/guide.md has the ways for these ('A facade from its "
    f"photographs alone', 'Walls, columns, statues'); {_SCALE}."
)
"""where neither positions nor attitudes tell how photographs look"""


def views_of_object(centre: np.ndarray, axes: np.ndarray) -> str | None:
    """The sentence about photographs at `centre` (P, 3) m with directions of view `axes` (P, 3) that look aside; None where these
    show neither one wall nor an object."""
    lean = float(np.median(np.arccos(np.clip(-axes[:, 2], -1.0, 1.0))))
    covered = _covered(np.arctan2(axes[:, 1], axes[:, 0]))
    if lean < OBLIQUE:
        return None
    inwards = float(np.median(((centre - centre.mean(axis=0)) * axes)[:, :2].sum(axis=1))) < 0.0
    if covered > AROUND and inwards:
        return f"The views meet at {_OBJECT}; {_SCALE}."
    level = lean > np.radians(60.0)
    return f"The photographs show {_WALL}; {_SCALE}." if level and covered < ALONG else None


def _covered(azimuth: np.ndarray) -> float:
    """rad: the horizon less the largest gap between directions (P,)."""
    order = np.sort(azimuth)
    return float(2.0 * np.pi - np.diff(np.append(order, order[0] + 2.0 * np.pi)).max())
