"""From an adjusted block to what its sources say of it, and back to a network with the offsets that they need."""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.adjustment.model.interior import given_sigmas
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.solve.whole_block import WholeMotion
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector
from orthomill.tasks.orientation.block.assembly import MEETING, Problem
from orthomill.tasks.orientation.control.ground_points import approximate_points
from orthomill.tasks.orientation.sources.causes import Findings, Groups, causes_of
from orthomill.tasks.orientation.sources.elevation_model import ElevationModel
from orthomill.tasks.orientation.sources.evidence import Source, Told, equations
from orthomill.tasks.orientation.sources.hypotheses import Offset
from orthomill.tasks.orientation.sources.rigid_block import RigidBlock
from orthomill.tasks.orientation.sources.source_table import Said, source_table
from orthomill.tasks.orientation.start.georeference import FAR, Datum

ATTITUDE_SIGMA = {"gimbal": (1.0, 0.5), "aircraft": (3.0, 1.0), "file": (2.0, 1.0)}
"""Standard errors of attitudes by where they come from, degrees: of a photograph, and common to all (the mounting)."""
NOTHING = np.full((3, 3), np.nan)
"""The attitude of a photograph that has none"""
DOWN_SIGMA = 2.0
"""degrees: how far parallel photographs of a camera that looks down are off the vertical on average"""
PARALLEL, PARALLEL_LEAST, STEEP = 4.0, 6, 25.0
"""Photographs look down where their axes scatter by no more degrees about their mean, which is within so many degrees of the
vertical; and how many photographs show that"""
IN_IMAGE = np.array([0.5, 0.5, 1.5])
"""Standard errors of a control point that rays place, in pixels on the ground: heights are less precise than plan."""
GROUND_POINTS = 500
"""Tie points that stand for the ground where it is compared with an elevation model."""
LEAST_SHARE = 1e-4
"""Smallest standard error of a camera constant, in units of it; a constant that is held is not known without error."""


@dataclass(frozen=True, eq=False)
class BlockSources:
    """The block as a rigid body, what the sources say, which causes explain their contradictions, the table of what each says,
    how the photographs belong together, the height (m) of the origin of local coordinates, and the `site` (2,) of the block, m."""

    block: RigidBlock
    told: Told
    found: Findings
    table: tuple[Said, ...]
    groups: Groups
    height_origin: float
    site: np.ndarray

    @property
    def has_offsets(self) -> bool:
        """Whether constant errors of the positions explain contradictions."""
        return any(isinstance(cause, Offset) for cause in self.found.causes)

    def offset_sigmas(self, photos: np.ndarray) -> dict[int, float]:
        """Standard errors of the offset of `photos` (P,) bool against the others by coordinate, m, as the positions scatter: what
        they have in common is no error of their difference. Empty for the offset of all, whose common error counts."""
        place, after = len(self.found.after.parameters), self.found.after
        for cause in reversed(self.found.causes):
            place -= cause.numbers
            if isinstance(cause, Offset) and not cause.photos.all() and (cause.photos == photos).all():
                return {axis: float(np.sqrt(after.covariance[place + i, place + i])) for i, axis in enumerate(cause.axes)}
        return {}


def block_sources(
    photos: Photos, problem: Problem, datum: Datum, network: Network, state: State, model: ElevationModel | None = None
) -> BlockSources | None:
    """What the sources say of a block with this `state`, as `network` gives them, and an elevation model; None for a free
    network."""
    if datum.free or not problem.known.positioned.any():
        return None
    rows = [photos[name] for name in problem.names]
    block = _rigid(problem, state)
    told, groups = replace(_told(problem, datum, network, state, rows, block), model=model), _groups(rows)
    found = causes_of(block, told, groups, datum.origin)
    table = tuple(source_table(block, equations(block, found.told), found.after, found.causes, groups))
    return BlockSources(block, told, found, table, groups, float(datum.origin[2]), datum.origin[:2] + block.middle[:2])


