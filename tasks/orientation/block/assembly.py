"""From starts and datums to the numbers of one adjustment.

Every part has its photographs, its model and its datum; parts that share the project's system are adjusted together. A tie point
belongs to one part, and only the rays of that part's photographs are used; surveyed points belong to all.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.findings.block_findings import BlockFinding
from orthomill.schemas.observations import Control, ControlPoint
from orthomill.schemas.orientation import PositionOffset, SourceStatement
from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.model.collinearity import BEHIND, residuals
from orthomill.tasks.adjustment.model.network import Distances, Network, Rays, State
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.block.own_constants import OwnConstant
from orthomill.tasks.orientation.control.ground_points import ApproximatePoints, approximate_points
from orthomill.tasks.orientation.measurements import ground_rays
from orthomill.tasks.orientation.start.block_growth import GrowthMaterial
from orthomill.tasks.orientation.start.block_start import BlockStart
from orthomill.tasks.orientation.start.georeference import Datum, Known, with_datum
from orthomill.tasks.orientation.start.up_direction import TOP

MEETING = 0.01
"""rad: where the rays of a control point miss each other by more, one of them belongs to another point; only its coordinates then
place it, and show which ray is wrong. Marks that are all less good may miss by as much as they do."""
BY_CHANCE = 4.0
"""Rays miss by this many standard errors of a mark so rarely that one of them belongs to another point."""
WORST_MARKS = 0.03
"""rad: standard error of a mark from which on it is none: marks of another photograph or another size miss by a tenth."""
FEWEST_MARKED = 3
"""Points with two rays or more that show how good marks are."""
DEPTHS = 2.0
"""Rays that meet this many times nearer or farther than tie points lie do so by chance, too."""


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
    that were never intersected; `surveyed`: points that a person measured, except check points; `groups`: names by part;
    `receivers`: serial numbers of several drones; `gnss_groups`: what tells groups of positions apart that were measured alike
    (empty: all were)."""

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
    receivers: tuple[str, ...] = ()
    gnss_groups: tuple[str, ...] = ()

    @property
    def frame_sizes(self) -> np.ndarray:
        """(p, 2) px: width and height of the photographs."""
        return np.array([(self.cameras[k].width, self.cameras[k].height) for k in self.camera_of], float)

    def constant_of(self, owner: str) -> float:
        """The given constant (px) of the camera of this name; 0 for any other."""
        return self.cameras[self.camera_names.index(owner)].c if owner in self.camera_names else 0.0


@dataclass(frozen=True, eq=False)
class BlockResults:
    """All that the tables are made from; `findings` about sources and cameras; `restart` (C,) px: camera constants with which the
    start is to be made again (NaN: as given; None: all are); `statements`: what each source says of the block; `zooms`:
    photographs that may have other camera constants; `offsets`: constant errors of positions; `own` (P, 3) m: standard errors of
    the own parts of the positions, where they are told apart from what flights have in common."""

    cameras: Cameras
    problem: Problem
    result: Adjustment
    datum: Datum
    findings: tuple[BlockFinding, ...] = ()
    restart: np.ndarray | None = None
    statements: tuple[SourceStatement, ...] = ()
    zooms: tuple[OwnConstant, ...] = ()
    offsets: tuple[PositionOffset, ...] = ()
    own: np.ndarray | None = None


def taking_part(control: Control) -> list[ControlPoint]:
    """The control points, and the tie points that a person measured in two photographs or more."""
    return [point for point in control.points if point.role == "control" or (point.role == "tie" and len(point.measurements) >= 2)]


def known_of(
    photos: Photos, cameras: Cameras, material: GrowthMaterial, start: BlockStart, control: Control, tops: Mapping[str, np.ndarray]
) -> tuple[State, Known]:
    """The model of a start, with its photographs only, and what is known of these and of the ground; `tops`: the direction to the
    top of those photographs where it is not the y axis of the image system."""
    model = model_of(start)
    names = tuple(material.names[i] for i in start.photos)
    points = taking_part(control)
    rays = ground_rays(points, {name: i for i, name in enumerate(names)}, cameras)
    camera_of = material.camera_of[start.photos]
    found = approximate_points(model, material.cameras, camera_of, rays, len(points))
    placed, marks = found.point, mark_sigma(rays, found)
    # Tie points measured by a person have no coordinates against which a wrong ray could be found.
    surveyed = np.array([point.role == "control" for point in points], bool)
    twice = surveyed & np.isfinite(placed).all(axis=1)
    placed[surveyed & ((found.missed > meeting(marks)) | ~_at_depth(material, start, model, rays, placed))] = np.nan
    return model, Known(
        *_positions(photos, names),
        *_coordinates(points),
        placed,
        _up_directions(photos, names),
        np.array([tops.get(name, TOP) for name in names]),
        _lengths(points, control),
        int(twice.sum()),
        int((twice & ~np.isfinite(placed).all(axis=1)).sum()),
        found.blur * np.maximum(_stated_sigma(rays, material.cameras, camera_of), marks),
    )


