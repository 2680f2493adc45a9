"""Water as a photograph shows it: waves and glints that are elsewhere in every photograph, so that nothing can be matched."""

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.truth import Material
from orthomill.tasks.simulation.scene.ground_texture import WATER_COLOUR, PaintedWindow
from orthomill.tasks.simulation.scene.hash_noise import value_noise

_WAVES, _SWELL, _TONE = 71, 72, 73  # layers of hashed noise, added to the seed
_PHOTOGRAPHS = 101  # between the noises of one photograph and of the next
_RIPPLED, _SWOLLEN, _TONED = 0.10, 0.14, 0.16  # amplitudes of waves of 1 and 3 m, and of brightness over 40 m
_GLINT = 0.78  # of waves and swell together, from which on the sun is reflected
_SUNLIGHT = 1000.0  # grey levels per unit above that


def with_glints(painted: PaintedWindow, grid: MapGrid, window: Window, seed: int, photo: int) -> PaintedWindow:
    """The window with its water as photo number `photo` shows it."""
    water = painted.surface.material == Material.WATER
    if not water.any():
        return painted
    colours = painted.colours.copy()
    x, y = grid.centres(window)
    _ripple(colours, water, (x, y), seed * _PHOTOGRAPHS + photo + 1)
    return PaintedWindow(painted.surface, colours)


@njit()
def _ripple(colours, water, axes, seed):
    """Sets the colours (rows, cols, 3) of the water cells; `axes`: x (cols,) and y (rows,) of the cells' centres."""
    x, y = axes
    for row in range(water.shape[0]):
        for col in range(water.shape[1]):
            if water[row, col]:
                waves = value_noise(seed * 8 + _WAVES, x[col] / 1.1, y[row] / 0.8)
                swell = value_noise(seed * 8 + _SWELL, x[col] / 3.4, y[row] / 2.6)
                tone = value_noise(seed * 8 + _TONE, x[col] / 40.0, y[row] / 40.0)
                factor = 1.0 + _RIPPLED * waves + _SWOLLEN * swell + _TONED * tone
                # Only the crests that happen to face the sun reflect it: small, bright and rare.
                glint = _SUNLIGHT * max(0.5 * (waves + swell) - _GLINT, 0.0)
                for band in range(3):
                    colours[row, col, band] = np.uint8(min(WATER_COLOUR[band] * factor + glint, 250.0) + 0.5)
