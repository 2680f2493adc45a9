"""A block that another program has oriented: taken as it is, put into the project's system, and examined with the own tie points.

The orientation is held. Tie points, where the workflow finds them, are intersected with it: their residuals tell how well the
orientation fits measurements that had no part in it. Control and check points are compared alike.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.observations import Control, GroundPoints, ImageResiduals, TiePoints
from orthomill.schemas.orientation import Block, BlockPrecision, ExteriorOrientation, GroundResidual, GroundResiduals, Unoriented
from orthomill.schemas.photo import Photos
from orthomill.tasks.geometry.fixed_intersection import FixedIntersection, Measured, intersect_fixed
from orthomill.tasks.geometry.rotation import angles
from orthomill.tasks.geometry.view import View
from orthomill.tasks.orientation.exterior.fixed_block_warnings import elsewhere, rays_that_do_not_meet, unexamined, unfitting
from orthomill.tasks.orientation.exterior.sources import HeldSource, read_foreign
from orthomill.tasks.orientation.interchange.foreign_block import ForeignBlock, ForeignPose, upright_block
from orthomill.tasks.orientation.start.similarity import Upward, fit_similarity

_REJECTED = 5.0
"""Tie points with a residual of more spreads are taken for wrong matches and not for a wrong orientation."""


@dataclass(frozen=True, eq=False)
class Held:
    """The placed block: views in the order of the photographs, their poses, the program's points, and what there is to say."""

    views: list[View]
    poses: dict[str, ForeignPose]
    points: np.ndarray
    error_px: float | None
    datum: str
    weaknesses: tuple[str, ...]


def hold_block(
    photos: Photos,
    cameras: Cameras,
    control: Control,
    texts: tuple[str, ...],
    source: HeldSource,
    crs: str,
    tie_points: TiePoints | None = None,
) -> dict[str, object]:
    """The tables of the stage from a foreign block; `texts`: the files of `source`.

    Raises WorkflowError for the files, GeometryError when nothing tells the ground's height.
    """
    held = placed(upright_block(read_foreign(texts, source, crs), photos), photos, cameras, source)
    measured, tracks = _measurements(photos, held.views, tie_points)
    ties, used = _intersected(held.views, measured, len(tracks))
    factor, positions = _factor(ties, measured, used), _positions(photos, held.views)
    block = _block(photos, held, ties, used, crs, source)
    doubts = (*elsewhere(positions, source.described), *unfitting(block.sigma0_px, factor, source.described))
    if tie_points is None:
        doubts += (unexamined(source.described),)
    return {
        "block": block,
        "points": _ground_points(ties, measured, used, tracks, factor),
        "image_residuals": _image_residuals(photos, held.views, ties, measured, used, tracks),
        "ground_residuals": GroundResiduals(points=(*_ground(held.views, control), *positions)),
        "precision": BlockPrecision(
            image_factor=factor, position_factor=1.0, control_factor=1.0, rays=int(used.sum()), rejected=int((~used).sum()),
            weaknesses=(*doubts, *held.weaknesses),
        ),
    }  # fmt: skip


def placed(block: ForeignBlock, photos: Photos, cameras: Cameras, source: HeldSource) -> Held:
    """The block in the project's system: as its coordinates say, or fitted to the positions of its photographs."""
    sentence = f"Held: the exterior orientation of {len(block.poses)} photographs was read from {source.described} and not adjusted"
    weaknesses = list(block.remarks)
    if source.placed == "positions":
        block, fitted = _fitted(block, photos)
        sentence += fitted
    names = [name for name in photos.names if name in block.poses]
    own = {name: block.cameras.get(name) or cameras.of(name) for name in names}
    views = [View(name, own[name], block.poses[name].rotation, block.poses[name].centre) for name in names]
    return Held(views, block.poses, block.points, block.error_px, sentence + ".", tuple(weaknesses))