def mark_sigma(rays: Rays, found: ApproximatePoints) -> float:
    """rad: the standard error of the marks in photographs, by how the rays of most points miss each other; 0 for too few points,
    and for what are no marks of these points."""
    sigma = mark_scatter(rays, found)
    return 0.0 if sigma > WORST_MARKS else sigma


def mark_scatter(rays: Rays, found: ApproximatePoints) -> float:
    """rad: as `mark_sigma`, however large; 0 for too few points."""
    count = np.bincount(rays.point, minlength=len(found.missed))
    left = 2 * count - 3
    known = (count >= 2) & np.isfinite(found.missed)
    if known.sum() < FEWEST_MARKED:
        return 0.0
    # The median of chi-squared by Wilson and Hilferty: two rays have one number to spare, whose square is mostly small.
    usual = left[known] * (1.0 - 2.0 / (9.0 * left[known])) ** 3
    return float(np.sqrt(np.median(found.missed[known] ** 2 * count[known] / usual)))


def meeting(marks: float) -> float:
    """rad by which the rays of a point may miss each other where marks are good to `marks` rad."""
    return max(MEETING, BY_CHANCE * marks)


def _stated_sigma(rays: Rays, cameras: list[Camera], camera_of: np.ndarray) -> float:
    """rad: the standard error of a mark as it was stated."""
    constant = np.array([camera.c for camera in cameras])[camera_of[rays.photo]]
    return float(np.median(rays.sigma / constant)) if len(rays) else 0.0


def model_of(start: BlockStart) -> State:
    """The state of a start with its photographs only; NaN for points that it does not know."""
    return replace(
        start.state,
        rotation=start.state.rotation[start.photos],
        centre=start.state.centre[start.photos],
        point=np.where(start.known[:, None], start.state.point, np.nan),
    )


def _at_depth(material: GrowthMaterial, start: BlockStart, model: State, rays: Rays, placed: np.ndarray) -> np.ndarray:
    """(n,) bool: points that lie about as far before their photographs as tie points do: two rays of different points may meet by
    chance, but at another depth."""
    own = start.good & start.known[material.rays.point] & np.isin(material.rays.photo, start.photos)
    photo = np.searchsorted(start.photos, material.rays.photo[own])
    # Percentiles, because some tie points of a start are wrong matches at any depth.
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


def _up_directions(photos: Photos, names: tuple[str, ...]) -> np.ndarray:
    """(P, 3) the up direction in the image systems by the attitudes of the photographs; NaN where they have none."""
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


@dataclass(frozen=True, eq=False)
class _Membership:
    """`active` (p,) numbers of the photographs in any part, `number` (P,) their places in it (-1: in none), `part_of` (P,) their
    parts (-1: none), `owner` (N,) the parts of the tie points (-1: none)."""

    active: np.ndarray
    number: np.ndarray
    part_of: np.ndarray
    owner: np.ndarray


def _membership(material: GrowthMaterial, parts: list[Part]) -> _Membership:
    active = np.sort(np.concatenate([part.start.photos for part in parts]))
    number, part_of = np.full(len(material.names), -1, np.int32), np.full(len(material.names), -1)
    number[active] = np.arange(len(active))
    owner = np.full(material.points, -1)
    for i, part in enumerate(parts):
        part_of[part.start.photos] = i
        # Parts come with the largest first: a track that several of them know is wrong in one, more likely in the smaller.
        owner[part.start.known & (owner < 0)] = i
    return _Membership(active, number, part_of, owner)


def problem_of(material: GrowthMaterial, parts: list[Part], cameras: Cameras, control: Control) -> tuple[Problem, Datum]:
    """The problem of several parts and their common datum: that of the first part, less what all of them set aside."""
    member = _membership(material, parts)
    names, points = tuple(material.names[i] for i in member.active), taking_part(control)
    ties, good = _tie_rays(material, parts, member)
    ground = ground_rays(points, {name: i for i, name in enumerate(names)}, cameras)
    known = _known_together(parts, member.number, len(member.active))
    problem = Problem(
        active=member.active,
        names=names,
        camera_names=material.camera_names,
        cameras=material.cameras,
        camera_of=material.camera_of[member.active],
        rays=_with_surveyed(ties, ground, material.points),
        good=np.concatenate([good, np.ones(len(ground), bool)]),
        ties=material.points,
        measured=int((member.number[material.rays.photo] >= 0).sum()) + len(ground),
        surveyed=points,
        known=known,
        distances=known.distances,
        groups=tuple(tuple(material.names[i] for i in part.start.photos) for part in parts),
    )
    return problem, _datum_together(parts, member.number, len(member.active))


