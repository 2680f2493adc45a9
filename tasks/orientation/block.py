"""The block: start, datum, bundle, and the account of it in tables.

Photographs are renumbered to those that joined, control points follow the tie points, and coordinates are local while numbers are
crunched; all that leaves this file is in the project's CRS again.
"""

from dataclasses import replace

import cv2
import numpy as np

from schemas.camera import Cameras
from schemas.observations import Control, TiePoints
from schemas.orientation import RelativeOrientations
from schemas.photo import Photos
from schemas.settings import Settings
from tasks.adjustment.bundle import BlunderTest, adjust
from tasks.adjustment.interior import InteriorChoice, interior_prior
from tasks.adjustment.network import Network, Rays, State
from tasks.adjustment.result import Adjustment
from tasks.orientation.account import (
    Problem,
    block_precision,
    block_table,
    ground_points,
    ground_residuals,
    image_residuals,
)
from tasks.orientation.block_start import Material, Start, start_block
from tasks.orientation.georeference import Datum, Known, choose_datum, held, to_datum
from tasks.orientation.ground_points import approximate_points
from tasks.orientation.measurements import ground_rays, tie_rays

cv2.setNumThreads(1)


class BlockChoices(Settings):
    """What the workflow decides: the part of the interior orientation, a common shift of the GNSS positions, the standard error of
    the mean viewing direction where it is needed (degrees), and the limit of the blunder test in standard errors."""

    interior: InteriorChoice
    gnss_shift: bool
    vertical_sigma: float
    rejection: float


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
    usable = [point for point in control.points if point.role == "control" and len(point.measurements) >= 2]
    material, tracks = _material(photos, cameras, tie_points, relative, choices, len(usable) < 3)
    start = start_block(material)
    problem = _problem(material, start, cameras, control)
    model = _model(start, problem)
    known = _known(photos, cameras, problem, model)
    datum = choose_datum(model, known, np.radians(choices.vertical_sigma), choices.gnss_shift)
    result = _adjusted(problem, material, model, known, datum, choices)
    return {
        "block": block_table(crs, cameras, problem, start.unoriented, result, datum),
        "points": ground_points(problem, result, datum, tracks),
        "image_residuals": image_residuals(problem, result, tracks, control),
        "ground_residuals": ground_residuals(cameras, problem, result, datum, control),
        "precision": block_precision(problem, result, datum),
    }


def _material(
    photos: Photos,
    cameras: Cameras,
    tie_points: TiePoints,
    relative: RelativeOrientations,
    choices: BlockChoices,
    hold_nominal: bool,
) -> tuple[Material, np.ndarray]:
    rays, tracks = tie_rays(photos, cameras, tie_points)
    used = sorted({cameras.of_photo[name] for name in photos.names})
    camera_of = np.array([used.index(cameras.of_photo[name]) for name in photos.names], np.int64)
    values = [cameras.cameras[name] for name in used]
    interior = interior_prior(values, choices.interior, hold_nominal)
    return Material(photos.names, tuple(used), values, camera_of, interior, rays, len(tracks), relative.pairs), tracks


def _problem(material: Material, start: Start, cameras: Cameras, control: Control) -> Problem:
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
    return Problem(
        active=start.photos,
        names=names,
        camera_names=material.camera_names,
        cameras=material.cameras,
        camera_of=material.camera_of[start.photos],
        rays=rays,
        good=good,
        ties=material.points,
        measured=measured,
        control=points,
    )


def _model(start: Start, problem: Problem) -> State:
    """The start's state with the photographs of the block only."""
    return replace(
        start.state,
        rotation=start.state.rotation[problem.active],
        centre=start.state.centre[problem.active],
        point=np.where(start.known[:, None], start.state.point, np.nan),
    )


def _known(photos: Photos, cameras: Cameras, problem: Problem, model: State) -> Known:
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


def _adjusted(problem: Problem, material: Material, model: State, known: Known, datum: Datum, choices: BlockChoices) -> Adjustment:
    present = np.isin(np.arange(len(problem.cameras)), problem.camera_of)[:, None]
    interior = replace(material.interior, free=material.interior.free & present, considered=material.interior.considered & present)
    count, p = problem.ties + len(problem.control), len(problem.names)
    state = to_datum(model, datum)
    points = np.vstack([np.nan_to_num(state.point), known.control - datum.origin])
    if datum.free:
        points[problem.ties :] = np.nan_to_num(datum.similarity.apply(known.control_model))
    network = Network(
        problem.camera_of,
        interior,
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
