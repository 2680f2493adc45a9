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
from orthomill.tasks.adjustment.testing.covariances import distances_elsewhere, joint_elsewhere, points_elsewhere
from orthomill.tasks.geometry.intersection import intersect_rays
from orthomill.tasks.imagery.photograph_rows import rows_of_photos
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
    directions = _directions(state, cameras, camera_of, rays)
    length = np.linalg.norm(directions, axis=1)
    directions /= length[:, None]
    order, rays_of = np.argsort(rays.point, kind="stable"), np.bincount(rays.point, minlength=count)
    first = np.cumsum(rays_of) - rays_of
    # Points of equally many rays at once: lists are tried in thousands of ways.
    for seen in np.unique(rays_of[rays_of >= 2]):
        number = np.flatnonzero(rays_of == seen)
        own = order[first[number] + np.arange(seen)[:, None]]
        centre = state.centre[rays.photo[own]]
        found, offset = intersect_rays(centre, directions[own])
        away = np.linalg.norm(found - centre, axis=2)
        points[number] = found
        # As an angle, because a distance in space says little for a model of any scale.
        missed[number] = offset / away.mean(axis=0)
        blur[number] = _blur(directions[own], away / length[own])
    return ApproximatePoints(points, missed, blur)


def _directions(state: State, cameras: list[Camera], camera_of: np.ndarray, rays: Rays) -> np.ndarray:
    """(m, 3): the rays in the system of the model, 1 long along the axis of their photographs."""
    interior, _ = photo_interiors(state, camera_of)
    xy = np.empty_like(rays.xy)
    for photo, own in enumerate(rows_of_photos(rays.photo, len(camera_of))):
        if len(own):
            xy[own] = ideal(with_interior(cameras[camera_of[photo]], interior[photo]), rays.xy[own])
    return np.einsum("ni,nij->nj", np.column_stack([xy, -np.ones(len(xy))]), state.rotation[rays.photo])


def _blur(directions: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """(n,) standard errors of a coordinate of the points on rays of these unit directions (m, n, 3), at these depths (m, n) before
    their photographs, whose marks are good to 1 camera constant."""
    blur = np.full(depth.shape[1], np.nan)
    across = np.eye(3) - directions[..., :, None] * directions[..., None, :]
    finite = np.isfinite(depth).all(axis=0)
    weight = np.linalg.eigvalsh((across[:, finite] / depth[:, finite, None, None] ** 2).sum(axis=0))
    # Parallel rays, as those of two marks at one place of two photographs that stand still, determine no depth.
    sound = weight[:, 0] > PARALLEL * weight[:, -1]
    blur[np.flatnonzero(finite)[sound]] = np.sqrt((1.0 / weight[sound]).mean(axis=1))
    return blur


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


def joint_covariance(result: Adjustment, point: np.ndarray, rays: Rays, numbers: np.ndarray) -> np.ndarray:
    """Covariance (3k, 3k) m^2 of those with these `numbers` (k,) of intersected points (n, 3), including that of the orientation,
    which they share."""
    state, network = replace(result.state, point=point), _without_points(result.network, len(point))
    return joint_elsewhere(linearised(network, state, rays), result.cofactor, numbers)


def _without_points(network: Network, count: int) -> Network:
    """The network with `count` unweighted points instead of its own: their rays alone determine them."""
    none = network.kept[:0]
    nothing = np.zeros((count, 3))
    return replace(network, point=nothing, point_weight=nothing, kept=none, named=none, distances=NO_DISTANCES)
