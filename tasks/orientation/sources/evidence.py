"""What the sources say, and the observation equations between it and the block.

Positions of one receiver share most of their errors: only how they scatter says how precise they are relative to each other, and
their stated standard error belongs to what they have in common. The same is true of attitudes, whose mounting is a constant, and of
an elevation model, whose heights are those of one survey.
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np

from orthomill.tasks.geometry.rotation_vector import motion_derivatives, vectors_of_rotations
from orthomill.tasks.orientation.sources.elevation_model import ElevationModel
from orthomill.tasks.orientation.sources.rigid_block import RigidBlock

COMPASS = 5.0
"""Directions of attitudes come from a compass, and are so many times less precise than their tilts."""

MOTION, COMMON, MOUNTING, SURVEY, FIRST_CAMERA = slice(0, 7), slice(7, 10), slice(10, 13), 13, 14
"""Columns of the parameters: motion of the block (shift, rotation, scale), common errors of positions, of attitudes and of an
elevation model, then the relative errors of the camera constants."""


class Source(IntEnum):
    """Kinds of observation equations."""

    PLAN = 0
    HEIGHT = 1
    CONTROL = 2
    ATTITUDE = 3
    MODEL = 4


SOURCES = tuple(Source)
"""all of them: to go through an enumeration takes longer than to go through its equations"""


@dataclass(frozen=True, eq=False)
class Told:
    """What sources say, local m: `position` and `position_sigma` (P, 3), `control` and `control_sigma` (n, 3), `attitude` (P, 3, 3)
    world to image with `attitude_sigma` (P,) rad of a photograph and `mounting_sigma` rad common to all; `constant` and
    `constant_sigma` (C,): by what share the camera constants that tags or calibrations give differ from those of the block; an
    elevation `model`, if there is one. NaN: unknown."""

    position: np.ndarray
    position_sigma: np.ndarray
    control: np.ndarray
    control_sigma: np.ndarray
    attitude: np.ndarray
    attitude_sigma: np.ndarray
    mounting_sigma: float
    constant: np.ndarray
    constant_sigma: np.ndarray
    model: ElevationModel | None = None

    @property
    def positioned(self) -> np.ndarray:
        """(P,) bool: photographs with a position."""
        return np.isfinite(self.position).all(axis=1)


@dataclass(frozen=True, eq=False)
class Equations:
    """Observation equations y = A x + v of the parameters (u,): `source` (m,), `photo` (m,) number of the photograph (-1: none),
    `axis` (m,) 0 to 2, `place` (m, 2) m in plan, `y` (m,), `A` (m, u), `sigma` (m,) stated; `expected`, `expected_sigma` (u,) of
    the parameters (inf: nothing is known)."""

    source: np.ndarray
    photo: np.ndarray
    axis: np.ndarray
    place: np.ndarray
    y: np.ndarray
    A: np.ndarray
    sigma: np.ndarray
    expected: np.ndarray
    expected_sigma: np.ndarray

    @cached_property
    def of_source(self) -> dict[Source, np.ndarray]:
        """The numbers of the equations of each source."""
        return {source: np.flatnonzero(self.source == source) for source in SOURCES}


def equations(block: RigidBlock, told: Told) -> Equations:
    """The equations of all sources for a block, linear in the parameters."""
    cameras = len(told.constant)
    parts = [_positions(block, told, cameras), _control(block, told, cameras), _attitudes(block, told, cameras)]
    parts += [_surface(block, told.model, cameras)] if told.model else []
    source, photo, axis, place, y, A, sigma = (np.concatenate([part[i] for part in parts]) for i in range(7))
    expected = np.concatenate([np.zeros(FIRST_CAMERA), told.constant])
    has = told.positioned
    common = np.median(told.position_sigma[has], axis=0) if has.any() else np.full(3, np.inf)
    mounting = told.mounting_sigma * np.array([1.0, 1.0, COMPASS])
    survey = [told.model.sigma if told.model else 1.0]
    expected_sigma = np.concatenate([np.full(7, np.inf), common, mounting, survey, told.constant_sigma])
    return Equations(
        source=source, photo=photo, axis=axis, place=place, y=y, A=A, sigma=sigma, expected=expected, expected_sigma=expected_sigma
    )


_Part = tuple[np.ndarray, ...]


def _positions(block: RigidBlock, told: Told, cameras: int) -> _Part:
    own = np.flatnonzero(told.positioned)
    A = np.zeros((len(own), 3, FIRST_CAMERA + cameras))
    A[:, :, MOTION] = motion_derivatives(block.centre[own] - block.middle)
    A[:, :, COMMON] = np.eye(3)
    A[np.arange(len(own)), :, FIRST_CAMERA + block.camera[own]] = block.backwards[own]
    y = told.position[own] - block.centre[own]
    return _rows(np.array([Source.PLAN, Source.PLAN, Source.HEIGHT]), own, block.centre[own], y, A, told.position_sigma[own])


def _control(block: RigidBlock, told: Told, cameras: int) -> _Part:
    own = np.flatnonzero(np.isfinite(block.control).all(axis=1) & np.isfinite(told.control).all(axis=1))
    A = np.zeros((len(own), 3, FIRST_CAMERA + cameras))
    A[:, :, MOTION] = motion_derivatives(block.control[own] - block.middle)
    y = told.control[own] - block.control[own]
    return _rows(np.full(3, Source.CONTROL), np.full(len(own), -1), block.control[own], y, A, told.control_sigma[own])


def _attitudes(block: RigidBlock, told: Told, cameras: int) -> _Part:
    own = np.flatnonzero(np.isfinite(told.attitude).all(axis=(1, 2)))
    A = np.zeros((len(own), 3, FIRST_CAMERA + cameras))
    A[:, :, 3:6] = np.eye(3)
    A[:, :, MOUNTING] = np.eye(3)
    # In the world: the rotation that takes the block to what the attitude says.
    turns = told.attitude[own].transpose(0, 2, 1) @ block.rotation[own]
    y = vectors_of_rotations(turns)
    sigma = told.attitude_sigma[own, None] * np.array([1.0, 1.0, COMPASS])
    return _rows(np.full(3, Source.ATTITUDE), own, block.centre[own], y, A, sigma)


def _surface(block: RigidBlock, model: ElevationModel, cameras: int) -> _Part:
    height, slope = model.at(block.ground)
    own = np.flatnonzero(np.isfinite(height))
    A = np.zeros((len(own), FIRST_CAMERA + cameras))
    moved = motion_derivatives(block.ground[own] - block.middle)
    # A block that moves up a slope meets higher ground there.
    A[:, MOTION] = moved[:, 2] - np.einsum("ni,nij->nj", slope[own], moved[:, :2])
    A[:, SURVEY] = 1.0
    y, none = height[own] - block.ground[own, 2], np.full(len(own), -1)
    sigma = np.full(len(own), model.sigma)
    return np.full(len(own), Source.MODEL), none, np.full(len(own), 2), block.ground[own, :2], y, A, sigma


def _rows(source: np.ndarray, photo: np.ndarray, place: np.ndarray, y: np.ndarray, A: np.ndarray, sigma: np.ndarray) -> _Part:
    """Equations of (k, 3) coordinates at places (k, 3) as rows."""
    count, rows = len(photo), A.reshape(3 * len(photo), A.shape[2])
    axis, plan = np.tile(np.arange(3), count), np.repeat(place[:, :2], 3, axis=0)
    return np.tile(source, count), np.repeat(photo, 3), axis, plan, y.ravel(), rows, sigma.ravel()
