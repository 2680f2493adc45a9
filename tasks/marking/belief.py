"""What is known of the orientation of all photographs before a mark: an estimate with its covariance.

After the block adjustment this is the block, with the covariance that its tie points and positions give without any mark; before
it, the positions and attitudes of the tags. Marks are then added as observations (mark_solution.py), at a cost that does not depend
on the number of tie points.

Unknowns: six per photograph (X, Y, Z and a rotation vector in the image system, as in the adjustment), then the free interior
parameters. Coordinates are local, less `offset`.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import INTERIOR, Camera, Cameras
from orthomill.schemas.observations import GroundPoints, ImageResiduals, TiePoints
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.adjustment.model.datum import add_prior
from orthomill.tasks.adjustment.model.linearisation import linearised, structure
from orthomill.tasks.adjustment.model.network import Interior, Network, Rays, State
from orthomill.tasks.adjustment.solve.normal_equations import reduced_normals
from orthomill.tasks.geometry.distortion import lens_of
from orthomill.tasks.geometry.rotation import rotation_derivatives, rotation_matrix
from orthomill.tasks.geometry.view import View

MOST_RAYS = 150_000
"""Of more rays a share stands for all: their covariance is needed to two digits, and within seconds."""
MOST_ENLARGED = 8.0
"""times"""
UNKNOWN_HEADING = np.pi
GIMBAL, AIRCRAFT, NO_ATTITUDE = np.radians(2.0), np.radians(10.0), np.radians(20.0)
"""Standard errors of attitudes by the tags of a gimbal, of an aircraft, and of a camera that is taken to look straight down."""
ABOVE_GROUND = 50.0
"""m: the usual flying height, where nothing tells it"""


@dataclass(frozen=True, eq=False)
class Belief:
    """`names` (P,) of the photographs, their `cameras`, the `state` (its points mean nothing), the `network` that numbers the
    unknowns, the `covariance` (n, n) of these, the `offset` (3,) m, the `ground` below (height, standard error), m, and whether the
    photographs are `oriented` by a block."""

    names: tuple[str, ...]
    cameras: tuple[Camera, ...]
    state: State
    network: Network
    covariance: np.ndarray
    offset: np.ndarray
    ground: tuple[float, float]
    oriented: bool

    @property
    def number(self) -> dict[str, int]:
        """photo -> its number."""
        return {name: i for i, name in enumerate(self.names)}

    def camera_of(self, photo: int) -> Camera:
        """The camera of a photograph, by number."""
        return self.cameras[self.network.camera_of[photo]]

    def view_of(self, photo: int) -> View:
        """A photograph at its present place, in local coordinates."""
        return View(self.names[photo], self.camera_of(photo), self.state.rotation[photo], self.state.centre[photo])


def block_belief(
    block: Block, nominal: Cameras, photos: Photos, tie_points: TiePoints, residuals: ImageResiduals, ground: GroundPoints
) -> Belief:
    """The belief of an adjusted block by its tie points and positions, at its adjusted values; `nominal` are the cameras before the
    adjustment, whose covariance is prior information."""
    start = _of_state(block, nominal)
    rays, points = _tie_rays(start, photos, tie_points, residuals, ground)
    state = replace(start.state, point=points)
    spread = max(float(np.ptp(start.state.centre, axis=0).max()), 1.0)
    given = [photos[name].position_sigma if photos[name].position is not None else None for name in start.names]
    # Without positions a weak knowledge of everything stands for the datum that a free block lacks.
    sigma = np.array([one if one is not None else (spread,) * 3 for one in given], float)
    network = replace(
        start.network,
        centre=state.centre,
        centre_weight=1.0 / sigma**2,
        point=points,
        point_weight=np.zeros_like(points),
        vertical_weight=np.zeros(len(start.names)),
    )
    covariance = covariance_by(network, state, rays)
    # Errors of images are correlated, which the block knows: its photographs lie less surely to each other than by so many rays.
    if (larger := _relative_ratio(covariance, block, start.number)) > 1.0:
        covariance = covariance_by(network, state, replace(rays, sigma=rays.sigma * min(larger, MOST_ENLARGED)))
    return replace(start, state=state, network=network, covariance=_with_common_shift(covariance, block))


def covariance_by(network: Network, state: State, rays: Rays) -> np.ndarray:
    """(n, n) of the unknowns by tie points (the points of the state, with their rays) and the prior information of a network."""
    linear = linearised(network, state, rays)
    normals = reduced_normals(linear, structure(network, state, linear).pattern)
    add_prior(network, state, normals.matrix)
    dense = normals.matrix.dense()
    turns = (6 * np.arange(network.photos)[:, None] + np.arange(3, 6)).ravel()
    # Ten radians: only what nothing else determines (the turn about a line of positions) notices.
    dense[turns, turns] += 1e-2
    covariance = np.linalg.inv(dense)
    return 0.5 * (covariance + covariance.T)


def stored_belief(block: Block, nominal: Cameras) -> Belief:
    """The belief of a block whose tie points are not at hand: the covariance that is stored of each photograph by itself."""
    start = _of_state(block, nominal)
    covariance = np.zeros((start.network.unknowns, start.network.unknowns))
    for i, photo in enumerate(block.photos):
        if photo.covariance is not None:
            to_vectors = np.eye(6)
            to_vectors[3:, 3:] = _vectors_of_angles(photo.omega_phi_kappa, start.state.rotation[i])
            own = to_vectors @ np.array(photo.covariance) @ to_vectors.T
            covariance[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = own
    return replace(start, covariance=covariance)


def tag_belief(photos: Photos, cameras: Cameras, ground: float | None = None) -> Belief:
    """The belief by positions and attitudes of the tags, of photographs with a position; `ground`: the height of the terrain, m."""
    placed = [photo for photo in photos.photos if photo.position is not None]
    centres = np.array([photo.position for photo in placed], float).reshape(-1, 3)
    offset = centres.mean(axis=0).round() if len(placed) else np.zeros(3)
    names = sorted({cameras.of_photo[photo.name] for photo in placed})
    used = tuple(cameras.cameras[name] for name in names)
    attitudes = [photo.attitude or (0.0, 0.0, 0.0) for photo in placed]
    rotation = np.array([rotation_matrix(*np.radians(angles)) for angles in attitudes]).reshape(-1, 3, 3)
    network = _network(np.array([names.index(cameras.of_photo[photo.name]) for photo in placed], np.int64), used, fixed=True)
    covariance = np.zeros((network.unknowns, network.unknowns))
    for i, photo in enumerate(placed):
        position = photo.position_sigma or (3.0, 3.0, 5.0)
        variances = np.array([*position, *_attitude_sigma(photo)]) ** 2
        covariance[np.arange(6 * i, 6 * i + 6), np.arange(6 * i, 6 * i + 6)] = variances
    heights = [
        photo.position[2] - photo.relative_height for photo in placed if photo.position and photo.relative_height is not None
    ]
    below = float(np.median(heights)) if heights else float(centres[:, 2].mean()) - ABOVE_GROUND if len(placed) else 0.0
    level = (below if ground is None else ground) - offset[2]
    state = _state(rotation, centres - offset, used)
    rough = (float(level), 0.2 * ABOVE_GROUND if ground is None else 3.0)
    return Belief(tuple(photo.name for photo in placed), used, state, network, covariance, offset, rough, False)


def _attitude_sigma(photo: Photo) -> tuple[float, float, float]:
    if photo.attitude is None:
        return NO_ATTITUDE, NO_ATTITUDE, UNKNOWN_HEADING
    own = GIMBAL if photo.attitude_of == "gimbal" else AIRCRAFT
    return own, own, 2.0 * own


def _vectors_of_angles(degrees: tuple[float, float, float], rotation: np.ndarray) -> np.ndarray:
    """(3, 3): the rotation vectors in the image system that stand for omega, phi and kappa."""
    turns = rotation_derivatives(*np.radians(degrees)) @ rotation.T
    return np.array([[turn[2, 1], turn[0, 2], turn[1, 0]] for turn in turns]).T


def _of_state(block: Block, nominal: Cameras) -> Belief:
    names = sorted({block.of_photo[name] for name in block.names})
    used = tuple(block.cameras[name] for name in names)
    offset = np.array([photo.centre for photo in block.photos]).mean(axis=0).round()
    rotation = np.array([rotation_matrix(*np.radians(photo.omega_phi_kappa)) for photo in block.photos])
    centre = np.array([photo.centre for photo in block.photos]) - offset
    before = tuple(nominal.cameras.get(name, camera) for name, camera in zip(names, used, strict=True))
    network = _network(np.array([names.index(block.of_photo[name]) for name in block.names], np.int64), before, fixed=False)
    level = 0.5 * (block.ground_low + block.ground_high) - offset[2]
    rough = (float(level), max(0.5 * (block.ground_high - block.ground_low), 0.5))
    return Belief(block.names, used, _state(rotation, centre, used), network, np.zeros((0, 0)), offset, rough, True)


def _state(rotation: np.ndarray, centre: np.ndarray, cameras: tuple[Camera, ...]) -> State:
    interior = np.array([camera.interior for camera in cameras]).reshape(-1, len(INTERIOR))
    lens = np.array([lens_of(camera).model for camera in cameras], float)
    return State(rotation, centre, np.zeros((0, 3)), interior, np.zeros(0), lens=lens)


def _network(camera_of: np.ndarray, cameras: tuple[Camera, ...], fixed: bool) -> Network:
    """The numbering of the unknowns, with the prior information of cameras: what their covariance leaves open is unknown."""
    count, k = len(cameras), len(INTERIOR)
    free, weight = np.zeros((count, k), bool), np.zeros((count, k, k))
    for i, camera in enumerate(cameras):
        if camera.covariance is not None and not fixed:
            known = np.array(camera.covariance)
            free[i] = np.diagonal(known) > 0
            weight[i][np.ix_(free[i], free[i])] = np.linalg.inv(known[np.ix_(free[i], free[i])])
    value = np.array([camera.interior for camera in cameras]).reshape(-1, k)
    photos, none = len(camera_of), np.zeros((0, 3))
    interior = Interior(value, weight, free, np.zeros_like(free))
    return Network(camera_of, interior, np.zeros((photos, 3)), np.zeros((photos, 3)), none, none, np.zeros(photos))


def _tie_rays(
    start: Belief, photos: Photos, tie_points: TiePoints, residuals: ImageResiduals, ground: GroundPoints
) -> tuple[Rays, np.ndarray]:
    """The rays that took part in the adjustment, and the places (N, 3) m, local, of their points."""
    count = len(photos.names)
    kept = residuals.used & (residuals.track >= 0)
    key = residuals.track[kept].astype(np.int64) * count + residuals.photo[kept]
    own = np.isin(tie_points.track.astype(np.int64) * count + tie_points.photo, key) & np.isin(tie_points.track, ground.track)
    thin = max(1, int(np.ceil(own.sum() / MOST_RAYS)))
    tracks = np.unique(tie_points.track[own])[::thin]
    index = np.flatnonzero(own & np.isin(tie_points.track, tracks))
    index = index[np.lexsort((tie_points.photo[index], tie_points.track[index]))]
    place = np.argsort(ground.track)
    there = place[np.searchsorted(ground.track[place], tracks)]
    points = np.column_stack([ground.x, ground.y, ground.z])[there] - start.offset
    number = start.number
    to_block = np.array([number.get(name, -1) for name in photos.names])
    photo = to_block[tie_points.photo[index]]
    index, photo = index[photo >= 0], photo[photo >= 0]
    size = np.array([(camera.width, camera.height) for camera in start.cameras])[start.network.camera_of[photo]]
    col, row = tie_points.col[index], tie_points.row[index]
    xy = np.column_stack([col - (size[:, 0] - 1) / 2, (size[:, 1] - 1) / 2 - row])
    sigma = np.maximum(tie_points.sigma[index].astype(np.float64), 1e-3) / np.sqrt(thin)
    point = np.searchsorted(tracks, tie_points.track[index]).astype(np.int32)
    return Rays(point, photo.astype(np.int32), xy, sigma), points


def _relative_ratio(covariance: np.ndarray, block: Block, number: dict[str, int]) -> float:
    """How many times larger the block states the standard errors of its photographs to each other; 1 where it states none."""
    own = {photo.photo: np.array(photo.covariance)[:3, :3] for photo in block.photos if photo.covariance is not None}
    ratios = []
    for pair in block.joint:
        if pair.first in own and pair.second in own:
            shared = np.array(pair.covariance)[:3, :3]
            stated = np.trace(own[pair.first] + own[pair.second] - shared - shared.T)
            i, j = (slice(6 * number[name], 6 * number[name] + 3) for name in (pair.first, pair.second))
            mine = np.trace(covariance[i, i] + covariance[j, j] - covariance[i, j] - covariance[j, i])
            ratios.append(np.sqrt(max(stated, 0.0) / mine))
    return float(np.median(ratios)) if ratios else 1.0


def _with_common_shift(covariance: np.ndarray, block: Block) -> np.ndarray:
    """The covariance with what the block states of its centres beyond it: an error that all positions share, as those of one base
    station do. What the block is by itself, and its cameras, stay as they are."""
    stated = [np.diag(np.array(photo.covariance))[:3] for photo in block.photos if photo.covariance is not None]
    if not stated:
        return covariance
    count = len(block.photos)
    own = np.diag(covariance)[: 6 * count].reshape(count, 6)[:, :3]
    shift = np.maximum(np.median(stated, axis=0) - np.median(own, axis=0), 0.0)
    moves = np.zeros((len(covariance), 3))
    moves[: 6 * count] = np.tile(np.eye(6, 3), (count, 1))
    return covariance + (moves * shift) @ moves.T
