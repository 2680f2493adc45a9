"""The adjustment of a block that was not measured yet: tie points on the ground that its photographs would share, and what is
known of positions, camera and control.

Every photograph has tie points in von Gruber's areas and between them; measured in every photograph that sees them they count, all
together, as one independent measurement in each area: errors of neighbours are alike.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import INTERIOR, Camera
from orthomill.tasks.adjustment.model.interior import UNKNOWN_SIGMA, camera_covariance, interior_prior
from orthomill.tasks.adjustment.model.interior_settings import WeightedInterior
from orthomill.tasks.adjustment.model.network import NOT_SHIFTED, Interior, Network, Rays, State, common_shift
from orthomill.tasks.geometry.view import View
from orthomill.tasks.orientation.block.self_calibration import AREAS, determinable_without_control
from orthomill.tasks.orientation.planned.planned_block import PlannedBlock

GRID = 5
"""Tie points along each side of a photograph."""
INSET = 0.08
"""Share of a side between the border of a photograph and the outermost ones: a little farther out, neighbours do not see them."""
RELIEF = 0.03
"""Relief of the ground in units of the flying height, root mean square: of fields and villages."""
IMAGE = 0.3
"""px: standard error of a measurement that stands for an area: shutter, stabiliser, what a lens model lacks."""
POINTING = 0.5
"""px: standard error of a control point in a photograph, measured by hand."""
COMMON = 0.9
"""Share of the standard error of a position without corrections that a whole flight has in common."""
GIMBAL, ASSUMED = 1.0, 5.0
"""degrees: standard errors of the mean vertical by attitudes, and of photographs that are taken to look straight down"""
CONTROL = 3
"""Control points from which on the block tells the camera constant from the flying height."""


@dataclass(frozen=True, eq=False)
class PlannedMeasures:
    """What is measured besides the photographs: `control` (n, 3) points on the ground with `sigma` (n, 3), m; standard errors
    (3,) of positions that replace those of the tags (`positions`), and whether the camera was `calibrated`."""

    control: np.ndarray
    sigma: np.ndarray
    positions: tuple[float, float, float] | None = None
    calibrated: bool = False


NO_MEASURES = PlannedMeasures(np.zeros((0, 3)), np.zeros((0, 3)))


@dataclass(frozen=True, eq=False)
class PlannedNetwork:
    """What is to be adjusted: `ties` are the numbers of the first points, control points follow; `shift` (3,) m: standard error of
    what all positions have in common, where no control takes it out."""

    network: Network
    state: State
    rays: Rays
    ties: int
    shift: np.ndarray


def planned_network(block: PlannedBlock, measures: PlannedMeasures = NO_MEASURES) -> PlannedNetwork:
    """The adjustment of a block with what is measured besides."""
    ground = np.vstack([_tie_points(block), measures.control])
    photo, point, xy = _seen(block, ground)
    ties = len(ground) - len(measures.control)
    often = np.bincount(point, minlength=len(ground)) >= 2
    kept = often[point]
    order = np.lexsort((photo[kept], point[kept]))
    photo, point, xy = photo[kept][order], point[kept][order], xy[kept][order]
    rays = Rays(point.astype(np.int32), photo.astype(np.int32), xy, _sigma(block, photo, point, ties))
    interior = _interior(block, measures)
    state = State(block.rotation.copy(), block.centre.copy(), ground, interior.value, np.zeros(3), lens=interior.lens)
    network, shift = _network(block, measures, interior, state)
    state = replace(state, shift=np.zeros(network.shifts))
    # That function has its own account of areas.
    alone = replace(rays, sigma=np.full(len(rays), IMAGE))
    return PlannedNetwork(determinable_without_control(network, state, alone), state, rays, ties, shift)


def _tie_points(block: PlannedBlock) -> np.ndarray:
    """(N, 3) points on mildly undulating ground below those of every photograph."""
    t = np.linspace(INSET, 1.0 - INSET, GRID)
    cols, rows = (side.ravel() for side in np.meshgrid(t, t))
    found = []
    for view in views(block):
        pixels = np.column_stack([cols * (view.camera.width - 1), rows * (view.camera.height - 1)])
        found.append(view.at_height(pixels, block.ground))
    points = np.vstack(found)
    # Oblique views reach beyond the ground that is mapped, up to the horizon.
    near = np.isfinite(points).all(axis=1)
    near[near] = np.linalg.norm(points[near, :2] - np.repeat(block.centre[:, :2], GRID**2, axis=0)[near], axis=1) < 3 * block.height
    points = points[near]
    points[:, 2] += _undulation(block, points[:, :2])
    return points


def _undulation(block: PlannedBlock, xy: np.ndarray) -> np.ndarray:
    """(n,) m: hills as long as twice the flying height."""
    u, v = np.pi * xy.T / block.height
    return RELIEF * block.height * (np.sin(u + 0.3 * v) + np.sin(1.1 * v - 0.4 * u + 1.0))


def views(block: PlannedBlock) -> list[View]:
    """The photographs of the block, with cameras that do not distort."""
    cameras = [_plain(camera) for camera in block.cameras]
    return [
        View(str(i), cameras[k], rotation, centre)
        for i, (k, rotation, centre) in enumerate(zip(block.camera_of, block.rotation, block.centre, strict=True))
    ]


def _plain(camera: Camera) -> Camera:
    """The camera without distortion: how precisely it is known matters here, and not its values."""
    own = {name: getattr(camera, name) for name in ("name", "width", "height", "c", "source")}
    return Camera(**own, covariance=_rows(camera_covariance(camera)))


def _seen(block: PlannedBlock, ground: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Photograph (M,), point (M,) and image coordinates (M, 2) px of every point in every photograph that shows it."""
    photos, points, found = [], [], []
    for i, view in enumerate(views(block)):
        pixels = view.project(ground)
        inside = np.flatnonzero(view.contains(pixels))
        photos.append(np.full(len(inside), i))
        points.append(inside)
        middle = (view.camera.width - 1) / 2, (view.camera.height - 1) / 2
        found.append((pixels[inside] - middle) * (1.0, -1.0))
    return np.concatenate(photos), np.concatenate(points), np.vstack(found)


