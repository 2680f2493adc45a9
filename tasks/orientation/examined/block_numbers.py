"""The numbers of the report of a block: accuracy at check points, ground pixel, standard errors, residuals."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.schemas.camera import INTERIOR, Camera
from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.orientation import Block, ExteriorOrientation, GroundResidual, JointTest
from orthomill.tasks.orientation.examined.block_facts import Facts, filled_areas


@dataclass(frozen=True)
class Accuracy:
    """Root mean square differences at the check points, m, and in units of their predicted standard errors."""

    points: int
    plan: float
    height: float
    by_predicted: float


def accuracy(points: tuple[GroundResidual, ...]) -> Accuracy | None:
    """The accuracy at check points; None without any."""
    if not points:
        return None
    difference, predicted = np.array([p.difference for p in points]), np.array([p.predicted for p in points])
    plan, height = np.sqrt((difference[:, :2] ** 2).sum(axis=1).mean()), np.sqrt((difference[:, 2] ** 2).mean())
    # The floor keeps points without redundancy (predicted 0, difference 0) finite.
    ratio = np.sqrt(((difference / np.maximum(predicted, 1e-9)) ** 2).mean())
    return Accuracy(len(points), float(plan), float(height), float(ratio))


RARE = 0.001
"""Chance of differences at check points below which the predicted standard errors do not hold"""
NOTICEABLE = 1.5
"""Differences must be this many times what is predicted to matter: with many points chance alone makes no tenth."""


def contradicts_precision(found: Accuracy, test: JointTest | None) -> bool:
    """Whether the differences at the check points are larger than the adjustment predicts by more than chance can make, all of them
    taken together with the errors that they share, and by so much that it matters."""
    return test is not None and test.chance < RARE and found.by_predicted > NOTICEABLE


ALONE = 4.0
"""Standard errors by which a check point contradicts a block that all others agree with"""


def wrong_alone(points: tuple[GroundResidual, ...], test: JointTest | None) -> tuple[GroundResidual, Accuracy] | None:
    """The one check point by which all of them contradict the block, with the accuracy at the others, which agree with it; None
    where there is no such point, or fewer than two others."""
    whole = accuracy(points)
    if whole is None or not contradicts_precision(whole, test):
        return None
    times = [accuracy((point,)) for point in points]
    found = [point for point, own in zip(points, times, strict=True) if own and own.by_predicted > ALONE]
    others = tuple(point for point in points if point not in found)
    rest = accuracy(others)
    if len(found) != 1 or len(others) < 2 or rest is None or rest.by_predicted > NOTICEABLE:
        return None
    return found[0], rest


def ground_pixel(facts: Facts) -> float | None:
    """Side of a photograph's pixel on the ground, m: the median over the block, below or before the projection centres."""
    if not len(facts.points) or not facts.block.photos:
        return None
    ground = np.array([np.median(facts.points.x), np.median(facts.points.y), np.median(facts.points.z)])
    distance = [min(np.linalg.norm(np.array(photo.centre) - ground), _height(photo.centre, ground)) for photo in facts.block.photos]
    constants = [facts.block.camera_of(photo.photo).c for photo in facts.block.photos]
    return float(np.median(np.array(distance) / np.array(constants)))


def _height(centre: tuple[float, float, float], ground: np.ndarray) -> float:
    # Far photographs of a long block are not farther from the ground: their height above it counts, unless they look sideways.
    above = centre[2] - ground[2]
    return float(above) if above > 0 else float("inf")


def point_sigmas(facts: Facts) -> tuple[float, float] | None:
    """Median standard errors of the tie points in plan and in height, m; None where none is known."""
    plan = np.hypot(facts.points.sigma_x, facts.points.sigma_y)
    known = np.isfinite(plan) & np.isfinite(facts.points.sigma_z)
    # A fixed block states no standard errors.
    return (float(np.median(plan[known])), float(np.median(facts.points.sigma_z[known]))) if known.any() else None


def exterior_sigmas(photo: ExteriorOrientation) -> np.ndarray:
    """(6,) standard errors of X, Y, Z in m and of omega, phi, kappa in degrees; NaN where they are not known."""
    if photo.covariance is None:
        return np.full(6, np.nan)
    return np.sqrt(np.diag(np.array(photo.covariance))) * np.repeat([1.0, np.degrees(1.0)], 3)


