"""The adjusted block as a rigid body, and how it would have to move for a source to be right.

Image measurements determine the shape of a block, and sources (positions, control, attitudes) its place: each of them is compared
with the shape, not with the block where the adjustment left it between them. Besides the seven parameters of a similarity, the
camera constants count: another one changes how far the projection centres lie from the ground.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from orthomill.tasks.geometry.rotation_vector import rotation_of_vector


@dataclass(frozen=True, eq=False)
class RigidBlock:
    """A block as its image measurements show it, local m: `centre` (P, 3), `rotation` (P, 3, 3) world to image, `depth` (P,) mean
    distance along the view to the ground, `camera` (P,) numbers of the cameras, `control` (n, 3) the control points by their rays
    alone (NaN: without place), `pixel` m on the ground, `ground` (g, 3) some of its tie points."""

    centre: np.ndarray
    rotation: np.ndarray
    depth: np.ndarray
    camera: np.ndarray
    control: np.ndarray
    pixel: float
    ground: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def middle(self) -> np.ndarray:
        """(3,) the point about which the block turns."""
        return self.centre.mean(axis=0)

    @property
    def backwards(self) -> np.ndarray:
        """(P, 3) m by which a projection centre moves for a camera constant that doubles: away from the ground by its depth."""
        return self.depth[:, None] * self.rotation[:, 2]

    def moved(self, motion: np.ndarray) -> "RigidBlock":
        """The block after a `motion` (7,): shift m, rotation vector rad about the middle, and relative change of scale."""
        turn, scale, middle = rotation_of_vector(motion[3:6]), 1.0 + motion[6], self.middle

        def place(points: np.ndarray) -> np.ndarray:
            return np.asarray(middle + motion[:3] + scale * (points - middle) @ turn.T)

        return replace(
            self,
            centre=place(self.centre),
            rotation=self.rotation @ turn.T,
            depth=scale * self.depth,
            control=place(self.control),
            ground=place(self.ground),
        )
