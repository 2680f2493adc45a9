"""The block: start, datum, bundle, and the account of it in tables.

Photographs are renumbered to those that joined, control points follow the tie points, and coordinates are local while numbers are
crunched; all that leaves this file is in the project's CRS again.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from schemas.camera import INTERIOR, Camera, Cameras
from schemas.observations import Control, ControlPoint, GroundPoints, ImageResiduals, TiePoints
from schemas.orientation import (
    Block,
    BlockPrecision,
    Correlation,
    ExteriorOrientation,
    GroundResidual,
    GroundResiduals,
    RelativeOrientations,
    Unoriented,
)
from schemas.photo import Photos
from schemas.settings import Settings
from tasks.adjustment.bundle import Adjustment, BlunderTest, adjust
from tasks.adjustment.collinearity import misclosures
from tasks.adjustment.datum import position_misclosures
from tasks.adjustment.interior import InteriorChoice, interior_prior
from tasks.adjustment.network import Network, Rays, State
from tasks.geometry.rotation import angles
from tasks.geometry.rotation_vector import angles_from_vector
from tasks.orientation.block_start import Material, Start, start_block
from tasks.orientation.georeference import Datum, Known, choose_datum, held, to_datum
from tasks.orientation.ground_points import approximate_points, intersect_ground
from tasks.orientation.measurements import ground_rays, tie_rays, with_interior

cv2.setNumThreads(1)


class BlockChoices(Settings):
    """What the workflow decides: the part of the interior orientation, a common shift of the GNSS positions, the standard error of
    the mean viewing direction where it is needed (degrees), and the limit of the blunder test in standard errors."""

    interior: InteriorChoice
    gnss_shift: bool
    vertical_sigma: float
    rejection: float


@dataclass(frozen=True, eq=False)
class _Problem:
    """The block in local numbers: `active` (p,) numbers of its photos, `names` of them, `rays` of tie points and control, `good`
    (M,) after the start, `ties` the number of tie points, `measured` the number of all rays of its photos, also of points that were
    never intersected."""

    active: np.ndarray
    names: tuple[str, ...]
    cameras: list[Camera]
    camera_of: np.ndarray
    rays: Rays
    good: np.ndarray
    ties: int
    measured: int
    control: list[ControlPoint]


def orient_block(
    photos: Photos,
    cameras: Cameras,
    tie_points: TiePoints,
    control: Control,
    relative: RelativeOrientations,
    crs: str,
    choices: BlockChoices,
) -> dict[str, object]:
    """Orients all photographs that can be oriented. Returns the tables block, points, image_residuals, ground_residuals, precision.

    Raises GeometryError when there is no block at all or its observations do not determine it.
    """
    material, tracks = _material(photos, cameras, tie_points, relative, choices)
    start = start_block(material)
    problem = _problem(material, start, cameras, control)
    model = _model(start, problem)
    known = _known(photos, cameras, problem, model)
    datum = choose_datum(model, known, np.radians(choices.vertical_sigma), choices.gnss_shift)
    result = _adjusted(problem, material, model, known, datum, choices)
    return {
        "block": _block(crs, photos, cameras, problem, start, result, datum),
        "points": _ground_points(problem, result, datum, tracks),
        "image_residuals": _image_residuals(problem, result, tracks, control),
        "ground_residuals": _ground_residuals(cameras, problem, result, datum, control),
        "precision": _precision(problem, result, datum),
    }


def _material(
    photos: Photos, cameras: Cameras, tie_points: TiePoints, relative: RelativeOrientations, choices: BlockChoices
) -> tuple[Material, np.ndarray]:
    rays, tracks = tie_rays(photos, cameras, tie_points)
    used = sorted({cameras.of_photo[name] for name in photos.names})
    camera_of = np.array([used.index(cameras.of_photo[name]) for name in photos.names], np.int64)
    values = [cameras.cameras[name] for name in used]
    interior = interior_prior(values, choices.interior)
    return Material(photos.names, values, camera_of, interior, rays, len(tracks), relative.pairs), tracks


def _problem(material: Material, start: Start, cameras: Cameras, control: Control) -> _Problem:
    number = np.full(len(material.names), -1, np.int32)
    number[start.photos] = np.arange(len(start.photos))
    inside = (number[material.rays.photo] >= 0) & start.known[material.rays.point]
    ties = material.rays.take(inside)
    names = tuple(material.names[i] for i in start.photos)
    points = [point for point in control.points if point.role == "control"]
    ground = ground_rays(points, {name: i for i, name in enumerate(names)}, cameras)
    rays = Rays(
        np.concatenate([ties.point, ground.point + material.points]).astype(np.int32),
        np.concatenate([number[ties.photo], ground.photo]).astype(np.int32),
        np.vstack([ties.xy, ground.xy]),
        np.concatenate([ties.sigma, ground.sigma]),
    )
    good = np.concatenate([start.good[inside], np.ones(len(ground), bool)])
    measured = int((number[material.rays.photo] >= 0).sum()) + len(ground)
    return _Problem(
        start.photos, names, material.cameras, material.camera_of[start.photos], rays, good, material.points, measured, points
    )


def _model(start: Start, problem: _Problem) -> State:
    """The start's state with the photographs of the block only."""
    return replace(
        start.state,
        rotation=start.state.rotation[problem.active],
        centre=start.state.centre[problem.active],
        point=np.where(start.known[:, None], start.state.point, np.nan),
    )


