"""The block: starts, datum, bundle, and the account of it in tables.

Photographs are renumbered to those that joined, surveyed points follow the tie points, and coordinates are local while numbers are
crunched; all that leaves this file is in the project's CRS again. Groups of photographs that no tie point connects are adjusted
together where positions or control place them in the project's system; the others become free blocks of their own.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from orthomill.schemas.camera import Cameras
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.observations import Control, TiePoints
from orthomill.schemas.orientation import RelativeOrientations, SeparateBlocks, Unoriented
from orthomill.schemas.photo import Photos
from orthomill.schemas.settings import Settings
from orthomill.tasks.adjustment.bundle import BlunderTest
from orthomill.tasks.adjustment.model.interior import InteriorChoice, interior_prior
from orthomill.tasks.adjustment.solve.ray_intersection import sufficiently_observed
from orthomill.tasks.orientation.block.assembly import BlockResults, Part, known_of, problem_of, starting_values
from orthomill.tasks.orientation.block.camera_constant import adjust_tested
from orthomill.tasks.orientation.block.correlated_image_errors import carried
from orthomill.tasks.orientation.block.self_calibration import determined, told_by_shape
from orthomill.tasks.orientation.folding import folding_remarks
from orthomill.tasks.orientation.interchange.foreign_block import ForeignPose
from orthomill.tasks.orientation.measurements import tie_rays
from orthomill.tasks.orientation.results.adjustment_results import block_precision
from orthomill.tasks.orientation.results.block_results import block_table, ground_points, image_residuals
from orthomill.tasks.orientation.results.ground_results import ground_residuals
from orthomill.tasks.orientation.sensor_frame import Sensors, Upright
from orthomill.tasks.orientation.start.block_growth import Given, GrowthMaterial
from orthomill.tasks.orientation.start.block_start import Blocks, BlockStart, start_blocks, start_with, without_photo
from orthomill.tasks.orientation.start.georeference import choose_datum
from orthomill.tasks.orientation.start.up_direction import Looking
from orthomill.tasks.orientation.start.weak_photograph import AWAY, away_from_its_position, set_aside, weakest

cv2.setNumThreads(1)


class BlockChoices(Settings):
    """What the workflow decides: the part of the interior orientation, a common shift of the GNSS positions, the standard error of
    the mean vertical where it is needed (degrees) and how the photographs look then, the limit of the blunder test in standard
    errors, and the lever arm of the antenna (m, image system) with its standard error (0: exactly known)."""

    interior: InteriorChoice
    gnss_shift: bool
    vertical_sigma: float
    rejection: float
    lever_arm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lever_sigma: float = 0.0
    looking: Looking = "auto"


@dataclass(frozen=True, eq=False)
class _Input:
    """What every part of the block is made from."""

    photos: Photos
    cameras: Cameras
    control: Control
    material: GrowthMaterial
    choices: BlockChoices
    tops: Mapping[str, np.ndarray]


def orient_block(
    photos: Photos,
    cameras: Cameras,
    tie_points: TiePoints,
    control: Control,
    relative: RelativeOrientations,
    crs: str,
    choices: BlockChoices,
    given: Mapping[str, ForeignPose] | None = None,
) -> dict[str, object]:
    """Orients all photographs that can be oriented; `given`: approximate exterior orientations to begin with. Returns the tables
    block, points, image_residuals, ground_residuals, precision and separate.

    Raises GeometryError when there is no block at all or its observations do not determine it.
    """
    upright = Upright(photos, cameras)
    tables = _block_of_sensors(upright.sensors(tie_points, control, given), relative, crs, choices)
    return upright.tables(tables) if upright.anything else tables


def _block_of_sensors(seen: Sensors, relative: RelativeOrientations, crs: str, choices: BlockChoices) -> dict[str, object]:
    """The tables of photographs as their sensors saw them."""
    photos, tie_points, control, cameras = seen.photos, seen.tie_points, seen.control, seen.cameras
    cameras = cameras.with_k1(relative.start_k1)
    usable = [point for point in control.points if point.role == "control" and len(point.measurements) >= 2]
    material, tracks = _material(photos, cameras, tie_points, relative, choices, len(usable) < 3)
    have = _Input(photos, cameras, control, material, choices, seen.tops)
    try:
        oriented = _settled(have, *_given(photos, seen.given))
    except GeometryError as error:
        raise GeometryError(" ".join((str(error), *folding_remarks(cameras)))) from error
    account, apart = carried(oriented.account), tuple(block_table(crs, carried(one), ()) for one in oriented.apart)
    return {
        "block": block_table(crs, account, oriented.unoriented),
        "points": ground_points(account, tracks),
        "image_residuals": image_residuals(account, tracks, control),
        "ground_residuals": ground_residuals(account, control),
        "precision": block_precision(account, tracks, apart, control),
        "separate": SeparateBlocks(blocks=apart),
    }


@dataclass(frozen=True, eq=False)
class _Oriented:
    """The account of the block, those of blocks apart, and the photographs in none."""

    account: BlockResults
    apart: tuple[BlockResults, ...]
    unoriented: tuple[Unoriented, ...]


def _material(
    photos: Photos,
    cameras: Cameras,
    tie_points: TiePoints,
    relative: RelativeOrientations,
    choices: BlockChoices,
    hold_nominal: bool,
) -> tuple[GrowthMaterial, np.ndarray]:
    rays, tracks = tie_rays(photos, cameras, tie_points)
    used = sorted({cameras.of_photo[name] for name in photos.names})
    camera_of = np.array([used.index(cameras.of_photo[name]) for name in photos.names], np.int64)
    values = [cameras.cameras[name] for name in used]
    interior = interior_prior(values, choices.interior, hold_nominal)
    return GrowthMaterial(photos.names, tuple(used), values, camera_of, interior, rays, len(tracks), relative.pairs), tracks


def _given(photos: Photos, given: Mapping[str, ForeignPose] | None) -> tuple[Given | None, np.ndarray | None]:
    """The approximate orientations in local coordinates, and their origin (3,)."""
    if given is None:
        return None, None
    rotation, centre = np.tile(np.eye(3), (len(photos.names), 1, 1)), np.zeros((len(photos.names), 3))
    known = np.array([name in given for name in photos.names])
    for i in np.flatnonzero(known):
        own = given[photos.names[i]]
        rotation[i], centre[i] = own.rotation, own.centre
    origin = np.round(centre[known].mean(axis=0)) if known.any() else np.zeros(3)
    return Given(rotation, centre - origin, known), origin


def _settled(have: _Input, given: Given | None, origin: np.ndarray | None) -> _Oriented:
    """The block; begun once more where its camera constants turn out wrong: what was lost to these comes back."""
    first = _oriented(have, start_blocks(have.material, given), origin)
    anew = first.account.anew
    if not np.isfinite(anew).any():
        return first
    constants = np.where(np.isfinite(anew), anew, have.material.interior.value[:, 0])
    try:
        second = _oriented(have, start_with(have.material, constants, given), origin)
    except GeometryError:
        return first
    return second if _explains(second) > _explains(first) else first


def _explains(oriented: _Oriented) -> tuple[int, int]:
    """Photographs and rays of the block."""
    return len(oriented.account.problem.names), int(oriented.account.result.used.sum())


def _oriented(have: _Input, blocks: Blocks, origin: np.ndarray | None) -> _Oriented:
    starts, unoriented = blocks
    parts = [_part(have, start, origin if i == 0 else None) for i, start in enumerate(starts)]
    joined = [part for part in parts if not part.datum.free] or parts[:1]
    account, weak = _adjusted(have, joined)
    others = [_adjusted(have, [part]) for part in parts if all(part is not p for p in joined)]
    told = (*weak, *(one for _, left in others for one in left))
    return _Oriented(account, tuple(one for one, _ in others), (*told, *unoriented))


def _part(have: _Input, start: BlockStart, origin: np.ndarray | None) -> Part:
    model, known = known_of(have.photos, have.cameras, have.material, start, have.control, have.tops)
    choices = have.choices
    datum = choose_datum(model, known, np.radians(choices.vertical_sigma), choices.looking, choices.gnss_shift, origin)
    return Part(start, model, known, datum, origin)


def _adjusted(have: _Input, parts: list[Part]) -> tuple[BlockResults, tuple[Unoriented, ...]]:
    """The adjustment of parts that share a datum, and the weak photographs that were set aside because it fails with them, or they
    contradict their position."""
    choices, aside = have.choices, ()
    if choices.gnss_shift and not any(part.known.placed.sum() >= 3 for part in parts):
        raise GeometryError(
            "A shift of the GNSS positions can only be told apart with 3 or more control points; "
            f"{max(int(part.known.placed.sum()) for part in parts)} can be used here."
        )
    while True:
        problem, datum = problem_of(have.material, parts, have.cameras, have.control)
        network, state, good = starting_values(have.material, problem, parts, datum, np.radians(choices.vertical_sigma))
        network = network.with_lever(choices.lever_arm, choices.lever_sigma, choices.gnss_shift)
        rays, test = problem.rays.take(good), BlunderTest(limit=choices.rejection)
        network, remarks = determined(told_by_shape(network, state, rays), state, rays, problem.camera_names)
        try:
            tested = adjust_tested(
                network, state.with_lever(network.lever), rays, test, problem.camera_names, choices.interior.kind == "fixed"
            )
            weak, why = away_from_its_position(tested.result, datum.positions_aside), AWAY
        except GeometryError as error:
            tested, why, failure = None, str(error), error
            weak = weakest(network, state, sufficiently_observed(network, rays))
        left = [] if weak is None else _without(have, parts, int(problem.active[weak]))
        if not left and tested is None:
            raise failure
        if not left:
            remarks = (*folding_remarks(have.cameras), *remarks, *tested.remarks)
            return BlockResults(have.cameras, problem, tested.result, datum, remarks, tested.anew), aside
        count, parts = int((rays.photo == weak).sum()), left
        aside += (Unoriented(photo=problem.names[weak], reason=set_aside(problem.names[weak], count, why)),)


def _without(have: _Input, parts: list[Part], photo: int) -> list[Part]:
    """The parts without a photograph; none where too little would be left."""
    left = [_part(have, without_photo(part.start, photo), part.origin) if photo in part.start.photos else part for part in parts]
    return left if all(len(part.start.photos) >= 2 for part in left) else []
