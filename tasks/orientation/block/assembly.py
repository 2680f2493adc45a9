"""From starts and datums to the numbers of one adjustment.

Every part has its photographs, its model and its datum; parts that share the project's system are put side by side. A tie point
belongs to one part, and only the rays of that part's photographs are believed; surveyed points belong to all.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.observations import Control, ControlPoint
from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.model.adjustment_result import Adjustment
from orthomill.tasks.adjustment.model.collinearity import BEHIND, residuals
from orthomill.tasks.adjustment.model.network import Distances, Network, Rays, State
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.control.ground_points import approximate_points
from orthomill.tasks.orientation.measurements import ground_rays
from orthomill.tasks.orientation.start.block_growth import GrowthMaterial
from orthomill.tasks.orientation.start.block_start import BlockStart
from orthomill.tasks.orientation.start.georeference import Datum, Known, held
from orthomill.tasks.orientation.start.up_direction import TOP

MEETING = 0.01
"""rad: where the rays of a control point miss each other by more, one of them is another point's; only its coordinates then place
it, and tell which ray is wrong."""
DEPTHS = 2.0
"""So do rays that meet this many times nearer or farther than tie points lie."""


@dataclass(frozen=True, eq=False)
class Part:
    """A group of photographs: its start, its model (photographs of the group only), what is known of it, its datum, and the origin
    (3,) of a start that came with a system of its own."""

    start: BlockStart
    model: State
    known: Known
    datum: Datum
    origin: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Problem:
    """The block in local numbers: `active` (p,) numbers of its photos, `names` of them, `rays` of tie points and surveyed points,
    `good` (M,) after the start, `ties` the number of tie points, `measured` the number of all rays of its photos, also of points
    that were never intersected; `surveyed`: points that a person measured, but for check points; `groups`: names by part."""

    active: np.ndarray
    names: tuple[str, ...]
    camera_names: tuple[str, ...]
    cameras: list[Camera]
    camera_of: np.ndarray
    rays: Rays
    good: np.ndarray
    ties: int
    measured: int
    surveyed: list[ControlPoint]
    known: Known
    distances: tuple[tuple[int, int, float, float], ...]
    groups: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, eq=False)
class BlockResults:
    """All that the tables are made from; `remarks`: sentences about the interior orientation; `anew` (C,) px: camera constants with
    which the start is to be made once more (NaN: as given)."""

    cameras: Cameras
    problem: Problem
    result: Adjustment
    datum: Datum
    remarks: tuple[str, ...]
    anew: np.ndarray


def taking_part(control: Control) -> list[ControlPoint]:
    """The control points, and the tie points that a person measured in two photographs or more."""
    return [point for point in control.points if point.role == "control" or (point.role == "tie" and len(point.measurements) >= 2)]


def known_of(
    photos: Photos, cameras: Cameras, material: GrowthMaterial, start: BlockStart, control: Control, tops: Mapping[str, np.ndarray]
) -> tuple[State, Known]:
    """The model of a start, with its photographs only, and what is known of these and of the ground; `tops`: the direction to the
    top of photographs, of those where it is not the y axis of the image system."""
    model = replace(
        start.state,
        rotation=start.state.rotation[start.photos],
        centre=start.state.centre[start.photos],
        point=np.where(start.known[:, None], start.state.point, np.nan),
    )
    names = tuple(material.names[i] for i in start.photos)
    points = taking_part(control)
    rays = ground_rays(points, {name: i for i, name in enumerate(names)}, cameras)
    camera_of = material.camera_of[start.photos]
    placed, missed = approximate_points(model, material.cameras, camera_of, rays, len(points))
    surveyed = np.array([point.role == "control" for point in points], bool)
    placed[surveyed & ((missed > MEETING) | ~_at_depth(material, start, model, rays, placed))] = np.nan
    return model, Known(
        *_positions(photos, names),
        *_coordinates(points),
        placed,
        _zeniths(photos, names),
        np.array([tops.get(name, TOP) for name in names]),
        _lengths(points, control),
    )


def _at_depth(material: GrowthMaterial, start: BlockStart, model: State, rays: Rays, placed: np.ndarray) -> np.ndarray:
    """(n,) bool: points that lie about as far before their photographs as tie points do; two rays of different points may meet, but
    elsewhere."""
    own = start.good & start.known[material.rays.point] & np.isin(material.rays.photo, start.photos)
    photo = np.searchsorted(start.photos, material.rays.photo[own])
    low, high = np.percentile(_depths(model, photo, model.point[material.rays.point[own]]), [1.0, 99.0])
    depth, good = _depths(model, rays.photo, placed[rays.point]), np.ones(len(placed), bool)
    good[rays.point[(depth < low / DEPTHS) | (depth > high * DEPTHS)]] = False
    return good


def _depths(model: State, photo: np.ndarray, points: np.ndarray) -> np.ndarray:
    return -np.einsum("ni,ni->n", model.rotation[photo, 2], points - model.centre[photo])


def _positions(photos: Photos, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    unknown = (np.nan,) * 3
    rows = [photos[name] for name in names]
    both = [photo.position is not None and photo.position_sigma is not None for photo in rows]
    position = np.array([photo.position if ok else unknown for photo, ok in zip(rows, both, strict=True)], float)
    sigma = np.array([photo.position_sigma if ok else unknown for photo, ok in zip(rows, both, strict=True)], float)
    return position, sigma


def _zeniths(photos: Photos, names: tuple[str, ...]) -> np.ndarray:
    """(P, 3) the zenith in the image systems by the attitudes of the photographs; NaN where they have none."""
    attitudes = (photos[name].attitude for name in names)
    return np.array([(np.nan,) * 3 if a is None else rotation_matrix(*np.radians(a))[:, 2] for a in attitudes])


def _coordinates(points: list[ControlPoint]) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates (n, 3) and standard errors (n, 3); NaN and inf for points that were not surveyed."""
    nothing, open_ = (np.nan,) * 3, (np.inf,) * 3
    xyz = [p.xyz if p.role == "control" else nothing for p in points]
    sigma = [p.sigma if p.role == "control" else open_ for p in points]
    return np.array(xyz, float).reshape(-1, 3), np.array(sigma, float).reshape(-1, 3)