def _known(photos: Photos, cameras: Cameras, problem: _Problem, model: State) -> Known:
    unknown = (np.nan,) * 3
    rows = [photos[name] for name in problem.names]
    both = [photo.position is not None and photo.position_sigma is not None for photo in rows]
    position = np.array([photo.position if ok else unknown for photo, ok in zip(rows, both, strict=True)], float)
    sigma = np.array([photo.position_sigma if ok else unknown for photo, ok in zip(rows, both, strict=True)], float)
    rays = ground_rays(problem.control, {name: i for i, name in enumerate(problem.names)}, cameras)
    placed = approximate_points(model, problem.cameras, problem.camera_of, rays, len(problem.control))
    return Known(
        position,
        sigma,
        np.array([p.xyz for p in problem.control]).reshape(-1, 3),
        np.array([p.sigma for p in problem.control]).reshape(-1, 3),
        placed,
    )


def _adjusted(problem: _Problem, material: Material, model: State, known: Known, datum: Datum, choices: BlockChoices) -> Adjustment:
    count, p = problem.ties + len(problem.control), len(problem.names)
    state = to_datum(model, datum)
    points = np.vstack([np.nan_to_num(state.point), known.control - datum.origin])
    if datum.free:
        points[problem.ties :] = np.nan_to_num(datum.similarity.apply(known.control_model))
    network = Network(
        problem.camera_of,
        material.interior,
        np.zeros((p, 3)),
        np.zeros((p, 3)),
        np.zeros((count, 3)),
        np.zeros((count, 3)),
        np.zeros(p),
        shift=choices.gnss_shift and not datum.free,
    )
    network = held(network, known, datum, problem.ties)
    good = problem.good if not datum.free else problem.good & (problem.rays.point < problem.ties)
    return adjust(network, replace(state, point=points), problem.rays.take(good), BlunderTest(limit=choices.rejection))


def _used(problem: _Problem, result: Adjustment) -> tuple[np.ndarray, np.ndarray]:
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


def _block(crs: str, photos: Photos, cameras: Cameras, problem: _Problem, start: Start, result: Adjustment, datum: Datum) -> Block:
    tie = np.unique(result.rays.point[result.used & (result.rays.point < problem.ties)])
    low, high = np.percentile(result.state.point[tie, 2], [0.5, 99.5]) + datum.origin[2]
    return Block(
        crs=crs,
        cameras=_cameras(cameras, problem, result),
        of_photo={name: cameras.of_photo[name] for name in problem.names},
        photos=tuple(_exterior(problem, result, datum, i) for i in range(len(problem.names))),
        unoriented=tuple(Unoriented(photo=u.photo, reason=u.reason) for u in start.unoriented),
        datum=datum.sentence,
        sigma0_px=result.sigma0_px,
        redundancy=result.redundancy,
        iterations=result.iterations,
        ground_low=float(low),
        ground_high=float(high),
    )


