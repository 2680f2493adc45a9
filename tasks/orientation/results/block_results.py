"""The tables of an adjusted block, in the project's CRS: orientations, cameras, points, residuals.

Covariances between photographs, and between photographs and cameras, are kept: an error of the datum that moves two photographs
alike is no error between them, and later stages must not add it twice.
"""

from itertools import combinations

import numpy as np

from orthomill.schemas.observations import Control, GroundPoints, ImageResiduals
from orthomill.schemas.orientation import Block, ExteriorOrientation, JointCovariance, Unoriented
from orthomill.tasks.adjustment.model.collinearity import residuals
from orthomill.tasks.adjustment.model.network import Rays
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.geometry.rotation import angles
from orthomill.tasks.geometry.rotation_vector import angles_from_vector
from orthomill.tasks.orientation.block.assembly import BlockResults, Problem
from orthomill.tasks.orientation.results.block_cameras import (
    BlockCamera,
    are_related,
    block_cameras,
    camera_tables,
    joint_cameras,
    rows_of,
    with_photograph,
)
from orthomill.tasks.orientation.start.georeference import Datum


def rays_used(problem: Problem, result: Adjustment) -> np.ndarray:
    """(M,) bool: which rays of the problem took part in the final adjustment."""
    used = np.zeros(len(problem.rays), bool)
    used[_positions_of(problem.rays, result.rays)] = result.used
    return used


def _positions_of(rays: Rays, part: Rays) -> np.ndarray:
    """The places of the rays of `part` in `rays`, which are sorted by point, then photograph."""
    # A photograph measures a point once, so that point and photograph together are a key.
    photos = int(rays.photo.max(initial=0)) + 1
    return np.searchsorted(rays.point.astype(np.int64) * photos + rays.photo, part.point.astype(np.int64) * photos + part.photo)


def block_table(crs: str, results: BlockResults, unoriented: tuple[Unoriented, ...]) -> Block:
    """The block as later stages read it, in the project's system `crs` unless it has no place there."""
    problem, result, datum = results.problem, results.result, results.datum
    tie = np.unique(result.rays.point[result.used & (result.rays.point < problem.ties)])
    # Percentiles, for a single wrong match may lie kilometres away, and later stages search heights in this range.
    cameras, related = block_cameras(results), _sharing(result)
    low, high = np.percentile(result.state.point[tie, 2], [0.5, 99.5]) + datum.origin[2]
    return Block(
        crs=datum.system or crs,
        cameras=camera_tables(result, cameras),
        of_photo={name: camera.name for i, name in enumerate(problem.names) for camera in cameras if i in camera.photos},
        photos=tuple(
            _exterior(problem, result, datum, i, [own for own in cameras if _counts(own, i, related)])
            for i in range(len(problem.names))
        ),
        unoriented=unoriented,
        datum=datum.sentence,
        sigma0_px=result.sigma0_px,
        redundancy=result.redundancy,
        iterations=result.iterations,
        ground_low=float(low),
        ground_high=float(high),
        joint=_joint(problem, result, related),
        joint_cameras=joint_cameras(result, cameras, related),
        groups=problem.groups,
    )


def _sharing(result: Adjustment) -> set[tuple[int, int]]:
    """The pairs of photographs, ascending, that share a used tie point."""
    return {(a, b) for own in _photos_of_points(result) for a, b in combinations(own, 2)}


def _counts(camera: BlockCamera, photo: int, related: set[tuple[int, int]]) -> bool:
    """Whether the covariance of a photograph with a camera is kept."""
    return camera.adjusted and (len(camera.parts) == 1 or are_related(camera.photos, (photo,), related))


def _joint(problem: Problem, result: Adjustment, shared: set[tuple[int, int]]) -> tuple[JointCovariance, ...]:
    """The covariance between the photographs of every pair that shares a used tie point."""
    turns = [_to_angles(result.state.rotation[photo]) for photo in range(len(problem.names))]
    found = []
    # Other pairs are never intersected by a later stage; all pairs would be quadratic in the number of photographs.
    for a, b in sorted(shared):
        both = np.concatenate([6 * a + np.arange(6), 6 * b + np.arange(6)])
        covariance = turns[a] @ result.cofactor.joint(both)[:6, 6:] @ turns[b].T
        found.append(JointCovariance(first=problem.names[a], second=problem.names[b], covariance=rows_of(covariance)))
    return tuple(found)


