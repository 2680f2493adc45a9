"""The account of an adjusted block: the tables that leave the stage, in the project's CRS."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from schemas.camera import INTERIOR, Camera, Cameras
from schemas.observations import Control, ControlPoint, GroundPoints, ImageResiduals
from schemas.orientation import (
    Block,
    BlockPrecision,
    Correlation,
    ExteriorOrientation,
    GroundResidual,
    GroundResiduals,
    JointCovariance,
    Unoriented,
)
from tasks.adjustment.collinearity import misclosures
from tasks.adjustment.datum import position_misclosures
from tasks.adjustment.network import Rays
from tasks.adjustment.result import Adjustment
from tasks.geometry.rotation import angles
from tasks.geometry.rotation_vector import angles_from_vector
from tasks.orientation.georeference import Datum
from tasks.orientation.ground_points import approximate_points, intersect_ground
from tasks.orientation.measurements import ground_rays, with_interior


@dataclass(frozen=True, eq=False)
class Problem:
    """The block in local numbers: `active` (p,) numbers of its photos, `names` of them, `rays` of tie points and control, `good`
    (M,) after the start, `ties` the number of tie points, `measured` the number of all rays of its photos, also of points that were
    never intersected."""

    active: np.ndarray
    names: tuple[str, ...]
    camera_names: tuple[str, ...]
    cameras: list[Camera]
    camera_of: np.ndarray
    rays: Rays
    good: np.ndarray
    ties: int
    measured: int
    control: list[ControlPoint]


def _used(problem: Problem, result: Adjustment) -> tuple[np.ndarray, np.ndarray]:
    """(M,) which rays of the problem took part to the end, and the larger standardised residual of each (NaN otherwise)."""
    used, standardised = np.zeros(len(problem.rays), bool), np.full(len(problem.rays), np.nan)
    taken = _positions_of(problem.rays, result.rays)
    used[taken] = result.used
    standardised[taken] = np.abs(result.standardised).max(axis=1)
    return used, standardised


def _positions_of(rays: Rays, part: Rays) -> np.ndarray:
    """Where the rays of `part` stand in `rays`: a photograph sees a point once."""
    photos = int(rays.photo.max(initial=0)) + 1
    return np.searchsorted(rays.point.astype(np.int64) * photos + rays.photo, part.point.astype(np.int64) * photos + part.photo)


def block_table(
    crs: str, cameras: Cameras, problem: Problem, unoriented: tuple[Unoriented, ...], result: Adjustment, datum: Datum
) -> Block:
    """The block as later stages read it."""
    tie = np.unique(result.rays.point[result.used & (result.rays.point < problem.ties)])
    low, high = np.percentile(result.state.point[tie, 2], [0.5, 99.5]) + datum.origin[2]
    return Block(
        crs=crs,
        cameras=_cameras(cameras, problem, result),
        of_photo={name: cameras.of_photo[name] for name in problem.names},
        photos=tuple(_exterior(problem, result, datum, i) for i in range(len(problem.names))),
        unoriented=unoriented,
        datum=datum.sentence,
        sigma0_px=result.sigma0_px,
        redundancy=result.redundancy,
        iterations=result.iterations,
        ground_low=float(low),
        ground_high=float(high),
        joint=_joint(problem, result),
        joint_cameras=_joint_cameras(problem, result),
    )


def _joint(problem: Problem, result: Adjustment) -> tuple[JointCovariance, ...]:
    """The covariance between the photographs of every pair that shares a used tie point."""
    shared = {pair for own in _photos_of_points(result) for pair in combinations(own, 2)}
    turns = [_to_angles(result.state.rotation[photo]) for photo in range(len(problem.names))]
    found = []
    for a, b in sorted(shared):
        covariance = turns[a] @ result.cofactor[6 * a : 6 * a + 6, 6 * b : 6 * b + 6] @ turns[b].T
        found.append(JointCovariance(first=problem.names[a], second=problem.names[b], covariance=_rows(covariance)))
    return tuple(found)


def _joint_cameras(problem: Problem, result: Adjustment) -> tuple[JointCovariance, ...]:
    """The covariance between the interior orientations of every two cameras that were adjusted."""
    columns = _adjusted_cameras(problem, result)
    return tuple(
        JointCovariance(
            first=problem.camera_names[a], second=problem.camera_names[b], covariance=_rows(_spread(result, columns[a], columns[b]))
        )
        for a, b in combinations(columns, 2)
    )


def _adjusted_cameras(problem: Problem, result: Adjustment) -> dict[int, np.ndarray]:
    """The columns (8,) of the interior orientation of the cameras that were adjusted; -1 for parameters that were not."""
    return {k: own for k, own in enumerate(result.network.interior_columns) if (own >= 0).any() and k in problem.camera_of}


def _spread(result: Adjustment, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """The covariance of the unknowns in `rows` and `columns`; 0 where there is none (-1)."""
    inside = (rows >= 0)[:, None] & (columns >= 0)
    return np.where(inside, result.cofactor[np.ix_(rows, columns)], 0.0)


def _rows(matrix: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(map(float, row)) for row in matrix)


def _photos_of_points(result: Adjustment) -> set[tuple[int, ...]]:
    """The different sets of photographs, ascending, that see a point together."""
    point, photo = result.rays.point[result.used], result.rays.photo[result.used]
    order = np.lexsort((photo, point))
    starts = np.flatnonzero(np.diff(point[order], prepend=-1))
    return {tuple(map(int, own)) for own in np.split(photo[order], starts[1:])}


def _to_angles(rotation: np.ndarray) -> np.ndarray:
    """(6, 6): from the unknowns of the adjustment to X, Y, Z, omega, phi, kappa."""
    turned = np.eye(6)
    turned[3:, 3:] = angles_from_vector(rotation)
    return turned


def _exterior(problem: Problem, result: Adjustment, datum: Datum, photo: int) -> ExteriorOrientation:
    R = result.state.rotation[photo]
    to_angles = _to_angles(R)
    covariance = to_angles @ result.exterior_covariance(photo) @ to_angles.T
    own = result.used & (result.rays.photo == photo)
    return ExteriorOrientation(
        photo=problem.names[photo],
        centre=tuple(map(float, result.state.centre[photo] + datum.origin)),
        omega_phi_kappa=tuple(float(v) for v in np.degrees(angles(R))),
        covariance=_rows(0.5 * (covariance + covariance.T)),
        observations=int(own.sum()),
        residual_px=float(np.sqrt((result.residual[own] ** 2).mean())) if own.any() else None,
        with_interior={
            problem.camera_names[k]: _rows(to_angles @ _spread(result, 6 * photo + np.arange(6), columns))
            for k, columns in _adjusted_cameras(problem, result).items()
        },
    )


def _cameras(cameras: Cameras, problem: Problem, result: Adjustment) -> dict[str, Camera]:
    """The cameras as adjusted: values and covariance where they took part, untouched where they were fixed."""
    out = {}
    for k, columns in enumerate(result.network.interior_columns):
        camera, name = problem.cameras[k], problem.camera_names[k]
        if (columns < 0).all() or k not in problem.camera_of:
            out[name] = camera
            continue
        out[name] = with_interior(camera, result.state.interior[k]).model_copy(
            update={
                "source": "block",
                "sigma0": result.sigma0_px,
                "covariance": _rows(_spread(result, columns, columns)),
            }
        )
    return {name: out[name] for name in sorted(out) if name in {cameras.of_photo[photo] for photo in problem.names}}


def ground_points(problem: Problem, result: Adjustment, datum: Datum, tracks: np.ndarray) -> GroundPoints:
    rays, square = result.rays, (result.residual**2).mean(axis=1)
    count = np.bincount(rays.point[result.used], minlength=len(result.state.point))[: problem.ties]
    total = np.bincount(rays.point[result.used], square[result.used], minlength=len(result.state.point))[: problem.ties]
    keep = np.flatnonzero(count >= 2)
    xyz = result.state.point[keep] + datum.origin
    sigma = np.sqrt(np.diagonal(result.point_covariance[keep], axis1=1, axis2=2)).astype(np.float32)
    return GroundPoints(
        tracks[keep].astype(np.int32),
        *xyz.T,
        *sigma.T,
        count[keep].astype(np.int16),
        np.sqrt(total[keep] / count[keep]).astype(np.float32),
    )


def image_residuals(problem: Problem, result: Adjustment, tracks: np.ndarray, control: Control) -> ImageResiduals:
    used, standardised = _used(problem, result)
    rays = problem.rays
    v = -misclosures(result.state, rays, problem.camera_of) * [1.0, -1.0]
    place = {point.name: i for i, point in enumerate(control.points)}
    ground = np.array([-1 - place[point.name] for point in problem.control], np.int64)
    track = np.concatenate([tracks, ground])[rays.point]
    size = np.array([(problem.cameras[k].width, problem.cameras[k].height) for k in problem.camera_of])[rays.photo]
    order = np.argsort(track, kind="stable")
    return ImageResiduals(
        track.astype(np.int32),
        problem.active[rays.photo].astype(np.int32),
        rays.xy[:, 0] + (size[:, 0] - 1) / 2,
        (size[:, 1] - 1) / 2 - rays.xy[:, 1],
        v[:, 0].astype(np.float32),
        v[:, 1].astype(np.float32),
        standardised.astype(np.float32),
        used,
    ).take(order)


def ground_residuals(cameras: Cameras, problem: Problem, result: Adjustment, datum: Datum, control: Control) -> GroundResiduals:
    found = [] if datum.free else [*_control_rows(problem, result), *_position_rows(problem, result)]
    return GroundResiduals(points=(*found, *([] if datum.free else _check_rows(cameras, problem, result, datum, control))))


def _control_rows(problem: Problem, result: Adjustment) -> list[GroundResidual]:
    rows = []
    for i, point in enumerate(problem.control):
        number = problem.ties + i
        own = result.used & (result.rays.point == number)
        difference = result.state.point[number] - result.network.point[number]
        variance = 1.0 / result.network.point_weight[number] - np.diag(result.point_covariance[number])
        rows.append(_residual(point.name, "control", difference, variance, int(own.sum()), result.residual[own]))
    return rows


def _position_rows(problem: Problem, result: Adjustment) -> list[GroundResidual]:
    misclosure, rows = -position_misclosures(result.network, result.state), []
    for i in np.flatnonzero(result.network.centre_weight.all(axis=1)):
        variance = 1.0 / result.network.centre_weight[i] - np.diag(result.exterior_covariance(i))[:3]
        rows.append(_residual(problem.names[i], "position", misclosure[i], variance, 1, np.zeros((0, 2))))
    return rows


def _check_rows(cameras: Cameras, problem: Problem, result: Adjustment, datum: Datum, control: Control) -> list[GroundResidual]:
    points = [point for point in control.points if point.role == "check"]
    rays = ground_rays(points, {name: i for i, name in enumerate(problem.names)}, cameras)
    start = approximate_points(result.state, problem.cameras, problem.camera_of, rays, len(points))
    found, rows = intersect_ground(result, start, rays), []
    for i, point in enumerate(points):
        if np.isfinite(found.point[i]).all():
            difference = found.point[i] + datum.origin - point.xyz
            variance = np.diag(found.covariance[i]) + np.square(point.sigma)
            rows.append(
                _residual(point.name, "check", difference, variance, int((rays.point == i).sum()), found.residual[rays.point == i])
            )
    return rows


def _residual(
    name: str, role: str, difference: np.ndarray, variance: np.ndarray, photos: int, residual: np.ndarray
) -> GroundResidual:
    return GroundResidual(
        name=name,
        role=role,
        difference=tuple(map(float, difference)),
        predicted=tuple(map(float, np.sqrt(np.maximum(variance, 0.0)))),
        photos=photos,
        residual_px=float(np.sqrt((residual**2).mean())) if len(residual) else None,
    )


def block_precision(problem: Problem, result: Adjustment, datum: Datum) -> BlockPrecision:
    shift = result.network.shift
    return BlockPrecision(
        image_factor=result.factors.image,
        position_factor=result.factors.position,
        control_factor=result.factors.control,
        rays=int(result.used.sum()),
        rejected=int(problem.measured - result.used.sum()),
        gnss_shift=tuple(map(float, result.state.shift)) if shift else None,
        gnss_shift_sigma=tuple(map(float, np.sqrt(np.diag(result.cofactor)[-3:]))) if shift else None,
        correlations=tuple(_correlations(problem, result)),
        weaknesses=(*datum.weaknesses, *_nominal(problem, result)),
    )


def _nominal(problem: Problem, result: Adjustment) -> list[str]:
    """A sentence for every camera constant that was only considered."""
    found = []
    for k in np.flatnonzero(result.network.interior.considered[:, 0]):
        camera, column = problem.cameras[k], result.network.interior_columns[k, 0]
        share = 100.0 * np.sqrt(result.cofactor[column, column]) / camera.c
        found.append(
            f"The camera constant of {problem.camera_names[k]} is nominal (from EXIF, {camera.c:.0f} px, within {share:.0f} %) and "
            "cannot be told from the flying height without control: it and the principal point kept their values, and heights "
            "above and below the mean ground are uncertain by the same share. Calibrate the camera, or give three control points."
        )
    return found


def _correlations(problem: Problem, result: Adjustment) -> list[Correlation]:
    """Interior parameters against each other, against the mean height of the centres, and that of 0.9 or more only."""
    names, rows, size = [], [], len(result.cofactor)
    for k, columns in enumerate(result.network.interior_columns):
        names += [f"{INTERIOR[i]} of {problem.cameras[k].name}" for i in np.flatnonzero(columns >= 0)]
        rows += [np.eye(size)[columns[i]] for i in np.flatnonzero(columns >= 0)]
    photos = len(problem.names)
    names.append("the mean height of the projection centres")
    rows.append(np.bincount(6 * np.arange(photos) + 2, minlength=size) / photos)
    J = np.array(rows)
    covariance = J @ result.cofactor @ J.T
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(scale, scale)
    return [
        Correlation(first=names[i], second=names[j], value=float(correlation[i, j]))
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(correlation[i, j]) >= 0.9
    ]
