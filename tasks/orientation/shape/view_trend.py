"""Whether the directions of view diverge over the block from those that gimbals report.

A camera model that does not fit bends a block like a sheet, and its photographs turn with it: those at one end look inwards,
those at the other end, too. Attitudes of a gimbal know nothing of camera and positions; their errors scatter, or are common to
all photographs (how the camera is mounted), and neither diverges over the block."""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.adjustment.testing.position_trend import LEAST


@dataclass(frozen=True)
class ViewTrend:
    """By how much directions of view diverge from the attitudes, `slope` rad per m (negative: they look inwards), its standard
    error by the scatter, and the `extent` (m) of the photographs."""

    slope: float
    sigma: float
    extent: float

    @property
    def ratio(self) -> float:
        """The slope in standard errors."""
        return self.slope / max(self.sigma, 1e-300)

    @property
    def degrees(self) -> float:
        """The divergence from one end of the block to the other."""
        return float(np.degrees(self.slope * self.extent))

    @property
    def bend(self) -> float:
        """m from the middle of the block to its ends, of a sheet whose normals diverge so."""
        return self.slope * self.extent**2 / 8.0


def view_trend(xy: np.ndarray, rotation: np.ndarray, up: np.ndarray) -> ViewTrend | None:
    """The trend of photographs at places (n, 2) m with `rotation` (n, 3, 3), world to image, against the directions `up` (n, 3) in
    their image systems that attitudes give; None for fewer than LEAST, and where they lie in one place."""
    if len(xy) < LEAST:
        return None
    away = xy - xy.mean(axis=0)
    extent = 2.0 * float(np.linalg.norm(away, axis=1).max())
    if not extent > 0:
        return None
    # Where the attitude sees the vertical, in the world of the block: its horizontal part is the tilt that the attitude lacks, and
    # the direction of view differs by the opposite.
    turned = -np.einsum("nji,nj->ni", rotation, up)[:, :2]
    # Besides the slope: a tilt of the whole block, and a camera that is mounted askew, which turns with the heading.
    tilt, askew = np.broadcast_to(np.eye(2), (len(xy), 2, 2)), rotation[:, :2, :2].transpose(0, 2, 1)
    design = np.concatenate([away[:, :, None] / extent, tilt, askew], axis=2).reshape(-1, 5)
    inverse = np.linalg.pinv(design, rcond=1e-3)
    found = inverse @ turned.ravel()
    redundancy = len(design) - np.linalg.matrix_rank(design, tol=1e-3 * np.linalg.norm(design, 2))
    scatter = float(np.sqrt(((turned.ravel() - design @ found) ** 2).sum() / redundancy))
    return ViewTrend(float(found[0]) / extent, scatter * float(np.linalg.norm(inverse[0])) / extent, extent)