def _exterior(problem: _Problem, result: Adjustment, datum: Datum, photo: int) -> ExteriorOrientation:
    R = result.state.rotation[photo]
    to_angles = np.eye(6)
    to_angles[3:, 3:] = angles_from_vector(R)
    covariance = to_angles @ result.exterior_covariance(photo) @ to_angles.T
    own = result.used & (result.rays.photo == photo)
    return ExteriorOrientation(
        photo=problem.names[photo],
        centre=tuple(map(float, result.state.centre[photo] + datum.origin)),
        omega_phi_kappa=tuple(float(v) for v in np.degrees(angles(R))),
        covariance=tuple(tuple(map(float, row)) for row in 0.5 * (covariance + covariance.T)),
        observations=int(own.sum()),
        residual_px=float(np.sqrt((result.residual[own] ** 2).mean())) if own.any() else None,
    )


def _cameras(cameras: Cameras, problem: _Problem, result: Adjustment) -> dict[str, Camera]:
    """The cameras as adjusted: values and covariance where they took part, untouched where they were fixed."""
    out = {}
    for k, columns in enumerate(result.network.interior_columns):
        camera = problem.cameras[k]
        name = next(name for name, value in cameras.cameras.items() if value is camera)
        if (columns < 0).all() or k not in problem.camera_of:
            out[name] = camera
            continue
        covariance = np.zeros((8, 8))
        free = columns >= 0
        covariance[np.ix_(free, free)] = result.cofactor[np.ix_(columns[free], columns[free])]
        out[name] = with_interior(camera, result.state.interior[k]).model_copy(
            update={
                "source": "block",
                "sigma0": result.sigma0_px,
                "covariance": tuple(tuple(map(float, row)) for row in covariance),
            }
        )
    return {name: out[name] for name in sorted(out) if name in {cameras.of_photo[photo] for photo in problem.names}}


def _ground_points(problem: _Problem, result: Adjustment, datum: Datum, tracks: np.ndarray) -> GroundPoints:
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


def _image_residuals(problem: _Problem, result: Adjustment, tracks: np.ndarray, control: Control) -> ImageResiduals:
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


def _ground_residuals(cameras: Cameras, problem: _Problem, result: Adjustment, datum: Datum, control: Control) -> GroundResiduals:
    found = [] if datum.free else [*_control_rows(problem, result), *_position_rows(problem, result)]
    return GroundResiduals(points=(*found, *([] if datum.free else _check_rows(cameras, problem, result, datum, control))))


def _control_rows(problem: _Problem, result: Adjustment) -> list[GroundResidual]:
    rows = []
    for i, point in enumerate(problem.control):
        number = problem.ties + i
        own = result.used & (result.rays.point == number)
        difference = result.state.point[number] - result.network.point[number]
        variance = 1.0 / result.network.point_weight[number] - np.diag(result.point_covariance[number])
        rows.append(_residual(point.name, "control", difference, variance, int(own.sum()), result.residual[own]))
    return rows


def _position_rows(problem: _Problem, result: Adjustment) -> list[GroundResidual]:
    misclosure, rows = -position_misclosures(result.network, result.state), []
    for i in np.flatnonzero(result.network.centre_weight.all(axis=1)):
        variance = 1.0 / result.network.centre_weight[i] - np.diag(result.exterior_covariance(i))[:3]
        rows.append(_residual(problem.names[i], "position", misclosure[i], variance, 1, np.zeros((0, 2))))
    return rows


def _check_rows(cameras: Cameras, problem: _Problem, result: Adjustment, datum: Datum, control: Control) -> list[GroundResidual]:
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


def _precision(problem: _Problem, result: Adjustment, datum: Datum) -> BlockPrecision:
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
        weaknesses=datum.weaknesses,
    )


def _correlations(problem: _Problem, result: Adjustment) -> list[Correlation]:
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
