"""Known errors of a surface model, a tilt and a number of bumps, to test whether a check finds them.

Strategy. The tilt grows linearly from corner to corner, as a wrong datum or orientation would cause it (published: -5 to +5 m over
1500 m); bumps are raised cosines of alternating sign, at seeded random places with a minimum distance. Everything is a pure
function of position, so any window of any grid can be deformed independently.

Source: Skarlatos, PhD thesis, 4.4.1 and equation 4.20 (sources/surface_check.md#table-4-20).
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.raster import MapGrid

_TILT, _HEIGHT = 5.0, 3.0  # m: equation 4.20 of the source, and bumps well above the precision of its surfaces
_SPACING = 2.5  # radii between centres: two bumps of opposite sign must not cancel


@dataclass(frozen=True)
class Bump:
    """A round error of the surface: `height` m at the centre (x, y) m, none beyond `radius` m."""

    x: float
    y: float
    radius: float
    height: float


@dataclass(frozen=True)
class Deformation:
    """Known errors: `tilt` m at the north-west corner of the grid, -tilt at the south-east one, and bumps."""

    grid: MapGrid
    tilt: float
    bumps: tuple[Bump, ...]

    def tilt_at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Error (m) of the tilt alone at ground points of any shape."""
        width, height = self.grid.cols * self.grid.cell, self.grid.rows * self.grid.cell
        return self.tilt * (1 - (x - self.grid.west) / width - (self.grid.north - y) / height)

    def at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Error (m) to be added to the true heights at ground points of any shape."""
        return self.tilt_at(x, y) + sum(bump.height * shape_of(bump, x, y) for bump in self.bumps)


def shape_of(bump: Bump, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """1 at the centre of a bump, falling as a cosine to 0 at its radius."""
    distance = np.minimum(np.hypot(x - bump.x, y - bump.y) / bump.radius, 1.0)
    return 0.5 * (1 + np.cos(np.pi * distance))


def planted(grid: MapGrid, places: np.ndarray, radius: float, count: int = 20, seed: int = 2) -> Deformation:
    """A tilt of +-5 m and up to `count` bumps of alternating +-3 m and `radius` m.

    places (N, 2) m: possible centres, e.g. open ground that two photographs see. Centres are two and a half radii apart at least,
    so there are fewer bumps where the places are close together.
    """
    chosen: list[np.ndarray] = []
    for place in np.random.default_rng(seed).permutation(places):
        if all(np.hypot(*(place - other)) > _SPACING * radius for other in chosen):
            chosen.append(place)
        if len(chosen) == count:
            break
    bumps = tuple(Bump(float(x), float(y), radius, _HEIGHT * (-1) ** k) for k, (x, y) in enumerate(chosen))
    return Deformation(grid, _TILT, bumps)
