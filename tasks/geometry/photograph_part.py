"""The part of a photograph that a job reads: its pyramid level and the window in that level's raster."""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.raster import Window
from orthomill.tasks.geometry.view import View


@dataclass(frozen=True)
class PhotoPart:
    """The pixels of one photograph that a job holds: `window` in the raster of pyramid level `level`."""

    name: str
    level: int
    window: Window


@dataclass(frozen=True)
class PhotoSource:
    """A photograph at planning time: its view, the pyramid level to be used and the shape of that raster."""

    view: View
    level: int
    shape: tuple[int, ...]


def photo_level(cell: float, ground_pixel: float, levels: int) -> int:
    """The pyramid level with the ground pixel nearest to `cell` (both m); level k has pixels of 2^k full-size pixels."""
    # Nearest on a logarithmic scale: a coarser level loses detail, a finer one aliases, both by the same factor.
    return int(np.clip(np.floor(np.log2(max(cell / ground_pixel, 1.0)) + 0.5), 0, levels - 1))


def level_window(window: Window, level: int, shape: tuple[int, ...]) -> Window:
    """The window at pyramid level `level` (raster of `shape`) that covers a window of the full-size photograph."""
    return window.reduced(2**level).clipped(shape)