def _rigid(problem: Problem, state: State) -> RigidBlock:
    ties = problem.rays.point < problem.ties
    rays = problem.rays.take(ties & problem.good)
    away = state.centre[rays.photo] - state.point[rays.point]
    along = np.einsum("ni,ni->n", state.rotation[rays.photo, 2], away)
    # Clipped, because single wrong points lie at any depth.
    along = np.clip(along, *np.percentile(along, [2.0, 98.0])) if len(along) else along
    count = np.bincount(rays.photo, minlength=len(problem.names))
    depth = np.bincount(rays.photo, along, minlength=len(problem.names)) / np.maximum(count, 1)
    depth = np.where(count > 0, depth, np.median(depth[count > 0]) if (count > 0).any() else 0.0)
    constant = state.interior[problem.camera_of, 0]
    surveyed = np.flatnonzero(~ties & problem.good)
    own = problem.rays.take(surveyed)
    own = replace(own, point=(own.point - problem.ties).astype(np.int32))
    found = approximate_points(state, problem.cameras, problem.camera_of, own, len(problem.surveyed))
    place = np.where((found.missed > MEETING)[:, None], np.nan, found.point)
    return RigidBlock(
        centre=state.centre,
        rotation=state.rotation,
        depth=depth,
        camera=problem.camera_of,
        control=place,
        pixel=float(np.median(depth / constant)),
        ground=_ground(state, rays),
    )