def _photos_of_points(result: Adjustment) -> set[tuple[int, ...]]:
    """The different sets of photographs, ascending, that see a point together."""
    point, photo = result.rays.point[result.used], result.rays.photo[result.used]
    order = np.lexsort((photo, point))
    # Sets and not points: thousands of points are seen by the same few photographs.
    starts = np.flatnonzero(np.diff(point[order], prepend=-1))
    return {tuple(map(int, own)) for own in np.split(photo[order], starts[1:])}


def _to_angles(rotation: np.ndarray) -> np.ndarray:
    """(6, 6): from the unknowns of the adjustment (centre, small rotation vector) to X, Y, Z, omega, phi, kappa."""
    turned = np.eye(6)
    turned[3:, 3:] = angles_from_vector(rotation)
    return turned


def _exterior(problem: Problem, result: Adjustment, datum: Datum, photo: int, cameras: list[BlockCamera]) -> ExteriorOrientation:
    R = result.state.rotation[photo]
    to_angles = _to_angles(R)
    covariance = to_angles @ result.exterior_covariance(photo) @ to_angles.T
    own = result.used & (result.rays.photo == photo)
    return ExteriorOrientation(
        photo=problem.names[photo],
        centre=tuple(map(float, result.state.centre[photo] + datum.origin)),
        omega_phi_kappa=tuple(float(v) for v in np.degrees(angles(R))),
        # Rounding leaves it a little asymmetric, which factorisations of later stages do not forgive.
        covariance=rows_of(0.5 * (covariance + covariance.T)),
        observations=int(own.sum()),
        residual_px=float(np.sqrt((result.residual[own] ** 2).mean())) if own.any() else None,
        with_interior={camera.name: rows_of(to_angles @ with_photograph(result, photo, camera)) for camera in cameras},
    )


def ground_points(results: BlockResults, tracks: np.ndarray) -> GroundPoints:
    """The tie points with two rays or more."""
    problem, result, datum = results.problem, results.result, results.datum
    rays, square = result.rays, (result.residual**2).mean(axis=1)
    count = np.bincount(rays.point[result.used], minlength=len(result.state.point))[: problem.ties]
    total = np.bincount(rays.point[result.used], square[result.used], minlength=len(result.state.point))[: problem.ties]
    # After rejection a point may have one ray left, whose depth nothing determines.
    keep = np.flatnonzero(count >= 2)
    x, y, z = (result.state.point[keep] + datum.origin).T
    sigma_x, sigma_y, sigma_z = np.sqrt(np.diagonal(result.point_covariance[keep], axis1=1, axis2=2)).astype(np.float32).T
    return GroundPoints(
        track=tracks[keep].astype(np.int32),
        x=x,
        y=y,
        z=z,
        sigma_x=sigma_x,
        sigma_y=sigma_y,
        sigma_z=sigma_z,
        rays=count[keep].astype(np.int16),
        residual=np.sqrt(total[keep] / count[keep]).astype(np.float32),
    )


def image_residuals(results: BlockResults, tracks: np.ndarray, control: Control) -> ImageResiduals:
    """All measurements in the photographs of the block, used or not."""
    problem, result = results.problem, results.result
    rays, used = problem.rays, rays_used(problem, result)
    # Rejected rays have no standardised residual: they did not take part in the adjustment it refers to.
    standardised = np.full(len(rays), np.nan)
    standardised[_positions_of(rays, result.rays)] = np.abs(result.standardised).max(axis=1)
    # Rows count downwards, image coordinates upwards.
    v = -residuals(result.state, rays, problem.camera_of) * [1.0, -1.0]
    place = {point.name: i for i, point in enumerate(control.points)}
    # Surveyed points have negative numbers, by their places in the table of control: tracks count from 0.
    ground = np.array([-1 - place[point.name] for point in problem.surveyed], np.int64)
    track = np.concatenate([tracks, ground])[rays.point]
    size = np.array([(problem.cameras[k].width, problem.cameras[k].height) for k in problem.camera_of])[rays.photo]
    order = np.argsort(track, kind="stable")
    return ImageResiduals(
        track=track.astype(np.int32),
        photo=problem.active[rays.photo].astype(np.int32),
        col=rays.xy[:, 0] + (size[:, 0] - 1) / 2,
        row=(size[:, 1] - 1) / 2 - rays.xy[:, 1],
        v_col=v[:, 0].astype(np.float32),
        v_row=v[:, 1].astype(np.float32),
        standardised=standardised.astype(np.float32),
        used=used,
    ).take(order)