def _sigma(block: PlannedBlock, photo: np.ndarray, point: np.ndarray, ties: int) -> np.ndarray:
    """(M,) px: so that all tie points of a photograph together weigh as much as one measurement in each area."""
    count = np.bincount(photo[point < ties], minlength=len(block.centre))
    alike = IMAGE * np.sqrt(np.maximum(count / AREAS, 1.0))
    return np.where(point < ties, alike[photo], POINTING)


CALIBRATED = {"c": 1e-3, "x0": 1e-3, "y0": 1e-3, "k1": 2e-3, "k2": 5e-3, "k3": 5e-3, "p1": 1e-4, "p2": 1e-4}
"""Standard errors that a calibration before the flight leaves: c, x0, y0 in units of c; it changes with every focusing."""


def _interior(block: PlannedBlock, measures: PlannedMeasures) -> Interior:
    """The cameras as the block adjustment takes them, with the parameters free that a block may demand."""
    cameras = [_calibrated(camera) if measures.calibrated else _open(camera) for camera in map(_plain, block.cameras)]
    prior = interior_prior(cameras, WeightedInterior(kind="weighted"), fix_nominal=len(measures.control) < CONTROL)
    # A principal point that is wrong by many pixels is demanded by every block; the constant over flat ground by none.
    considered = prior.considered.copy()
    considered[:, 1:] = False
    return replace(prior, considered=considered)


def _open(camera: Camera) -> Camera:
    """The camera with the parameters unknown that nothing is known of, but that lenses have."""
    if camera.source != "exif" or camera.covariance is None:
        return camera
    covariance = np.array(camera.covariance)
    for name, sigma in UNKNOWN_SIGMA.items():
        i = INTERIOR.index(name)
        covariance[i, i] = covariance[i, i] or sigma**2
    return camera.model_copy(update={"covariance": _rows(covariance)})


def _calibrated(camera: Camera) -> Camera:
    unit = {"c": camera.c, "x0": camera.c, "y0": camera.c}
    covariance = np.diag([(CALIBRATED.get(name, 0.0) * unit.get(name, 1.0)) ** 2 for name in INTERIOR])
    return camera.model_copy(update={"covariance": _rows(covariance), "source": "file"})


def _rows(matrix: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix.tolist())


def _network(block: PlannedBlock, measures: PlannedMeasures, interior: Interior, state: State) -> tuple[Network, np.ndarray]:
    sigma = block.sigma if measures.positions is None else np.broadcast_to(measures.positions, block.sigma.shape)
    common = block.common & (measures.positions is None)
    own = np.where(common[:, None], np.sqrt(1.0 - COMMON**2) * sigma, sigma)
    shared = COMMON * np.median(sigma[common], axis=0) if common.any() else np.zeros(3)
    point_weight = np.zeros_like(state.point)
    if len(measures.control):
        point_weight[-len(measures.control) :] = 1.0 / measures.sigma**2
    network = Network(
        camera_of=block.camera_of,
        interior=interior,
        centre=block.centre,
        centre_weight=1.0 / own**2,
        point=state.point,
        point_weight=point_weight,
        vertical_weight=np.full(len(block.centre), 1.0 / (len(block.centre) * _vertical_sigma(block) ** 2)),
        up=block.rotation[:, :, 2],
        shift=common_shift(len(block.centre)) if len(measures.control) and common.any() else NOT_SHIFTED,
    )
    return network, np.zeros(3) if network.shifts else shared


def _vertical_sigma(block: PlannedBlock) -> float:
    """rad: of the mean vertical, by a gimbal or by the assumption that the photographs look straight down."""
    return float(np.radians(GIMBAL if block.looks.any() else ASSUMED))
