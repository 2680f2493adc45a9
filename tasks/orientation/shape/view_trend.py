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
    away = xy - xy.mean(axis=0)
    extent = 2.0 * float(np.linalg.norm(away, axis=1).max(initial=0.0))
    if len(xy) < LEAST or not extent > 0:
        return None
    # Where the attitude sees the vertical, in the world of the block: its horizontal part is the tilt that the attitude lacks, and
    # the direction of view differs by the opposite.
    turned = -np.einsum("nji,nj->ni", rotation, up)[:, :2]
    off = turned - turned.mean(axis=0)
    square = float((away**2).sum())
    slope = float((away * off).sum() / square)
    # Two means and the slope are taken from 2 n numbers.
    scatter = np.sqrt(((off - slope * away) ** 2).sum() / (2 * len(xy) - 3))
    return ViewTrend(slope, float(scatter / np.sqrt(square)), extent)