def _fitted(block: ForeignBlock, photos: Photos) -> tuple[ForeignBlock, str]:
    known = [photo for photo in photos.photos if photo.name in block.poses and photo.position is not None]
    if len(known) < 3:
        raise GeometryError(
            f"The block to be read is to be placed by the positions of its photographs, but only {len(known)} of them have one; "
            "three are needed. Give positions, or say that its coordinates are those of the project (placed: project)."
        )
    model = np.array([block.poses[photo.name].centre for photo in known])
    target = np.array([photo.position for photo in known])
    sigma = np.array([np.sqrt(np.mean(np.square(photo.position_sigma or (1.0,) * 3))) for photo in known])
    origin, mean = np.round(target.mean(axis=0)), model.mean(axis=0)
    spread = np.linalg.svd(target - target.mean(axis=0), compute_uv=False)
    up = np.mean([pose.rotation[2] for pose in block.poses.values()], axis=0)
    upward = Upward(up / np.linalg.norm(up), 1.0 / np.radians(5.0) ** 2 if spread[1] < 0.05 * spread[0] else 0.0)
    fit = fit_similarity(model - mean, target - origin, sigma, upward)
    poses = {
        name: ForeignPose(pose.rotation @ fit.rotation.T, fit.apply(pose.centre - mean) + origin)
        for name, pose in block.poses.items()
    }
    points = fit.apply(block.points - mean) + origin
    return replace(block, poses=poses, points=points), f"; it was placed by {len(known)} positions of its photographs"


def _measurements(photos: Photos, views: list[View], ties: TiePoints | None) -> tuple[Measured, np.ndarray]:
    """Tie points in the oriented photographs, points numbered from 0, and the track of each point."""
    if ties is None:
        return Measured(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2)), np.zeros(0)), np.zeros(0, int)
    number = np.full(len(photos.names), -1)
    number[[photos.names.index(view.name) for view in views]] = np.arange(len(views))
    own = ties.take(number[ties.photo] >= 0)
    _, inverse, rays = np.unique(own.track, return_inverse=True, return_counts=True)
    own = own.take(rays[inverse.ravel()] >= 2)
    tracks, point = np.unique(own.track, return_inverse=True)
    pixels = np.column_stack([own.col, own.row])
    return Measured(point.ravel(), number[own.photo], pixels, np.maximum(own.sigma.astype(float), 1e-3)), tracks


def _intersected(views: list[View], measured: Measured, count: int) -> tuple[FixedIntersection, np.ndarray]:
    """All tie points, and (M,) which measurements took part in the second, final intersection."""
    if not count:
        return FixedIntersection(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 2))), np.zeros(0, bool)
    first = intersect_fixed(views, measured, count)
    size = np.linalg.norm(first.residual, axis=1) / measured.sigma
    usual = float(np.nanmedian(size)) if np.isfinite(size).any() else np.inf
    limit = _REJECTED * max(1.0, usual / 1.18)
    used = np.nan_to_num(size, nan=np.inf) < limit
    used &= np.bincount(measured.point[used], minlength=count)[measured.point] >= 2
    final = intersect_fixed(views, measured.take(used), count)
    residual = first.residual.copy()
    residual[used] = final.residual
    return replace(final, residual=residual), used


def _factor(ties: FixedIntersection, measured: Measured, used: np.ndarray) -> float:
    """Estimated by stated standard error of the tie points; 1 without any."""
    redundancy = 2 * int(used.sum()) - 3 * len(np.unique(measured.point[used]))
    if redundancy <= 0:
        return 1.0
    size = ties.residual[used] / measured.sigma[used, None]
    return float(np.sqrt(np.nansum(size**2) / redundancy))


def _block(photos: Photos, held: Held, ties: FixedIntersection, used: np.ndarray, crs: str, source: HeldSource) -> Block:
    low, high = _heights(ties, held, source)
    cameras: dict[str, Camera] = {view.camera.name: view.camera for view in held.views}
    names = {view.name for view in held.views}
    reason = "{} is not in the block that was read from {}."
    return Block(
        crs=crs,
        cameras=cameras,
        of_photo={view.name: view.camera.name for view in held.views},
        photos=tuple(_exterior(view, held.poses[view.name]) for view in held.views),
        unoriented=tuple(Unoriented(photo=n, reason=reason.format(n, source.described)) for n in photos.names if n not in names),
        datum=held.datum,
        sigma0_px=float(np.sqrt(np.nanmean(ties.residual[used] ** 2))) if used.any() else held.error_px or 1.0,
        redundancy=max(2 * int(used.sum()) - 3 * int(np.isfinite(ties.points[:, 0]).sum()), 0),
        iterations=0,
        ground_low=low,
        ground_high=high,
    )


