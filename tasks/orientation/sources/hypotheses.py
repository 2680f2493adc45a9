"""What may be wrong with the sources of a block, each as parameters beside its motion.

A constant error of positions, another camera constant of some photographs and a bend of the block look alike in a single strip from
above; over a whole block, with attitudes and control, they do not.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.orientation.sources.evidence import Equations, Source
from orthomill.tasks.orientation.sources.rigid_block import RigidBlock


@dataclass(frozen=True, eq=False)
class Offset:
    """The positions of `photos` (P,) bool have a constant error in the coordinates `axes`, m."""

    photos: np.ndarray
    axes: tuple[int, ...]

    @property
    def numbers(self) -> int:
        """How many parameters it has."""
        return len(self.axes)

    def columns(self, block: RigidBlock, has: Equations) -> np.ndarray:
        """(m, k) derivatives of the equations by its parameters."""
        own = _positions(has, self.photos)
        return np.stack([own & (has.axis == axis) for axis in self.axes], axis=1).astype(float)


@dataclass(frozen=True, eq=False)
class Zoom:
    """The camera constant of `photos` (P,) bool is another one than that of the others, by a share: zoom, another lens, a second
    camera of the same model."""

    photos: np.ndarray
    numbers = 1

    def columns(self, block: RigidBlock, has: Equations) -> np.ndarray:
        """(m, 1) derivatives of the equations by the share."""
        own = _positions(has, self.photos)
        return np.where(own, block.backwards[has.photo, has.axis], 0.0)[:, None]


@dataclass(frozen=True, eq=False)
class Bend:
    """The block is bent to a dome or a bowl, by m from its middle to its ends, and its photographs lean with it."""

    numbers = 1

    def columns(self, block: RigidBlock, has: Equations) -> np.ndarray:
        """(m, 1) derivatives of the equations by the bend."""
        away = has.place - block.middle[:2]
        reach = max(float(np.linalg.norm(block.centre[:, :2] - block.middle[:2], axis=1).max()), 1e-9)
        height = (away**2).sum(axis=1) / reach**2
        # A sheet that rises to the east turns about the y axis backwards, one that rises to the north about the x axis.
        lean = 2.0 / reach**2 * np.where(has.axis == 0, away[:, 1], np.where(has.axis == 1, -away[:, 0], 0.0))
        of_attitudes = has.source == Source.ATTITUDE
        return np.where(of_attitudes, lean, np.where(has.axis == 2, height, 0.0))[:, None]


@dataclass(frozen=True, eq=False)
class PlanScale:
    """The plan of the control is that of a map of another scale, by a share of its distances: distances on the ground, a web map,
    another projection."""

    numbers = 1

    def columns(self, block: RigidBlock, has: Equations) -> np.ndarray:
        """(m, 1) derivatives of the equations by the share."""
        away = has.place - block.middle[:2]
        own = (has.source == Source.CONTROL) & (has.axis < 2)
        return np.where(own, np.where(has.axis == 0, away[:, 0], away[:, 1]), 0.0)[:, None]


Cause = Offset | Zoom | Bend | PlanScale


def _positions(has: Equations, photos: np.ndarray) -> np.ndarray:
    """(m,) bool: equations of the positions of `photos` (P,) bool."""
    return ((has.source == Source.PLAN) | (has.source == Source.HEIGHT)) & photos[has.photo]
