"""A block that another program has oriented: taken as it is, put into the project's system, and examined with tie points.

The orientation is fixed. Tie points, where the workflow finds them, are intersected with it: their residuals show how well the
orientation fits measurements that had no part in it. Control and check points are compared in the same way.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.findings.block_findings import BlockFinding
from orthomill.schemas.findings.foreign_findings import BlockUnexamined
from orthomill.schemas.observations import Control, ControlPoint, GroundPoints, ImageResiduals, TiePoints
from orthomill.schemas.orientation import Block, BlockPrecision, ExteriorOrientation, GroundResidual, GroundResiduals, Unoriented
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.geometry.fixed_intersection import FixedIntersection, Measured, intersect_fixed
from orthomill.tasks.geometry.rotation import angles
from orthomill.tasks.geometry.view import View
from orthomill.tasks.orientation.exterior.fixed_block_doubts import elsewhere, rays_that_do_not_meet, tie_points_misfit
from orthomill.tasks.orientation.exterior.sources import read_foreign
from orthomill.tasks.orientation.interchange.foreign_block import ForeignBlock, ForeignPose, upright_block
from orthomill.tasks.orientation.orientation_settings import ForeignSource
from orthomill.tasks.orientation.results.block_tables import BlockTables
from orthomill.tasks.orientation.start.similarity import Similarity, VerticalityConstraint, fit_similarity

REJECTED = 5.0
"""Tie points with larger residuals, in robust standard deviations, are taken for wrong matches and not for a wrong orientation."""
NORMAL_MEDIAN = 1.18
"""Median length of a residual in the plane, in its standard errors per coordinate: sqrt(2 ln 2) for a normal distribution."""
LEAST_POINTS = 10
"""Fewer points do not determine the range of the heights of the ground."""
COLLINEAR = 0.05
"""Positions whose extent across is a smaller part of that along lie on a line; a similarity then needs the up direction."""
UP_SIGMA = np.radians(5.0)
"""of the mean viewing axis as the vertical"""
ROUGH_POSITION = (1.0, 1.0, 1.0)
"""m: standard errors of positions that state none; only their ratio to the others counts"""


@dataclass(frozen=True, eq=False)
class PlacedBlock:
    """A foreign block in the project's system: views in the order of the photographs, their poses, the program's points, how it was
    placed in words, and what was found while reading."""

    views: list[View]
    poses: dict[str, ForeignPose]
    points: np.ndarray
    error_px: float | None
    datum: str
    findings: tuple[BlockFinding, ...]


@dataclass(frozen=True, eq=False)
class _Examined:
    """The project's tie points against the block: measurements, `tracks` (N,) of their points, points with residuals, and (M,) bool
    which measurements were used."""

    measured: Measured
    tracks: np.ndarray
    ties: FixedIntersection
    used: np.ndarray

    @property
    def factor(self) -> float:
        """Estimated by stated standard error of the tie points; 1 without any."""
        redundancy = 2 * int(self.used.sum()) - 3 * len(np.unique(self.measured.point[self.used]))
        # Two coordinates per ray less three per point: the orientation is fixed and takes no degree of freedom.
        if redundancy <= 0:
            return 1.0
        size = self.ties.residual[self.used] / self.measured.sigma[self.used, None]
        return float(np.sqrt(np.nansum(size**2) / redundancy))

    @property
    def rms_px(self) -> float | None:
        """Root mean square residual; None without tie points."""
        return float(np.sqrt(np.nanmean(self.ties.residual[self.used] ** 2))) if self.used.any() else None


def orient_fixed(
    photos: Photos,
    cameras: Cameras,
    control: Control,
    texts: tuple[str, ...],
    source: ForeignSource,
    crs: str,
    tie_points: TiePoints | None = None,
) -> BlockTables:
    """The tables of the stage from a foreign block whose orientation is fixed; `texts`: the files of `source`.

    Raises WorkflowError for the files, GeometryError when nothing determines the height of the ground.
    """
    placed = placed_block(upright_block(read_foreign(texts, source, crs), photos), photos, cameras, source)
    examined = _examined(photos, placed.views, tie_points)
    positions = _positions(photos, placed.views)
    block = _block(photos, placed, examined, crs, source)
    doubts = (*elsewhere(positions, source.described), *tie_points_misfit(block.sigma0_px, examined.factor, source.described))
    if tie_points is None:
        doubts += (BlockUnexamined(source=source.described),)
    return BlockTables(
        block=block,
        points=_ground_points(examined),
        image_residuals=_image_residuals(photos, placed.views, examined),
        ground_residuals=GroundResiduals(points=(*_surveyed(placed.views, control), *positions)),
        precision=BlockPrecision(
            image_factor=examined.factor,
            position_factor=1.0,
            control_factor=1.0,
            rays=int(examined.used.sum()),
            rejected=int((~examined.used).sum()),
            findings=(*doubts, *placed.findings),
        ),
    )


def placed_block(block: ForeignBlock, photos: Photos, cameras: Cameras, source: ForeignSource) -> PlacedBlock:
    """The block in the project's system: as its coordinates say, or fitted to the positions of its photographs. Raises
    GeometryError where there are fewer than three positions."""
    datum = f"Fixed: the exterior orientation of {len(block.poses)} photographs was read from {source.described} and not adjusted"
    findings = block.findings
    if source.placed == "positions":
        known = [photo for photo in photos.photos if photo.name in block.poses and photo.position is not None]
        block = _fitted(block, known)
        datum += f"; it was placed by {len(known)} positions of its photographs"
    # The cameras of the file belong to its orientation: with others the two would not fit, however good they are.
    names = [name for name in photos.names if name in block.poses]
    own = {name: block.cameras.get(name) or cameras.of(name) for name in names}
    views = [View(name, own[name], block.poses[name].rotation, block.poses[name].centre) for name in names]
    return PlacedBlock(views, block.poses, block.points, block.error_px, datum + ".", findings)


def _fitted(block: ForeignBlock, known: list[Photo]) -> ForeignBlock:
    """The block after a similarity transformation to the positions of the photographs `known`."""
    if len(known) < 3:
        raise GeometryError(
            f"The block to be read is to be placed by the positions of its photographs, but only {len(known)} of them have one; "
            "three are needed. Give positions, or say that its coordinates are those of the project (placed: project)."
        )
    model, target = np.array([block.poses[photo.name].centre for photo in known]), np.array([photo.position for photo in known])
    # Both systems are centred first: projected coordinates of millions of metres would cost digits in the fit.
    origin, mean = np.round(target.mean(axis=0)), model.mean(axis=0)
    fit = _similarity(block, known, model - mean, target - origin)
    poses = {
        name: ForeignPose(pose.rotation @ fit.rotation.T, fit.apply(pose.centre - mean) + origin)
        for name, pose in block.poses.items()
    }
    return replace(block, poses=poses, points=fit.apply(block.points - mean) + origin)


def _similarity(block: ForeignBlock, known: list[Photo], model: np.ndarray, target: np.ndarray) -> Similarity:
    sigma = np.array([np.sqrt(np.mean(np.square(photo.position_sigma or ROUGH_POSITION))) for photo in known])
    spread = np.linalg.svd(target - target.mean(axis=0), compute_uv=False)
    # The third row of R is the direction from the image to the camera: up, for photographs that look down.
    up = np.mean([pose.rotation[2] for pose in block.poses.values()], axis=0)
    # Positions of one strip leave the rotation about their line open; only there the mean viewing axis takes part.
    weight = 1.0 / UP_SIGMA**2 if spread[1] < COLLINEAR * spread[0] else 0.0
    return fit_similarity(model, target, sigma, VerticalityConstraint(up / np.linalg.norm(up), weight))


def _examined(photos: Photos, views: list[View], ties: TiePoints | None) -> _Examined:
    measured, tracks = _measurements(photos, views, ties)
    return _Examined(measured, tracks, *_intersected(views, measured, len(tracks)))


def _measurements(photos: Photos, views: list[View], ties: TiePoints | None) -> tuple[Measured, np.ndarray]:
    """Tie points in the oriented photographs, points numbered from 0, and the track of each point."""
    if ties is None:
        return Measured(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2)), np.zeros(0)), np.zeros(0, int)
    number = np.full(len(photos.names), -1)
    number[[photos.names.index(view.name) for view in views]] = np.arange(len(views))
    own = ties.take(number[ties.photo] >= 0)
    _, inverse, rays = np.unique(own.track, return_inverse=True, return_counts=True)
    # Photographs outside the block leave tracks with one ray, which has no intersection.
    own = own.take(rays[inverse.ravel()] >= 2)
    tracks, point = np.unique(own.track, return_inverse=True)
    pixels = np.column_stack([own.col, own.row])
    # A stated sigma of 0 would give a ray infinite weight.
    return Measured(point.ravel(), number[own.photo], pixels, np.maximum(own.sigma.astype(float), 1e-3)), tracks


def _intersected(views: list[View], measured: Measured, count: int) -> tuple[FixedIntersection, np.ndarray]:
    """All tie points, and (M,) which measurements took part in the second, final intersection."""
    if not count:
        return FixedIntersection(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 2))), np.zeros(0, bool)
    first = intersect_fixed(views, measured, count)
    size = np.linalg.norm(first.residual, axis=1) / measured.sigma
    usual = float(np.nanmedian(size)) if np.isfinite(size).any() else np.inf
    # Relative to the usual residual: with a wrong orientation all residuals are large, and that must show, not be rejected.
    limit = REJECTED * max(1.0, usual / NORMAL_MEDIAN)
    used = np.nan_to_num(size, nan=np.inf) < limit
    # A rejected ray may leave its point with a single one.
    used &= np.bincount(measured.point[used], minlength=count)[measured.point] >= 2
    final = intersect_fixed(views, measured.take(used), count)
    # Rejected rays keep their residuals from the first intersection: that is where they are far off.
    residual = first.residual.copy()
    residual[used] = final.residual
    return replace(final, residual=residual), used


def _block(photos: Photos, placed: PlacedBlock, examined: _Examined, crs: str, source: ForeignSource) -> Block:
    low, high = _heights(placed, examined.ties, source)
    cameras: dict[str, Camera] = {view.camera.name: view.camera for view in placed.views}
    names = {view.name for view in placed.views}
    reason = "{} is not in the block that was read from {}."
    # Unknowns are the coordinates of the points only.
    points = int(np.isfinite(examined.ties.points[:, 0]).sum())
    return Block(
        crs=crs,
        cameras=cameras,
        of_photo={view.name: view.camera.name for view in placed.views},
        photos=tuple(_exterior(view, placed.poses[view.name]) for view in placed.views),
        unoriented=tuple(Unoriented(photo=n, reason=reason.format(n, source.described)) for n in photos.names if n not in names),
        datum=placed.datum,
        # Weights of later stages need a sigma0: that of the other program, or a pixel where nobody states one.
        sigma0_px=examined.rms_px if examined.rms_px is not None else placed.error_px or 1.0,
        redundancy=max(2 * int(examined.used.sum()) - 3 * points, 0),
        iterations=0,
        ground_low=low,
        ground_high=high,
    )


def _heights(placed: PlacedBlock, ties: FixedIntersection, source: ForeignSource) -> tuple[float, float]:
    # Points of the other program are used only where the project has no tie points: they are not examined.
    z = ties.points[np.isfinite(ties.points).all(axis=1), 2] if len(ties.points) else placed.points[:, 2]
    if source.ground is not None:
        return source.ground
    if len(z) < LEAST_POINTS <= len(ties.points):
        raise GeometryError(rays_that_do_not_meet(len(ties.points), source.described))
    if len(z) < LEAST_POINTS:
        raise GeometryError(
            f"Nothing determines the height of the ground under the block from {source.described}: it has {len(placed.points)} "
            "points of its own, and the workflow has no tie points of these photographs. Add the stage tie_points, or give "
            "`ground`, its lowest and highest height."
        )
    # The range of an adjusted block, by the same percentiles.
    low, high = np.percentile(z, [0.5, 99.5])
    return float(low), float(high)


def _exterior(view: View, pose: ForeignPose) -> ExteriorOrientation:
    covariance = None if pose.sigma is None else tuple(tuple(map(float, row)) for row in np.diag(pose.sigma**2))
    x, y, z = map(float, view.centre)
    omega, phi, kappa = map(float, np.degrees(angles(view.rotation)))
    return ExteriorOrientation(photo=view.name, centre=(x, y, z), omega_phi_kappa=(omega, phi, kappa), covariance=covariance)


def _ground_points(examined: _Examined) -> GroundPoints:
    """The tie points with two rays or more; their standard errors leave out those of the orientation, which nobody states."""
    ties, measured, used, tracks = examined.ties, examined.measured, examined.used, examined.tracks
    count = np.bincount(measured.point[used], minlength=len(tracks))
    square = np.bincount(measured.point[used], (ties.residual[used] ** 2).mean(axis=1), minlength=len(tracks))
    keep = np.flatnonzero((count >= 2) & np.isfinite(ties.points).all(axis=1)) if len(tracks) else np.zeros(0, int)
    # The covariance is that of the stated sigmas; the factor brings it to the residuals that were found.
    variance = np.diagonal(ties.covariance[keep], axis1=1, axis2=2)
    sigma_x, sigma_y, sigma_z = (examined.factor * np.sqrt(variance)).astype(np.float32).T
    x, y, z = ties.points[keep].T
    return GroundPoints(
        track=tracks[keep].astype(np.int32),
        x=x,
        y=y,
        z=z,
        sigma_x=sigma_x,
        sigma_y=sigma_y,
        sigma_z=sigma_z,
        rays=count[keep].astype(np.int16),
        residual=np.sqrt(square[keep] / count[keep]).astype(np.float32),
    )


def _image_residuals(photos: Photos, views: list[View], examined: _Examined) -> ImageResiduals:
    measured, used = examined.measured, examined.used
    numbers = np.array([photos.names.index(view.name) for view in views], np.int32)
    v = examined.ties.residual.astype(np.float32)
    # In units of the measurement, because the residual of a fixed intersection has no cofactor here.
    size = (np.abs(v).max(axis=1) / measured.sigma).astype(np.float32) if len(v) else np.zeros(0, np.float32)
    return ImageResiduals(
        track=examined.tracks[measured.point].astype(np.int32),
        photo=numbers[measured.photo],
        col=measured.pixels[:, 0],
        row=measured.pixels[:, 1],
        v_col=v[:, 0],
        v_row=v[:, 1],
        standardised=np.where(used, size, np.nan).astype(np.float32),
        used=used,
    )


def _surveyed(views: list[View], control: Control) -> list[GroundResidual]:
    """Surveyed points intersected with the fixed orientation: none of them takes part, whatever its role."""
    number = {view.name: i for i, view in enumerate(views)}
    surveyed = [point for point in control.points if point.role != "tie"]
    return [row for row in (_compared(views, number, point) for point in surveyed) if row]


def _compared(views: list[View], number: dict[str, int], point: ControlPoint) -> GroundResidual | None:
    """A surveyed point against the block; None where its rays do not intersect."""
    own = [(number[name], value) for name, value in point.measurements.items() if name in number]
    # One ray gives a direction, no point.
    if len(own) < 2:
        return None
    values = np.array([value for _, value in own])
    measured = Measured(np.zeros(len(own), int), np.array([n for n, _ in own]), values[:, :2], values[:, 2])
    found = intersect_fixed(views, measured, 1)
    if not np.isfinite(found.points).all():
        return None
    dx, dy, dz = map(float, found.points[0] - point.xyz)
    # The point was surveyed independently of the block, so the variances add.
    sx, sy, sz = map(float, np.sqrt(np.diag(found.covariance[0]) + np.square(point.sigma)))
    return GroundResidual(
        name=point.name,
        role=point.role,
        difference=(dx, dy, dz),
        predicted=(sx, sy, sz),
        photos=len(own),
        residual_px=float(np.sqrt((found.residual**2).mean())),
    )


def _positions(photos: Photos, views: list[View]) -> list[GroundResidual]:
    rows = []
    for view in views:
        photo = photos[view.name]
        if photo.position is not None and photo.position_sigma is not None:
            dx, dy, dz = map(float, view.centre - np.array(photo.position))
            rows.append(
                GroundResidual(name=view.name, role="position", difference=(dx, dy, dz), predicted=photo.position_sigma, photos=1)
            )
    return rows
