"""Interior orientations that vary from photograph to photograph: zoom lenses, stabilisers, rolling shutters.

Each photograph gets corrections of its own to some interior parameters of its camera, with an expectation and a standard error
(image-variant interior orientation: Tecklenburg, Luhmann and Hastedt 2001). What moves while the rows of a frame are read one after
another shifts them in proportion to their time: along the row it is a shear, across it a scale (Vautherin et al. 2016 adjust the
same motion). Exact for a scene at one distance; relief changes it by its share of the distance.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.camera import INTERIOR
from orthomill.tasks.adjustment.model.interior_settings import NoVariation, RollingShutter, Stabilised, Zoomed
from orthomill.tasks.adjustment.model.network import NO_VARIATION, Variation

TIGHT = 1e-6
"""Standard error of what ties the two parameters of a scale across rows together, relative to the parameters."""


KNOWN_SPEED, LEAST_SPEED = 0.3, 0.5
"""Standard error of a speed by positions and times: this share of it (EXIF rounds times to seconds), m/s at least."""


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """The photographs as a rolling shutter sees them: camera constants `c` (P,) px, `height` (P,) px of the frames, median `depth`
    (P,) m of their points, `velocity` (P, 3) m/s in the image systems (NaN: unknown)."""

    c: np.ndarray
    height: np.ndarray
    depth: np.ndarray
    velocity: np.ndarray


def variation_of(choice: NoVariation | Zoomed | Stabilised | RollingShutter, motion: FrameMotion) -> Variation:
    """What varies from photograph to photograph."""
    if choice.kind == "none":
        return NO_VARIATION
    if choice.kind == "zoom":
        return _independent(("c",), (choice.sigma * motion.c)[:, None])
    if choice.kind == "stabilised":
        return _independent(("x0", "y0"), np.full((len(motion.c), 2), choice.sigma))
    return _rolling_shutter(choice, motion)


def _numbers(names: tuple[str, ...]) -> np.ndarray:
    return np.array([INTERIOR.index(name) for name in names])


def _independent(names: tuple[str, ...], sigma: np.ndarray) -> Variation:
    return Variation(_numbers(names), np.zeros(sigma.shape), (1.0 / sigma**2)[:, :, None] * np.eye(len(names)))


def _rolling_shutter(choice: RollingShutter, motion: FrameMotion) -> Variation:
    """Shear and scale by the motion along the rows and across them, with the scale shared between c and the affinity."""
    c = motion.c
    known = np.isfinite(motion.velocity).all(axis=1)[:, None]
    speed = np.where(known, motion.velocity, 0.0)[:, :2]
    speed_sigma = np.where(known, np.maximum(KNOWN_SPEED * np.abs(speed), LEAST_SPEED), choice.speed_sigma)
    # The row at y above the middle is read readout * y / height before it: motion along x shears, motion along y scales.
    per_speed = (choice.readout * c / (motion.depth * motion.height))[:, None]
    per_turn = (choice.readout * c / motion.height)[:, None]
    shear, scale = (per_speed * speed).T
    sigma = np.hypot(per_speed * speed_sigma, per_turn * np.radians(choice.turning_sigma))
    # c (1 + scale) along y, and c along x by an affinity of -scale.
    expected = np.column_stack([c * scale, -scale, shear])
    weight = np.zeros((len(c), 3, 3))
    tie = 1.0 / TIGHT**2
    weight[:, 0, 0], weight[:, 0, 1], weight[:, 1, 0] = tie / c**2, tie / c, tie / c
    weight[:, 1, 1], weight[:, 2, 2] = tie + 1.0 / sigma[:, 1] ** 2, 1.0 / sigma[:, 0] ** 2
    return Variation(_numbers(("c", "affinity", "skew")), expected, weight)