def _lengths(points: list[ControlPoint], control: Control) -> tuple[tuple[int, int, float, float], ...]:
    """Distances by the numbers of their ends; those to points that take no part are left out."""
    number = {point.name: i for i, point in enumerate(points)}
    return tuple(
        (number[d.first], number[d.second], d.length, d.sigma)
        for d in control.distances
        if d.first in number and d.second in number and d.first != d.second
    )


def problem_of(material: GrowthMaterial, parts: list[Part], cameras: Cameras, control: Control) -> tuple[Problem, Datum]:
    """The problem of several parts and their common datum: the first part's, with what all of them set aside."""
    active = np.sort(np.concatenate([part.start.photos for part in parts]))
    number, part_of = np.full(len(material.names), -1, np.int32), np.full(len(material.names), -1)
    number[active] = np.arange(len(active))
    owner = np.full(material.points, -1)
    for i, part in enumerate(parts):
        part_of[part.start.photos] = i
        owner[part.start.known & (owner < 0)] = i
    inside = (number[material.rays.photo] >= 0) & (owner[material.rays.point] >= 0)
    ties = material.rays.take(inside)
    trust = np.stack([part.start.good for part in parts])[np.maximum(part_of[ties.photo], 0), np.flatnonzero(inside)]
    names = tuple(material.names[i] for i in active)
    points = taking_part(control)
    ground = ground_rays(points, {name: i for i, name in enumerate(names)}, cameras)
    rays = Rays(
        np.concatenate([ties.point, ground.point + material.points]).astype(np.int32),
        np.concatenate([number[ties.photo], ground.photo]).astype(np.int32),
        np.vstack([ties.xy, ground.xy]),
        np.concatenate([ties.sigma, ground.sigma]),
    )
    known = _known_together(parts, number, len(active))
    problem = Problem(
        active=active,
        names=names,
        camera_names=material.camera_names,
        cameras=material.cameras,
        camera_of=material.camera_of[active],
        rays=rays,
        good=np.concatenate([trust & (owner[ties.point] == part_of[ties.photo]), np.ones(len(ground), bool)]),
        ties=material.points,
        measured=int((number[material.rays.photo] >= 0).sum()) + len(ground),
        surveyed=points,
        known=known,
        distances=known.distances,
        groups=tuple(tuple(material.names[i] for i in part.start.photos) for part in parts),
    )
    return problem, _datum_together(parts, number, len(active))


def _known_together(parts: list[Part], number: np.ndarray, photos: int) -> Known:
    position, sigma, zenith, top = (np.full((photos, 3), np.nan) for _ in range(4))
    model = np.full_like(parts[0].known.control, np.nan)
    for part in parts:
        own = number[part.start.photos]
        position[own], sigma[own] = part.known.position, part.known.position_sigma
        zenith[own], top[own] = part.known.zenith, part.known.top
        in_first = part.datum.similarity.apply(part.known.control_model) + part.datum.origin - parts[0].datum.origin
        model = np.where(np.isfinite(model), model, in_first)
    first = parts[0].known
    return Known(position, sigma, first.control, first.control_sigma, model, zenith, top, first.distances)