def _heights(ties: FixedIntersection, held: Held, source: HeldSource) -> tuple[float, float]:
    z = ties.points[np.isfinite(ties.points).all(axis=1), 2] if len(ties.points) else held.points[:, 2]
    if source.ground is not None:
        return source.ground
    if len(z) < 10 <= len(ties.points):
        raise GeometryError(rays_that_do_not_meet(len(ties.points), source.described))
    if len(z) < 10:
        raise GeometryError(
            f"Nothing tells how high the ground under the block from {source.described} lies: it has {len(held.points)} points of "
            "its own, and the workflow has no tie points of these photographs. Add the stage tie_points, or give `ground`, its "
            "lowest and highest height."
        )
    low, high = np.percentile(z, [0.5, 99.5])
    return float(low), float(high)


def _exterior(view: View, pose: ForeignPose) -> ExteriorOrientation:
    covariance = None if pose.sigma is None else tuple(tuple(map(float, row)) for row in np.diag(pose.sigma**2))
    return ExteriorOrientation(
        photo=view.name,
        centre=tuple(map(float, view.centre)),
        omega_phi_kappa=tuple(float(v) for v in np.degrees(angles(view.rotation))),
        covariance=covariance,
    )


def _ground_points(
    ties: FixedIntersection, measured: Measured, used: np.ndarray, tracks: np.ndarray, factor: float
) -> GroundPoints:
    count = np.bincount(measured.point[used], minlength=len(tracks))
    square = np.bincount(measured.point[used], (ties.residual[used] ** 2).mean(axis=1), minlength=len(tracks))
    keep = np.flatnonzero((count >= 2) & np.isfinite(ties.points).all(axis=1)) if len(tracks) else np.zeros(0, int)
    sigma = (factor * np.sqrt(np.diagonal(ties.covariance[keep], axis1=1, axis2=2))).astype(np.float32)
    residual = np.sqrt(square[keep] / count[keep]).astype(np.float32)
    return GroundPoints(tracks[keep].astype(np.int32), *ties.points[keep].T, *sigma.T, count[keep].astype(np.int16), residual)


def _image_residuals(
    photos: Photos, views: list[View], ties: FixedIntersection, measured: Measured, used: np.ndarray, tracks: np.ndarray
) -> ImageResiduals:
    numbers = np.array([photos.names.index(view.name) for view in views], np.int32)
    v = ties.residual.astype(np.float32)
    size = (np.abs(v).max(axis=1) / measured.sigma).astype(np.float32) if len(v) else np.zeros(0, np.float32)
    return ImageResiduals(
        tracks[measured.point].astype(np.int32),
        numbers[measured.photo],
        *measured.pixels.T,
        *v.T,
        np.where(used, size, np.nan).astype(np.float32),
        used,
    )


def _ground(views: list[View], control: Control) -> list[GroundResidual]:
    """Surveyed points intersected with the held orientation: none of them takes part, whatever its role."""
    number = {view.name: i for i, view in enumerate(views)}
    rows = []
    for point in (point for point in control.points if point.role != "tie"):
        own = [(number[name], value) for name, value in point.measurements.items() if name in number]
        if len(own) < 2:
            continue
        values = np.array([value for _, value in own])
        measured = Measured(np.zeros(len(own), int), np.array([n for n, _ in own]), values[:, :2], values[:, 2])
        found = intersect_fixed(views, measured, 1)
        if np.isfinite(found.points).all():
            variance = np.diag(found.covariance[0]) + np.square(point.sigma)
            rows.append(
                GroundResidual(
                    name=point.name, role=point.role, difference=tuple(map(float, found.points[0] - point.xyz)),
                    predicted=tuple(map(float, np.sqrt(variance))), photos=len(own),
                    residual_px=float(np.sqrt((found.residual**2).mean())),
                )
            )  # fmt: skip
    return rows


def _positions(photos: Photos, views: list[View]) -> list[GroundResidual]:
    rows = []
    for view in views:
        photo = photos[view.name]
        if photo.position is not None and photo.position_sigma is not None:
            difference = tuple(map(float, view.centre - np.array(photo.position)))
            rows.append(
                GroundResidual(name=view.name, role="position", difference=difference, predicted=photo.position_sigma, photos=1)
            )
    return rows
