"""Signalised points on the portal: black and white quarters of 6 cm, as total stations and people find them."""

import numpy as np

from orthomill.kernels.kernel_compilation import njit

RADIUS = 0.030
"""m of the quarters; a white rim of a third of it is round them"""
# x along the facade, y into the wall, z up: on the wall, the front of the porch, the wall behind the arch, steps and beams.
_PLACES = (
    (-2.75, 0.0, 0.95), (-2.45, 0.0, 2.35), (-2.6, 0.0, 3.9), (-2.3, 0.0, 5.15),
    (2.75, 0.0, 0.9), (2.5, 0.0, 2.5), (2.65, 0.0, 3.85), (2.35, 0.0, 5.2), (0.85, -1.05, 5.10),
    (-1.58, -1.05, 4.35), (1.6, -1.05, 4.3), (-0.9, -1.05, 5.08),
    (-1.0, 0.9, 1.05), (1.02, 0.9, 1.1), (-1.02, 0.9, 2.7), (1.0, 0.9, 2.75),
    (-1.1, -1.3, 0.375), (1.15, -1.3, 0.375),
    (-2.9, 0.0, 2.9), (2.9, 0.0, 3.2), (-1.7, -1.05, 3.98), (0.95, 0.9, 1.9), (0.0, -1.3, 0.375), (-1.0, 0.9, 1.9),
)  # fmt: skip
TARGETS = np.array(_PLACES)
"""(24, 3) m along the portal's axes; all face the street. The first CONTROL of them are control, the others check points."""
CONTROL = 18


@njit()
def on_target(targets, place, normal, colour):
    """Replaces the reflectance `colour` (3,) where a target is painted."""
    # All targets are on surfaces that face the street.
    if normal[1] > -0.99:
        return
    for i in range(len(targets)):
        dx, dy, dz = place[0] - targets[i, 0], place[1] - targets[i, 1], place[2] - targets[i, 2]
        if abs(dy) > 0.01 or abs(dx) > 0.04 or abs(dz) > 0.04:
            continue
        distance = dx * dx + dz * dz
        if distance < RADIUS * RADIUS:
            colour[:] = 18.0 if dx * dz > 0.0 else 246.0
        elif distance < (1.33 * RADIUS) ** 2:
            colour[:] = 246.0
