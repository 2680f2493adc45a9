"""Rigid blocks with what sources say of them, for tests: planted causes, and sound ones."""

from dataclasses import replace

import numpy as np

from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.sources.causes import Groups
from orthomill.tasks.orientation.sources.evidence import Told
from orthomill.tasks.orientation.sources.rigid_block import RigidBlock

HEIGHT, CONSTANT = 60.0, 2000.0
GROUND = 150.0
"""m: flying height above the ground, and height of the ground; the camera constant, px"""


def flight(
    seed, strips=4, per_strip=6, gnss=(3.0, 3.0, 5.0), common=None, control=0, control_sigma=0.03, attitudes=True, share=0.02
):
    """A nadir flight in `strips`: positions with a common error (`common` m, as stated unless given) and their own scatter, control
    on uneven ground, attitudes of a gimbal whose mounting is off by half a degree; a camera constant known to a `share`."""
    rng = np.random.default_rng(seed)
    photos = strips * per_strip
    i = np.arange(photos)
    along = np.where((i // per_strip) % 2 == 0, i % per_strip, per_strip - 1 - i % per_strip)
    centre = np.column_stack([12.0 * along, 20.0 * (i // per_strip), np.full(photos, GROUND + HEIGHT)]) + rng.normal(
        0, 0.5, (photos, 3)
    )
    rotation = np.array([rotation_matrix(*np.radians([*rng.normal(0, 1.5, 2), 180.0 * ((k // per_strip) % 2)])) for k in i])
    points = np.column_stack(
        [rng.uniform(0, 60, control), rng.uniform(0, 20.0 * strips, control), GROUND + rng.normal(0, 4, control)]
    )
    sigma = np.array(gnss)
    same = rng.normal(0, 1, 3) * (sigma if common is None else common)
    mounting = rng.normal(0, np.radians(0.5), 3) * [1, 1, 5]
    small = [rng.normal(0, np.radians(0.5), 3) + mounting for _ in i]
    attitude = np.array([R @ rotation_matrix(*turn).T for R, turn in zip(rotation, small, strict=True)])
    told = Told(
        position=centre + same + rng.normal(0, 1, (photos, 3)) * sigma,
        position_sigma=np.tile(sigma, (photos, 1)),
        control=points + rng.normal(0, control_sigma, (control, 3)),
        control_sigma=np.full((control, 3), control_sigma),
        attitude=attitude if attitudes else np.full_like(attitude, np.nan),
        attitude_sigma=np.full(photos, np.radians(1.0)),
        mounting_sigma=float(np.radians(0.5)),
        constant=rng.normal(0, share, 1),
        constant_sigma=np.array([share]),
    )
    block = RigidBlock(centre, rotation, np.full(photos, HEIGHT), np.zeros(photos, int), points, HEIGHT / CONSTANT)
    return block, told, Groups(np.zeros(photos, int), i)


def raised(told, photos, by):
    """The positions of `photos` (P,) bool raised by m (a number: in height; three numbers)."""
    shift = np.array([0.0, 0.0, by]) if np.isscalar(by) else np.array(by)
    return replace(told, position=told.position + np.where(photos[:, None], shift, 0.0))
