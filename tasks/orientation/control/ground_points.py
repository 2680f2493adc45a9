"""Check and tie points against an adjusted block: intersected from their image measurements, with the precision that the adjustment
predicts."""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.tasks.adjustment.model.collinearity import photo_interiors, residuals
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import NO_DISTANCES, Network, Rays, State
from orthomill.tasks.adjustment.solve.normal_equations import point_corrections
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.adjustment.testing.covariances import distances_elsewhere, points_elsewhere
from orthomill.tasks.geometry.intersection import intersect_rays
from orthomill.tasks.orientation.measurements import ideal, with_interior

PARALLEL = 1e-12
"""of the weight across the rays: less along them is rounding"""


@dataclass(frozen=True, eq=False)
class ApproximatePoints:
    """Points (n, 3) in the system of a model, NaN for those with fewer than two rays; the angles `missed` (n,) rad by which their
    rays miss them; and the standard errors `blur` (n,) of a coordinate in units of the model, for marks that are good to 1 camera
    constant (NaN without a point)."""

    point: np.ndarray
    missed: np.ndarray
    blur: np.ndarray


@dataclass(frozen=True, eq=False)
class IntersectedGroundPoints:
    """`point` (n, 3) m, local (NaN: fewer than two rays), `covariance` (n, 3, 3) m^2 including that of the orientation, `residual`
    (m, 2) px."""

    point: np.ndarray
    covariance: np.ndarray
    residual: np.ndarray


def approximate_points(state: State, cameras: list[Camera], camera_of: np.ndarray, rays: Rays, count: int) -> ApproximatePoints:
    """The `count` points nearest to their rays."""
    points, missed, blur = np.full((count, 3), np.nan), np.zeros(count), np.full(count, np.nan)
    interior, _ = photo_interiors(state, camera_of)
    for number in range(count):
        own = np.flatnonzero(rays.point == number)
        if len(own) >= 2:
            photo = rays.photo[own]
            xy = np.vstack(
                [ideal(with_interior(cameras[camera_of[p]], interior[p]), rays.xy[[i]]) for i, p in zip(own, photo, strict=True)]
            )
            directions = np.einsum("ni,nij->nj", np.column_stack([xy, -np.ones(len(own))]), state.rotation[photo])
            length = np.linalg.norm(directions, axis=1)
            directions /= length[:, None]
            found, offset = intersect_rays(state.centre[photo][:, None], directions[:, None])
            points[number] = found[0]
            away = np.linalg.norm(found[0] - state.centre[photo], axis=1)
            # As an angle, because a distance in space says little for a model of any scale.
            missed[number] = offset[0] / away.mean()
            blur[number] = _blur(directions, away / length)
    return ApproximatePoints(points, missed, blur)


def _blur(directions: np.ndarray, depth: np.ndarray) -> float:
    """The standard error of a coordinate of the point on rays of these unit directions (m, 3), at these depths (m,) before their
    photographs, whose marks are good to 1 camera constant."""
    if not np.isfinite(depth).all():
        return np.nan
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    weight = np.linalg.eigvalsh((across / depth[:, None, None] ** 2).sum(axis=0))
    # Parallel rays, as those of two marks at one place of two photographs that stand still, determine no depth.
    return float(np.sqrt((1.0 / weight).mean())) if weight[0] > PARALLEL * weight[-1] else np.nan


def intersect_ground(result: Adjustment, start: np.ndarray, rays: Rays) -> IntersectedGroundPoints:
    """Least-squares intersection of points (n, 3) with the adjusted orientation fixed; points with NaN are left out."""
    placed = np.isfinite(start).all(axis=1)
    own = rays.take(placed[rays.point])
    state = replace(result.state, point=np.where(placed[:, None], start, 0.0))
    network = _without_points(result.network, len(start))
    # No corrections of the orientation: check points must not influence the block that they examine.
    nothing = np.zeros(network.unknowns)
    # Five Gauss-Newton steps from the point nearest to the rays in space, which is off by the residuals only.
    for _ in range(5):
        state = replace(state, point=state.point + point_corrections(linearised(network, state, own), nothing))
    covariance = points_elsewhere(linearised(network, state, own), result.cofactor)
    residual = np.full((len(rays), 2), np.nan)
    residual[placed[rays.point]] = residuals(state, own, network.camera_of)
    return IntersectedGroundPoints(np.where(placed[:, None], state.point, np.nan), covariance, residual)


def distance_variances_between(result: Adjustment, point: np.ndarray, rays: Rays, ends: np.ndarray) -> np.ndarray:
    """(d,) m^2 of the distances between intersected points (n, 3) by the numbers of their `ends` (d, 2)."""
    state, network = replace(result.state, point=point), _without_points(result.network, len(point))
    return distances_elsewhere(linearised(network, state, rays), result.cofactor, point, ends)


def _without_points(network: Network, count: int) -> Network:
    """The network with `count` unweighted points instead of its own: their rays alone determine them."""
    none = network.kept[:0]
    nothing = np.zeros((count, 3))
    return replace(network, point=nothing, point_weight=nothing, kept=none, named=none, distances=NO_DISTANCES)