def _datum_together(parts: list[Part], number: np.ndarray, photos: int) -> Datum:
    """A control point is set aside where it is far from its place in a part, and near it in none."""
    positions = np.ones(photos, bool)
    for part in parts:
        positions[number[part.start.photos]] = part.datum.positions_aside
    far = np.any([part.datum.control_aside for part in parts], axis=0)
    near = np.any([part.known.placed & ~part.datum.control_aside for part in parts], axis=0)
    weaknesses = tuple(dict.fromkeys(text for part in parts for text in part.datum.weaknesses))
    return replace(parts[0].datum, positions_aside=positions, control_aside=far & ~near, weaknesses=weaknesses)


def starting_values(
    material: GrowthMaterial, problem: Problem, parts: list[Part], datum: Datum, vertical_sigma: float
) -> tuple[Network, State, np.ndarray]:
    """The network, the state to begin with, and (M,) which rays take part; `vertical_sigma` (rad) of the mean vertical, where a
    part needs it."""
    photos, count = len(problem.names), problem.ties + len(problem.surveyed)
    rotation, centre, point = np.zeros((photos, 3, 3)), np.zeros((photos, 3)), np.zeros((count, 3))
    zenith, vertical, filled = np.zeros((photos, 3)), np.zeros(photos), np.zeros(count, bool)
    for part in parts:
        own = np.searchsorted(problem.active, part.start.photos)
        fit, offset = part.datum.similarity, part.datum.origin - datum.origin
        rotation[own] = part.model.rotation @ fit.rotation.T
        centre[own] = fit.apply(part.model.centre) + offset
        fresh = part.start.known & ~filled[: problem.ties]
        point[: problem.ties][fresh] = fit.apply(part.model.point[fresh]) + offset
        filled[: problem.ties] |= fresh
        if part.datum.zenith is not None:
            told = np.isfinite(part.datum.zenith).all(axis=1)
            zenith[own[told]], vertical[own[told]] = part.datum.zenith[told], 1.0 / (vertical_sigma**2 * told.sum())
    known = problem.known
    surveyed = np.where(np.isfinite(known.control_model), known.control_model, known.control - datum.origin)
    point[problem.ties :] = np.nan_to_num(surveyed)
    state = State(rotation, centre, point, parts[0].model.interior, np.zeros(3))
    network = replace(_network(material, problem, vertical, count), up=zenith)
    network = held(network, known, datum, problem.ties)
    good = problem.good & _placed(problem, network, state, np.isfinite(surveyed).all(axis=1))
    return _with_distances(network, problem, datum, good), state, good


def _network(material: GrowthMaterial, problem: Problem, vertical: np.ndarray, count: int) -> Network:
    present = np.isin(np.arange(len(problem.cameras)), problem.camera_of)[:, None]
    interior = replace(material.interior, free=material.interior.free & present, considered=material.interior.considered & present)
    none, nothing = np.zeros((len(problem.names), 3)), np.zeros((count, 3))
    return Network(problem.camera_of, interior, none, none, nothing, nothing, vertical)


def _placed(problem: Problem, network: Network, state: State, finite: np.ndarray) -> np.ndarray:
    """(M,) rays of tie points, and those of surveyed points that have a place before the camera and hang on enough."""
    rays = problem.rays
    of_person = rays.point >= problem.ties
    ahead = np.abs(residuals(state, rays, network.camera_of)).max(axis=1) < BEHIND
    good = ~of_person | (ahead & finite[np.maximum(rays.point - problem.ties, 0)] if len(finite) else ~of_person)
    count = np.bincount(rays.point[good & of_person], minlength=len(network.point))
    return good & (~of_person | network.point_weight.any(axis=1)[rays.point] | (count[rays.point] >= 2))


def _with_distances(network: Network, problem: Problem, datum: Datum, good: np.ndarray) -> Network:
    """The network with the distances whose ends are both determined; these ends stay among the unknowns."""
    seen = np.bincount(problem.rays.point[good], minlength=len(network.point)) > 0
    rows = [(a + problem.ties, b + problem.ties, *rest) for a, b, *rest in problem.distances]
    rows = [row for row in rows if seen[row[0]] and seen[row[1]]]
    if not rows:
        return network
    ends = np.array([row[:2] for row in rows], np.int64)
    length, sigma = np.array([row[2:] for row in rows]).T
    return replace(network, kept=np.unique(ends), distances=Distances(ends, length, 1.0 / sigma**2))