def with_receivers(problem: Problem, photos: Photos) -> tuple[Problem, np.ndarray]:
    """The problem with the serial numbers of its drones, where there are several, and the number of the drone of each photograph
    (P,); empty for one."""
    serials = [photos[name].serial or "" for name in problem.names]
    names = sorted(set(serials))
    if len(names) < 2:
        return problem, np.zeros(0, np.int64)
    return replace(problem, receivers=tuple(names)), np.array([names.index(serial) for serial in serials])


def with_gnss_groups(problem: Problem, photos: Photos) -> tuple[Problem, np.ndarray]:
    """The problem with the names of the groups of positions that one receiver measured with solutions of one kind, where there are
    several, and the number of the group of each photograph (P,); empty for one."""
    has, rows = problem.known.positioned, [photos[name] for name in problem.names]
    kinds = [(photo.serial or "", photo.fix or "") for photo in rows]
    several = [len({kind[part] for kind, own in zip(kinds, has, strict=True) if own}) > 1 for part in (0, 1)]
    names = [_gnss_group(serial if several[0] else None, fix if several[1] else None) for serial, fix in kinds]
    found = list(dict.fromkeys(sorted(name for name, own in zip(names, has, strict=True) if own)))
    if len(found) < 2:
        return problem, np.zeros(0, np.int64)
    # Photographs without a position belong to none; their number is never used.
    number = np.array([found.index(name) if own else 0 for name, own in zip(names, has, strict=True)])
    return replace(problem, gnss_groups=tuple(found)), number


def _gnss_group(serial: str | None, fix: str | None) -> str:
    words = [] if serial is None else [serial or "photographs without serial number"]
    return ", ".join([*words, *([] if fix is None else [f"{fix or 'unstated'} solutions"])])


def _tie_rays(material: GrowthMaterial, parts: list[Part], member: _Membership) -> tuple[Rays, np.ndarray]:
    """The rays of the tie points in local photograph numbers, and (M,) bool which of them the part of their photograph trusts and
    owns."""
    inside = (member.number[material.rays.photo] >= 0) & (member.owner[material.rays.point] >= 0)
    ties = material.rays.take(inside)
    part = member.part_of[ties.photo]
    trusted = np.stack([part.start.good for part in parts])[np.maximum(part, 0), np.flatnonzero(inside)]
    return replace(ties, photo=member.number[ties.photo]), trusted & (member.owner[ties.point] == part)


def _with_surveyed(ties: Rays, ground: Rays, first: int) -> Rays:
    """Rays of tie points, then those of surveyed points, which are numbered from `first` on."""
    return Rays(
        np.concatenate([ties.point, ground.point + first]).astype(np.int32),
        np.concatenate([ties.photo, ground.photo]).astype(np.int32),
        np.vstack([ties.xy, ground.xy]),
        np.concatenate([ties.sigma, ground.sigma]),
    )


def _known_together(parts: list[Part], number: np.ndarray, photos: int) -> Known:
    position, sigma, up, top = (np.full((photos, 3), np.nan) for _ in range(4))
    model = np.full_like(parts[0].known.control, np.nan)
    for part in parts:
        own = number[part.start.photos]
        position[own], sigma[own] = part.known.position, part.known.position_sigma
        up[own], top[own] = part.known.up, part.known.top
        # Every part placed the same point in its own model; the first that has it gives the starting value.
        in_first = part.datum.similarity.apply(part.known.control_model) + part.datum.origin - parts[0].datum.origin
        model = np.where(np.isfinite(model), model, in_first)
    first = parts[0].known
    return Known(
        position=position,
        position_sigma=sigma,
        control=first.control,
        control_sigma=first.control_sigma,
        control_model=model,
        up=up,
        top=top,
        distances=first.distances,
    )


def _datum_together(parts: list[Part], number: np.ndarray, photos: int) -> Datum:
    """A control point is set aside where it is far from its place in a part, and near it in none."""
    # Photographs in no part have no position to use.
    positions = np.ones(photos, bool)
    for part in parts:
        positions[number[part.start.photos]] = part.datum.positions_aside
    far = np.any([part.datum.control_aside for part in parts], axis=0)
    near = np.any([part.known.placed & ~part.datum.control_aside for part in parts], axis=0)
    findings = tuple(dict.fromkeys(finding for part in parts for finding in part.datum.findings))
    return replace(parts[0].datum, positions_aside=positions, control_aside=far & ~near, findings=findings)


@dataclass(frozen=True, eq=False)
class _Placed:
    """The starts of all parts in the system of the first datum: photographs and points, the up direction (p, 3) that is expected
    in the image systems, and the weights (p,) 1/rad^2 of its mean (0: not needed)."""

    rotation: np.ndarray
    centre: np.ndarray
    point: np.ndarray
    up: np.ndarray
    vertical: np.ndarray


