"""Relative orientation of two photographs by the mixed model, as published and for any geometry.

`DependentOrientation` is the published form: left photograph fixed, b_x = 1, unknowns b_y, b_z, omega, phi, kappa, zero starting
values, one rejection at a time. It suits near-vertical pairs whose base lies along x. `GeneralOrientation` keeps the base as a unit
vector and the rotation as a matrix, both corrected on their manifolds; with a robust start from five-point samples it suits every
pair, also where most matches are wrong.

Image coordinates are ideal (no distortion), px, origin at the principal point, y up, as rows (x_left, y_left, x_right, y_right).
Source: Karfis 2009, sections 3.3 and 3.4 (sources/epipolar.md#relative-orientation, #rejection); Nister 2004 for the
five-point start.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.solve.mixed_model import MixedSolution, solve_mixed
from orthomill.tasks.geometry.intersection import intersect_rays
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector
from orthomill.tasks.orientation.relative.relative_forms import (
    DependentOrientation,
    coplanarity,
    directions,
    products,
    products_with,
)

LIMIT = 3.29
"""Matches farther from their epipolar line, in standard errors, are rejected: 0.1 % of correct ones with normal errors."""
_NEARLY = 1e-6
"""rad: corrections below this move no epipolar line by more than a hundredth of a pixel, so the matches that agree are decided."""
TELLING = 100
"""Matches, out of those that agree with an essential matrix, that decide which of its four orientations has them in front."""
FLIP = np.diag([1.0, -1.0, -1.0])
"""Between our image system (y up, looking along -z) and computer vision's (y down, looking along z)."""