def _median(values: np.ndarray) -> float | None:
    """The median of the known values."""
    # A fixed block states no standard errors: its figure is empty, and not 0.
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None


def interior_sigmas(camera: Camera) -> list[float | None]:
    """Standard errors (8) of a camera in the order of INTERIOR; None for parameters that the block did not adjust."""
    if camera.source != "block" or camera.covariance is None:
        return [None] * len(INTERIOR)
    # A zero variance marks a parameter that was fixed, not one that is known exactly.
    return [float(np.sqrt(v)) if v > 0 else None for v in np.diag(np.array(camera.covariance))]


class MedianSigmas(NamedTuple):
    """Median standard errors in plan and in height, m; None where none is known."""

    plan: float | None
    height: float | None


def centre_sigmas(block: Block) -> MedianSigmas:
    """Of the projection centres."""
    centre = np.array([exterior_sigmas(photo)[:3] for photo in block.photos])
    return MedianSigmas(_median(np.hypot(centre[:, 0], centre[:, 1])), _median(centre[:, 2]))


def ground_sigmas(points: GroundPoints) -> MedianSigmas:
    """Of the tie points."""
    return MedianSigmas(_median(np.hypot(points.sigma_x, points.sigma_y)), _median(points.sigma_z))


def known_sigmas(photo: ExteriorOrientation) -> list[float | None]:
    """The standard errors of an exterior orientation (`exterior_sigmas`); None where they are not known."""
    return [float(v) if np.isfinite(v) else None for v in exterior_sigmas(photo)]


def interior_correlations(camera: Camera, free: list[int]) -> list[list[float]]:
    """Correlations of the parameters of a camera by their numbers in INTERIOR."""
    covariance = np.array(camera.covariance)[np.ix_(free, free)]
    scale = np.sqrt(np.diag(covariance))
    return (covariance / np.outer(scale, scale)).tolist()


class PhotoResidualNumbers(NamedTuple):
    """Of a photograph: measurements that took part and rejected ones, root mean square residuals along columns and rows and the
    largest residual (px; None without measurements), and areas of its frame with tie points."""

    used: int
    rejected: int
    rms_col: float | None
    rms_row: float | None
    largest: float | None
    areas: int


def photo_residual_numbers(facts: Facts, name: str) -> PhotoResidualNumbers:
    """Of a photograph by its name."""
    seen = facts.image.photo == facts.photos.names.index(name)
    own = facts.image.take(seen & facts.image.used)
    # float32 squares of many residuals would lose digits in their sum.
    rms = [float(np.sqrt((v.astype(float) ** 2).mean())) if len(v) else None for v in (own.v_col, own.v_row)]
    size = np.hypot(own.v_col, own.v_row)
    largest = float(size.max()) if len(size) else None
    areas = filled_areas(own, facts.block.camera_of(name))
    return PhotoResidualNumbers(len(own), int(seen.sum()) - len(own), rms[0], rms[1], largest, areas)


class FramedControl(NamedTuple):
    """The share of the block's frame that the control frames, and whether it lies on its northern and eastern side."""

    share: float
    north: bool
    east: bool


def framed_control(facts: Facts) -> FramedControl | None:
    """What the control frames; None of fewer than three control points or ten tie points."""
    control = np.array([point.xyz for point in facts.control.points if point.role == "control"]).reshape(-1, 3)[:, :2]
    ties = np.column_stack([facts.points.x, facts.points.y])
    if len(control) < 3 or len(ties) < 10:
        return None
    # Percentiles: a few wrong tie points far away do not make a block larger.
    low, high = np.percentile(ties, [2, 98], axis=0)
    inside = np.minimum(control.max(axis=0), high) - np.maximum(control.min(axis=0), low)
    share = float(np.prod(np.clip(inside, 0, None) / (high - low)))
    north, east = control[:, 1].mean() > ties[:, 1].mean(), control[:, 0].mean() > ties[:, 0].mean()
    return FramedControl(share, bool(north), bool(east))