def _ground(state: State, rays: Rays) -> np.ndarray:
    """(g, 3) tie points in three photographs or more, or in two where there are too few of these; not all of many."""
    count = np.bincount(rays.point, minlength=len(state.point))
    sure = np.flatnonzero(count >= 3)
    sure = sure if len(sure) >= GROUND_POINTS else np.flatnonzero(count >= 2)
    return state.point[sure[:: max(len(sure) // GROUND_POINTS, 1)]]


def _told(problem: Problem, datum: Datum, network: Network, state: State, rows: list[Photo], block: RigidBlock) -> Told:
    known = problem.known
    sigma = np.array([ATTITUDE_SIGMA[photo.attitude_of or "file"] for photo in rows])
    has = np.array([photo.attitude is not None for photo in rows])
    if not has.any() and datum.up is not None and (level := _looking_down(state)) is not None:
        attitude, sigma, has = level, np.full((len(rows), 2), DOWN_SIGMA), np.ones(len(rows), bool)
    else:
        attitude = np.array([NOTHING if p.attitude is None else rotation_matrix(*np.radians(p.attitude)) for p in rows])
    given, constant = network.interior.value[:, 0], state.interior[:, 0]
    share = np.maximum(given_sigmas(network.interior)[:, 0] / given, LEAST_SHARE)
    return Told(
        position=known.position - datum.origin,
        position_sigma=np.where(known.positioned[:, None], known.position_sigma, np.nan),
        control=known.control - datum.origin,
        # Rays place a point in the block with an error of their own.
        control_sigma=np.hypot(known.control_sigma, IN_IMAGE * block.pixel),
        attitude=attitude,
        attitude_sigma=np.radians(sigma[:, 0]),
        mounting_sigma=float(np.radians(sigma[has, 1].max(initial=0.5))),
        constant=given / constant - 1.0,
        constant_sigma=share,
    )


def _looking_down(state: State) -> np.ndarray | None:
    """The attitudes (P, 3, 3) of photographs whose parallel axes are vertical on average; None where they look elsewhere.

    Asked only where positions leave the tilt open and the block rests on that assumption already."""
    axes = state.rotation[:, 2]
    mean = axes.mean(axis=0) / np.linalg.norm(axes.mean(axis=0))
    away = np.degrees(np.arccos(np.clip(axes @ mean, -1.0, 1.0)))
    if len(axes) < PARALLEL_LEAST or np.sqrt((away**2).mean()) > PARALLEL or mean[2] < np.cos(np.radians(STEEP)):
        return None
    # The smallest rotation that takes the mean axis to the vertical.
    turn = np.cross(mean, [0.0, 0.0, 1.0])
    length = float(np.linalg.norm(turn))
    vector = turn / max(length, 1e-12) * np.arcsin(min(length, 1.0))
    return np.asarray(state.rotation @ rotation_of_vector(vector).T)


def _groups(rows: list[Photo]) -> Groups:
    keys = [(photo.flight, photo.serial or "", photo.height_kind or "") for photo in rows]
    number = {key: i for i, key in enumerate(sorted(set(keys)))}
    # Without the time of every photograph the order of their names is that of exposure, as cameras count.
    timed = all(photo.time for photo in rows)
    order = sorted(range(len(rows)), key=lambda i: (rows[i].time or "", i) if timed else ("", i))
    return Groups(np.array([number[key] for key in keys]), np.array(order))


def with_offsets(
    sources: BlockSources, network: Network, state: State, known: np.ndarray, sigma: np.ndarray
) -> tuple[Network, State]:
    """The network with the offsets that were found as unknowns, and the state moved to where the sources agree with them; `known`
    (P, 3) local positions with their standard errors `sigma` (P, 3), of which those that agree take part."""
    shift, start = shifts_of(sources)
    has = sources.told.positioned
    usable = has & _agreeing(sources)
    weight = np.where(usable[:, None], 1.0 / np.where(usable[:, None], sigma, 1.0) ** 2, 0.0)
    centre = np.where(has[:, None], known, 0.0)
    moved = _moved(state, sources.found.after.motion)
    network = _with_attitudes(replace(network, shift=shift, centre=centre, centre_weight=weight), sources.told)
    return network, replace(moved, shift=start)


def _with_attitudes(network: Network, told: Told) -> Network:
    """The network whose mean vertical is that of the attitudes: what an offset of a flight takes from the positions of the tilt of
    the block, attitudes have to give."""
    has = np.isfinite(told.attitude).all(axis=(1, 2))
    if not has.any():
        return network
    # That of the mean, of which each photograph gets its share.
    variance = told.mounting_sigma**2 + float((told.attitude_sigma[has] ** 2).mean()) / has.sum()
    up = np.where(has[:, None], told.attitude[:, :, 2], 0.0)
    return replace(network, up=up, vertical_weight=np.where(has, 1.0 / (variance * has.sum()), 0.0))


def shifts_of(sources: BlockSources) -> tuple[np.ndarray, np.ndarray]:
    """The number of the unknown shift of each coordinate of each position (P, 3), -1 for none, and approximate shifts (S,) m."""
    photos = len(sources.block.centre)
    contains = np.zeros((photos, 3, 0), bool)
    values: list[float] = []
    place = len(sources.found.after.parameters) - sum(cause.numbers for cause in sources.found.causes)
    for cause in sources.found.causes:
        if isinstance(cause, Offset):
            for i, axis in enumerate(cause.axes):
                own = np.zeros((photos, 3, 1), bool)
                own[cause.photos, axis] = True
                contains = np.concatenate([contains, own], axis=2)
                values.append(float(sources.found.after.parameters[place + i]))
        place += cause.numbers
    # Coordinates with the same causes share an unknown.
    patterns, number = np.unique(
        np.concatenate([np.tile(np.arange(3), photos)[:, None], contains.reshape(-1, len(values))], axis=1),
        axis=0,
        return_inverse=True,
    )
    used = patterns[:, 1:].any(axis=1)
    column = np.where(used, np.cumsum(used) - 1, -1)
    return column[number.ravel()].reshape(photos, 3), (patterns[used, 1:] @ np.array(values)).astype(float)


def _agreeing(sources: BlockSources) -> np.ndarray:
    """(P,) bool: photographs whose positions agree with the block once the offsets are taken out."""
    after = sources.found.after
    has = after.has
    A = np.hstack([has.A, *(cause.columns(sources.block, has) for cause in sources.found.causes)])
    rest = after.parameters.copy()
    rest[:7] = 0.0
    sigma = has.sigma * np.array([after.scale[source] for source in after.scale])[has.source]
    far = np.abs(has.y - A @ rest) > np.maximum(FAR * np.maximum(sigma, has.sigma), FAR * sources.block.pixel)
    good = np.ones(len(sources.block.centre), bool)
    good[has.photo[far & (has.photo >= 0) & (has.source != Source.ATTITUDE)]] = False
    return good


def _moved(state: State, motion: np.ndarray) -> State:
    """The state after a motion of the whole block."""
    numbers = np.concatenate([motion[:6], [np.log1p(motion[6])]])
    return WholeMotion(numbers, state.centre.mean(axis=0), 1.0).of(state, np.arange(len(state.point)))