@dataclass(frozen=True, eq=False)
class GeneralOrientation:
    """Unit base (3,) and rotation (3, 3) left to right. Unknowns, radians: two small rotations of the base across itself, and a
    rotation vector."""

    c_left: float
    c_right: float
    base: np.ndarray
    rotation: np.ndarray

    @cached_property
    def across(self) -> np.ndarray:
        """(2, 3): two unit vectors perpendicular to the base."""
        # The null space from an SVD exists for every base; vector products with a coordinate axis fail for one of them.
        return np.linalg.svd(self.base[None])[2][1:]

    def moved(self, correction: np.ndarray) -> "GeneralOrientation":
        """The orientation after a correction (5,), rad: base turned across itself, rotation turned by a vector."""
        base = self.base + correction[:2] @ self.across
        rotation = rotation_of_vector(correction[2:]) @ self.rotation
        return replace(self, base=base / np.linalg.norm(base), rotation=rotation)

    def evaluate(self, observations: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The coplanarity of base and both rays, its derivatives by the unknowns (s, 5) and the observations (s, 4)."""
        left, right = directions(observations, self.c_left, self.c_right)
        F, by_observation, by_turned = coplanarity(left, right, self.base, self.rotation)
        turned = right @ self.rotation
        by_base = [(products_with(turned, axis) * left).sum(axis=1) for axis in self.across]
        by_rotation = products(by_turned @ self.rotation.T, right)
        return F, np.column_stack([*by_base, by_rotation]), by_observation


@dataclass(frozen=True, eq=False)
class Relative:
    """A relative orientation with the matches (s,) that it kept."""

    solution: MixedSolution
    kept: np.ndarray


def orient_dependent(observations: np.ndarray, c_left: float, c_right: float, limit: float = 2.67) -> Relative:
    """The published procedure: zero starting values, then the match with the largest y residual beyond `limit` sigma0 is rejected,
    one at a time.

    It fails with many blunders: 118 wrong matches in 154 inflate sigma0 until none exceeds the limit. `orient_robust` does not.
    Raises GeometryError as `solve_mixed`. Source: Karfis 2009, section 3.4 (sources/epipolar.md#rejection), checks 8, 9 and 11.
    """
    kept = np.ones(len(observations), bool)
    model = DependentOrientation(c_left, c_right)
    while True:
        solution = solve_mixed(model, observations[kept])
        parallax = np.abs(solution.residuals[:, (1, 3)]).max(axis=1)
        if not solution.redundancy or parallax.max() <= limit * solution.sigma0:
            return Relative(solution, kept)
        kept[np.flatnonzero(kept)[parallax.argmax()]] = False
        model = solution.model


def orient_robust(observations: np.ndarray, c_left: float, c_right: float, expected: float = 1.0, seed: int = 7) -> Relative:
    """Relative orientation for any geometry, even with most matches wrong.

    A seeded five-point search (threshold three times `expected`, the standard error of a coordinate in px), then the mixed model on
    those matches whose distance from their epipolar lines is within LIMIT standard errors, until the set no longer changes.
    Raises GeometryError.
    """
    model, kept = _five_point_start(observations, c_left, c_right, 3.0 * expected, seed)
    # The set of kept matches usually repeats after three rounds; it may alternate by single matches, so rounds are limited.
    for _ in range(10):
        solution = solve_mixed(model, observations[kept], limit=_NEARLY)
        model = solution.model
        distance = epipolar_distance(model, observations)
        # Bounded on both sides: exact matches would leave a unit of zero and reject each other, and a set of wrong matches would
        # widen it until everything fits.
        unit = min(max(_unit(solution, distance[kept]), 0.02 * expected), 1.5 * expected)
        fresh = (distance < LIMIT * unit) & in_front(model, observations)
        if (fresh == kept).all() or fresh.sum() < 6:
            break
        kept = fresh
    return Relative(solve_mixed(model, observations[kept], limit=1e-10), kept)


def _unit(solution: MixedSolution, distance: np.ndarray) -> float:
    """Standard error of the distances from the epipolar lines: from their median, because wrong matches are among them, corrected
    for the degrees of freedom of the orientation."""
    share = solution.redundancy / max(len(distance), 1)
    return 1.4826 * float(np.median(distance)) / np.sqrt(max(share, 0.1))


def _five_point_start(
    observations: np.ndarray, c_left: float, c_right: float, threshold: float, seed: int
) -> tuple[GeneralOrientation, np.ndarray]:
    if len(observations) < 6:
        raise GeometryError(f"{len(observations)} matches are too few for a relative orientation; at least 6 are needed.")
    left = np.ascontiguousarray(observations[:, :2] / c_left * [1, -1])
    right = np.ascontiguousarray(observations[:, 2:] / c_right * [1, -1])
    # OpenCV samples from a generator of the thread: without the seed results depend on what ran before.
    cv2.setRNGSeed(seed)
    essential, mask = cv2.findEssentialMat(
        left, right, np.eye(3), method=cv2.RANSAC, prob=0.99999, threshold=threshold / (0.5 * (c_left + c_right)), maxIters=10000
    )
    if essential is None or essential.shape[0] < 3 or mask.sum() < 6:
        raise GeometryError(
            "No relative orientation agrees with six or more of the matches; they are wrong, or the photographs do not overlap."
        )
    # Several solutions come stacked. The first one is taken; recoverPose picks its base and rotation with points in front of both.
    # It intersects all points four times, where a few tell as much.
    own = np.flatnonzero(mask)[:: max(1, int(mask.sum()) // TELLING)]
    _, R, t, _ = cv2.recoverPose(essential[:3], left[own], right[own], np.eye(3))
    rotation = FLIP @ R @ FLIP
    base = -rotation.T @ FLIP @ t[:, 0]
    model = GeneralOrientation(c_left, c_right, base / np.linalg.norm(base), rotation)
    return model, mask.ravel() > 0


def epipolar_distance(model: DependentOrientation | GeneralOrientation, observations: np.ndarray) -> np.ndarray:
    """(s,) px: the length of the smallest correction of the four coordinates that fulfils the coplanarity condition (Sampson's
    distance)."""
    F, _, B = model.evaluate(observations)
    return np.abs(F) / np.sqrt((B**2).sum(axis=1))


def model_points(model: DependentOrientation | GeneralOrientation, observations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (s, 3) in the left image system for a base of length 1, and the angles (s,) rad at which their rays intersect."""
    left, right = directions(observations, model.c_left, model.c_right)
    rays = np.stack([left, right @ model.rotation])
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    centres = np.zeros_like(rays)
    centres[1] = model.base
    return intersect_rays(centres, rays)[0], np.arccos(np.clip((rays[0] * rays[1]).sum(axis=1), -1.0, 1.0))


def in_front(model: DependentOrientation | GeneralOrientation, observations: np.ndarray) -> np.ndarray:
    """(s,) bool: the rays intersect in front of both cameras."""
    points, _ = model_points(model, observations)
    with np.errstate(invalid="ignore"):
        return (points[:, 2] < 0) & (((points - model.base) @ model.rotation.T)[:, 2] < 0)