def starting_values(
    material: GrowthMaterial, problem: Problem, parts: list[Part], datum: Datum, vertical_sigma: float
) -> tuple[Network, State, np.ndarray]:
    """The network, the state to begin with, and (M,) which rays take part; `vertical_sigma` (rad) of the mean vertical, where a
    part needs it."""
    count, known = problem.ties + len(problem.surveyed), problem.known
    start = _placed_parts(problem, parts, datum, vertical_sigma, count)
    surveyed = np.where(np.isfinite(known.control_model), known.control_model, known.control - datum.origin)
    # Points without a place stay at 0 and lose their rays below.
    start.point[problem.ties :] = np.nan_to_num(surveyed)
    state = State(start.rotation, start.centre, start.point, parts[0].model.interior, np.zeros(0), lens=parts[0].model.lens)
    network = replace(_network(material, problem, start.vertical, count), up=start.up)
    network = with_datum(network, known, datum, problem.ties)
    finite = np.asarray(np.isfinite(surveyed).all(axis=1))
    good = problem.good & _usable(problem, network, state, finite)
    return _with_distances(network, problem, datum, good), state, good


def _placed_parts(problem: Problem, parts: list[Part], datum: Datum, vertical_sigma: float, count: int) -> _Placed:
    photos = len(problem.names)
    start = _Placed(np.zeros((photos, 3, 3)), np.zeros((photos, 3)), np.zeros((count, 3)), np.zeros((photos, 3)), np.zeros(photos))
    filled = np.zeros(problem.ties, bool)
    for part in parts:
        own = np.searchsorted(problem.active, part.start.photos)
        fit, offset = part.datum.similarity, part.datum.origin - datum.origin
        start.rotation[own] = part.model.rotation @ fit.rotation.T
        start.centre[own] = fit.apply(part.model.centre) + offset
        fresh = part.start.known & ~filled
        start.point[: problem.ties][fresh] = fit.apply(part.model.point[fresh]) + offset
        filled |= fresh
        if part.datum.up is not None:
            known = np.isfinite(part.datum.up).all(axis=1)
            start.up[own[known]] = part.datum.up[known]
            # vertical_sigma is that of the mean over the photographs, so each gets its share of the weight.
            start.vertical[own[known]] = 1.0 / (vertical_sigma**2 * known.sum())
    return start


def _network(material: GrowthMaterial, problem: Problem, vertical: np.ndarray, count: int) -> Network:
    # Cameras of photographs outside of this block would leave empty columns in the normal equations.
    present = np.isin(np.arange(len(problem.cameras)), problem.camera_of)[:, None]
    interior = replace(material.interior, free=material.interior.free & present, considered=material.interior.considered & present)
    none, nothing = np.zeros((len(problem.names), 3)), np.zeros((count, 3))
    return Network(
        camera_of=problem.camera_of,
        interior=interior,
        centre=none,
        centre_weight=none,
        point=nothing,
        point_weight=nothing,
        vertical_weight=vertical,
    )


def _usable(problem: Problem, network: Network, state: State, finite: np.ndarray) -> np.ndarray:
    """(M,) rays of tie points, and those of surveyed points that have a place in front of the camera and are sufficiently observed:
    by coordinates or by two rays."""
    rays = problem.rays
    surveyed = rays.point >= problem.ties
    placed = np.concatenate([np.ones(problem.ties, bool), finite])[rays.point]
    ahead = np.abs(residuals(state, rays, network.camera_of)).max(axis=1) < BEHIND
    good: np.ndarray = ~surveyed | (ahead & placed)
    count = np.bincount(rays.point[good & surveyed], minlength=len(network.point))
    with_coordinates = np.asarray(network.point_weight.any(axis=1))
    usable: np.ndarray = good & (~surveyed | with_coordinates[rays.point] | (count[rays.point] >= 2))
    return usable


def _with_distances(network: Network, problem: Problem, datum: Datum, good: np.ndarray) -> Network:
    """The network with the distances whose ends are both determined; these ends stay among the unknowns."""
    seen: np.ndarray = np.bincount(problem.rays.point[good], minlength=len(network.point)) > 0
    # An end without rays has no coordinates among the unknowns, and a distance to it would be singular.
    rows = [
        (a + problem.ties, b + problem.ties, length, sigma)
        for a, b, length, sigma in problem.distances
        if seen[a + problem.ties] and seen[b + problem.ties]
    ]
    if not rows:
        return network
    ends = np.array([row[:2] for row in rows], np.int64)
    length, sigma = np.array([row[2:] for row in rows]).T
    return replace(network, kept=np.unique(ends), distances=Distances(ends, length, 1.0 / sigma**2))
