"""From two homologous places in a pair of orthoimages to the true point: the deterministic correction of a surface model.

Strategy. An orthoimage made with a wrong height shows a point displaced from its true place, on the ray of its photograph. The
pixel A' of the left orthoimage shows what the left photograph sees through the ground point (A', height of the model there); the
same holds for A'' and the right one. Two constructions find the point where both rays meet:
- rays: the rigorous intersection of the two 3-D rays; their distance is a y-parallax, the test for wrong matches.
- plan: the published construction. The lines from the nadirs through A' and A'' intersect in plan, similar triangles give two
  heights, and their mean is taken. It is singular on the line through both nadirs and at the nadirs, so points with a flat or
  sharp angle, and points near a nadir, are refused.
Both are exact for errors of any size, as far as both places show the same point and are found. Norvelle's refinement, which they
replace, is here to be compared: dx H / B, where the point is thought to be, and orthoimages again.

Source: Skarlatos, PhD thesis, sections 3.4.2 and 3.4.3 (sources/surface_check.md#deterministic); sources/measured.md#check.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.geometry.intersection import intersect_rays


class RayCorrection(Settings):
    """Rigorous intersection of the two rays."""

    kind: Literal["rays"] = "rays"
    parallax: float = setting(0.5, "Greatest y-parallax of the rays; beyond it the match is wrong.", "orthoimage pixels", gt=0)


class PlanCorrection(Settings):
    """The published construction in plan, with its angle filter."""

    kind: Literal["plan"] = "plan"
    angle_low: float = setting(13.5, "Least angle of the two nadir lines at the point.", "degrees", ge=0, lt=90)
    angle_high: float = setting(166.5, "Greatest angle of the two nadir lines at the point.", "degrees", gt=90, le=180)
    nadir: float = setting(
        0.02,
        "Least distance from both nadirs, where one photograph contains no information on height, as a share of the flying height.",
        ge=0,
        lt=1,
    )


class NorvelleCorrection(Settings):
    """The iterative refinement that the others replace: dh = dx H / B at the place itself, then orthoimages again."""

    kind: Literal["norvelle"] = "norvelle"
    rounds: int = setting(4, "How often orthoimages are made and compared; every cell is corrected in each.", ge=1, le=12)
    parallax: float = setting(0.5, "Greatest shift across the base; beyond it the match is wrong.", "orthoimage pixels", gt=0)


Correction = Annotated[RayCorrection | PlanCorrection | NorvelleCorrection, Field(discriminator="kind")]


@dataclass(frozen=True)
class Centres:
    """Projection centres (3,) m of the left and the right photograph."""

    left: np.ndarray
    right: np.ndarray


@dataclass(frozen=True)
class CorrectedPoints:
    """Surface points derived from homologous points of two orthoimages."""

    points: np.ndarray
    """(N, 3) m, NaN where the lines do not intersect"""
    gap: np.ndarray
    """(N,) m: distance of the two rays, or difference of the two heights of the plan construction"""
    accepted: np.ndarray
    """(N,) bool: passed the geometric test"""


def correct(left: np.ndarray, right: np.ndarray, centres: Centres, correction: Correction, pixel: float) -> CorrectedPoints:
    """True points from homologous orthoimage points.

    left, right: (N, 3) m, places in either orthoimage with the height of the model there. pixel: of the orthoimages, m.
    """
    if correction.kind == "plan":
        return plan_intersection(left, right, centres, correction)
    if correction.kind == "norvelle":
        return norvelle(left, right, centres, correction.parallax * pixel)
    return ray_intersection(left, right, centres, correction.parallax * pixel)


def ray_intersection(left: np.ndarray, right: np.ndarray, centres: Centres, limit: float = np.inf) -> CorrectedPoints:
    """Intersection of the rays through left, right (N, 3) m; refused where the rays pass each other at more than `limit` m."""
    rays = np.stack([left - centres.left, right - centres.right])
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    origins = np.broadcast_to(np.stack([centres.left, centres.right])[:, None], rays.shape)
    # NaN would spread through the solution of the whole batch
    known = np.isfinite(rays).all(axis=(0, 2))
    points, gap = np.full((len(left), 3), np.nan), np.full(len(left), np.nan)
    points[known], distance = intersect_rays(origins[:, known], rays[:, known])
    # the intersection reports the distance of its point from either ray, which is half the gap between them
    gap[known] = 2.0 * distance
    return CorrectedPoints(points, gap, gap <= limit)


def plan_intersection(left: np.ndarray, right: np.ndarray, centres: Centres, settings: PlanCorrection) -> CorrectedPoints:
    """The plan construction; refused where the angle nadir-point-nadir is outside the limits (singular on the base line)."""
    d1, d2 = (left - centres.left)[:, :2], (right - centres.right)[:, :2]
    base = (centres.right - centres.left)[:2]
    # eq. 3.14 and 3.15: lines N + s d in plan; a point scaled by s along its line is (1 - s) of the depth higher
    with np.errstate(divide="ignore", invalid="ignore"):
        denominator = _cross(d1, d2)
        s, u = _cross(base, d2) / denominator, _cross(base, d1) / denominator
        plan = centres.left[:2] + s[:, None] * d1
        from_left = left[:, 2] + (centres.left[2] - left[:, 2]) * (1 - s)
        from_right = right[:, 2] + (centres.right[2] - right[:, 2]) * (1 - u)
        # the angle of the published filter: near 0 and 180 degrees the two lines in plan are almost parallel
        angle = nadir_angle(plan, centres)
        off = np.minimum(_off_nadir(left, centres.left), _off_nadir(right, centres.right))
        accepted = (angle >= settings.angle_low) & (angle <= settings.angle_high) & (off >= settings.nadir)
    return CorrectedPoints(np.column_stack([plan, (from_left + from_right) / 2]), np.abs(from_left - from_right), accepted)


def norvelle(left: np.ndarray, right: np.ndarray, centres: Centres, limit: float = np.inf) -> CorrectedPoints:
    """Norvelle's correction: the distance of the two places along the base times height over base, at the left place; refused where
    they lie more than `limit` m apart across it."""
    base = (centres.right - centres.left)[:2]
    length = float(np.linalg.norm(base))
    moved, along = (right - left)[:, :2], base / length
    depth = (centres.left[2] + centres.right[2]) / 2 - left[:, 2]
    # A point above the model is seen beyond its place by either photograph: the right place then lies towards the left nadir.
    height = left[:, 2] - moved @ along * depth / length
    gap = np.abs(moved @ np.array([-along[1], along[0]]))
    return CorrectedPoints(np.column_stack([left[:, :2], height]), gap, gap <= limit)


def nadir_angle(plan: np.ndarray, centres: Centres) -> np.ndarray:
    """Angle (N,) in degrees at plan points (N, 2) between the directions to the two nadirs."""
    to_left, to_right = centres.left[:2] - plan, centres.right[:2] - plan
    return np.degrees(np.arctan2(np.abs(_cross(to_left, to_right)), (to_left * to_right).sum(axis=1)))


def _off_nadir(points: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Distance (N,) of points (N, 3) from the nadir as a share of their depth."""
    return np.hypot(*(points - centre)[:, :2].T) / (centre[2] - points[:, 2])


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
