"""The block: starts, datum, adjustment, and the tables of its results.

Photographs are renumbered to those that joined, surveyed points follow the tie points, and coordinates are local during the
computation; all that leaves this file is in the project's CRS again. Groups of photographs that no tie point connects are adjusted
together where positions or control place them in the project's system; the others become free blocks of their own.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import Cameras
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.findings.block_findings import BlockFinding
from orthomill.schemas.findings.camera_findings import ConstantContradicted, InteriorFixed
from orthomill.schemas.findings.datum_findings import DatumMisfit
from orthomill.schemas.observations import Control, TiePoints
from orthomill.schemas.orientation import RelativeOrientations, SeparateBlocks, Unoriented
from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.bundle import BlunderTest
from orthomill.tasks.adjustment.model.image_variation import variation_of
from orthomill.tasks.adjustment.model.interior import interior_prior, is_guessed
from orthomill.tasks.adjustment.model.network import NOT_SHIFTED, Rays, common_shift
from orthomill.tasks.adjustment.solve.minimise import NotConverged
from orthomill.tasks.adjustment.solve.ray_intersection import sufficiently_observed
from orthomill.tasks.orientation.block.assembly import (
    BlockResults,
    Part,
    Problem,
    known_of,
    problem_of,
    starting_values,
    taking_part,
    with_gnss_groups,
    with_receivers,
)
from orthomill.tasks.orientation.block.correlated_image_errors import including_correlation
from orthomill.tasks.orientation.block.frame_motion import frame_motion
from orthomill.tasks.orientation.block.given_lens import contradicted_lenses
from orthomill.tasks.orientation.block.image_scales import shown_constants
from orthomill.tasks.orientation.block.own_constants import OwnConstant, apart, own_constant_findings, refined, with_own_constant
from orthomill.tasks.orientation.block.self_calibration import determinable_without_control, determined, unweighted
from orthomill.tasks.orientation.exterior.bend_without_control import bend_without_control
from orthomill.tasks.orientation.exterior.block_choices import BlockChoices, lever_sigma, vertical_sigma
from orthomill.tasks.orientation.exterior.compared_blocks import explains_clearly_more, explains_more, moved_positions
from orthomill.tasks.orientation.exterior.counted_marks import counted_otherwise
from orthomill.tasks.orientation.exterior.datum_afterwards import as_adjusted, explained_datum
from orthomill.tasks.orientation.exterior.datum_of_part import datum_of_part
from orthomill.tasks.orientation.exterior.explained_adjustment import AdjustmentStart, ExplainedBlock, explained
from orthomill.tasks.orientation.exterior.own_errors import held_by_own, own_turn, parts_sentence
from orthomill.tasks.orientation.exterior.started_again import where_it_is
from orthomill.tasks.orientation.folding import folding_cameras
from orthomill.tasks.orientation.interchange.foreign_block import ForeignPose
from orthomill.tasks.orientation.measurements import tie_rays
from orthomill.tasks.orientation.relative.pairs import relate_pairs
from orthomill.tasks.orientation.results.adjustment_results import block_precision
from orthomill.tasks.orientation.results.block_results import block_table, ground_points, image_residuals
from orthomill.tasks.orientation.results.block_tables import BlockTables
from orthomill.tasks.orientation.results.contradictions import agreeing_positions
from orthomill.tasks.orientation.results.ground_results import ground_residuals
from orthomill.tasks.orientation.sensor_frame import Sensors, Upright
from orthomill.tasks.orientation.shape.held_parameters import considering_held
from orthomill.tasks.orientation.sources.elevation_model import Elevation, ElevationModel, Lattice
from orthomill.tasks.orientation.sources.source_findings import contradicted_sources, covered_by, own_constants, source_statements
from orthomill.tasks.orientation.start.block_growth import Given, GrowthMaterial
from orthomill.tasks.orientation.start.block_start import Blocks, BlockStart, start_blocks, start_with, without_photo
from orthomill.tasks.orientation.start.georeference import Datum, free_of_its_place, given_up, looks_elsewhere
from orthomill.tasks.orientation.start.weak_photograph import AWAY, away_from_its_position, obstructing, set_aside, weakest

ENOUGH_CONTROL = 3
"""Control points that determine a similarity transformation, and with it the flying height apart from the camera constant and the
positions apart from a common shift."""


@dataclass(frozen=True, eq=False)
class _Input:
    """What every part of the block is made from."""

    upright: Upright
    photos: Photos
    cameras: Cameras
    control: Control
    material: GrowthMaterial
    choices: BlockChoices
    tops: Mapping[str, np.ndarray]
    elevation: Elevation | None = None

    def model(self, datum: Datum) -> ElevationModel | None:
        """The elevation model in the local coordinates of a datum."""
        return ElevationModel(self.elevation, datum.origin) if self.elevation else None


def orient_block(
    photos: Photos,
    cameras: Cameras,
    tie_points: TiePoints,
    control: Control,
    relative: RelativeOrientations,
    crs: str,
    choices: BlockChoices,
    given: Mapping[str, ForeignPose] | None = None,
    heights: np.ndarray | None = None,
    lattice: Lattice | None = None,
) -> BlockTables:
    """Orients all photographs that can be oriented; `given`: approximate exterior orientations to start with; `heights` (rows,
    cols) m of an elevation model on a `lattice`, to compare with.

    Raises GeometryError when there is no block at all or its observations do not determine it, WorkflowError for an elevation model
    of another place.
    """
    elevation = None if heights is None or lattice is None else Elevation(heights, lattice).checked()
    # One interior orientation for each sensor: photographs turned by EXIF would need one for every way they were turned.
    upright = Upright(photos, cameras)
    seen = upright.sensors(tie_points, control, given)

    def oriented(with_control: Control) -> BlockTables:
        return _block_of_sensors(replace(seen, control=with_control), relative, crs, choices, elevation)

    tables = bend_without_control(oriented(seen.control), control, lambda: oriented(Control()))
    return _upright_tables(upright, tables) if upright.anything else tables


def _upright_tables(upright: Upright, tables: BlockTables) -> BlockTables:
    """The tables of a block of sensors for upright photographs; surveyed points and ground points are the same."""
    changed = {
        "largest": tuple(upright.largest(row) for row in tables.precision.largest),
        "white_sigma": upright.white_sigmas(tables.precision.white_sigma, tables.block),
    }
    separate = tables.separate and SeparateBlocks(blocks=tuple(upright.block(block) for block in tables.separate.blocks))
    return tables._replace(
        block=upright.block(tables.block),
        image_residuals=upright.residuals(tables.image_residuals),
        precision=tables.precision.model_copy(update=changed),
        separate=separate,
    )


def _block_of_sensors(
    seen: Sensors, relative: RelativeOrientations, crs: str, choices: BlockChoices, elevation: Elevation | None
) -> BlockTables:
    """The tables of photographs as their sensors saw them."""
    photos, tie_points, control, cameras = seen.photos, seen.tie_points, seen.control, seen.cameras
    cameras = cameras.with_k1(relative.start_k1)
    # A control point in one photograph determines no scale, so it does not separate c from the flying height.
    usable = [point for point in control.points if point.role == "control" and len(point.measurements) >= 2]
    nominal = len(usable) < ENOUGH_CONTROL
    material, tracks = _material(photos, cameras, tie_points, relative, choices, nominal)
    have = _Input(seen.upright, photos, cameras, control, material, choices, seen.tops, elevation)

    def with_cameras(others: Cameras) -> _Input:
        # A wrong constant turns the base of a pair into the view.
        again = relate_pairs(photos, others, tie_points, min(pair.matches for pair in relative.pairs))
        others = others.with_k1(again.start_k1)
        return replace(have, cameras=others, material=_material(photos, others, tie_points, again, choices, nominal)[0])

    try:
        first = _with_restart(have, *_given(photos, seen.given))
        oriented = _with_own_constants(first, cameras, with_cameras, shown_constants(photos, material))
    except GeometryError as error:
        # A distortion that cannot be undone is a likely cause, and there is no report that could name it.
        causes = (finding.sentence for finding in folding_cameras(cameras))
        raise GeometryError(" ".join((str(error), *causes))) from error
    control = oriented.control
    results = including_correlation(considering_held(oriented.results, choices.interior))
    separate = (including_correlation(considering_held(one, choices.interior)) for one in oriented.apart)
    apart = tuple(block_table(crs, one, ()) for one in separate)
    return BlockTables(
        block=block_table(crs, results, oriented.unoriented),
        points=ground_points(results, tracks),
        image_residuals=image_residuals(results, tracks, control),
        ground_residuals=ground_residuals(results, control),
        precision=block_precision(results, tracks, apart, control, photos),
        separate=SeparateBlocks(blocks=apart),
    )


@dataclass(frozen=True, eq=False)
class _Oriented:
    """The results of the block, those of blocks apart, the photographs in none, and the control whose marks are those of the
    photographs."""

    results: BlockResults
    apart: tuple[BlockResults, ...]
    unoriented: tuple[Unoriented, ...]
    control: Control


def _material(
    photos: Photos,
    cameras: Cameras,
    tie_points: TiePoints,
    relative: RelativeOrientations,
    choices: BlockChoices,
    keep_nominal: bool,
) -> tuple[GrowthMaterial, np.ndarray]:
    rays, tracks = tie_rays(photos, cameras, tie_points)
    # Only cameras of this block: others would leave empty columns. Sorted, so that results do not depend on the order.
    used = sorted({cameras.of_photo[name] for name in photos.names})
    camera_of = np.array([used.index(cameras.of_photo[name]) for name in photos.names], np.int64)
    values = [cameras.cameras[name] for name in used]
    interior = interior_prior(values, choices.interior, keep_nominal)
    return GrowthMaterial(
        names=photos.names,
        camera_names=tuple(used),
        cameras=values,
        camera_of=camera_of,
        interior=interior,
        rays=rays,
        points=len(tracks),
        relative=relative.pairs,
    ), tracks


def _given(photos: Photos, given: Mapping[str, ForeignPose] | None) -> tuple[Given | None, np.ndarray | None]:
    """The approximate orientations in local coordinates, and their origin (3,)."""
    if given is None:
        return None, None
    rotation, centre = np.tile(np.eye(3), (len(photos.names), 1, 1)), np.zeros((len(photos.names), 3))
    known = np.array([name in given for name in photos.names])
    for i in np.flatnonzero(known):
        own = given[photos.names[i]]
        rotation[i], centre[i] = own.rotation, own.centre
    # Whole metres: subtracting and adding it again is exact in float64.
    origin = np.round(centre[known].mean(axis=0)) if known.any() else np.zeros(3)
    return Given(rotation, centre - origin, known), origin


def _with_restart(have: _Input, given: Given | None, origin: np.ndarray | None) -> _Oriented:
    """The block; started again where its camera constants turn out wrong, for these have cost it tie points and photographs."""
    first = _oriented(have, start_blocks(have.material, given), origin)
    restart = first.results.restart
    # One restart only: constants that are still contradicted afterwards would be again.
    if restart is None or not np.isfinite(restart).any():
        return first
    constants = np.where(np.isfinite(restart), restart, have.material.interior.value[:, 0])
    try:
        second = _oriented(have, start_with(have.material, constants, given), origin)
    except GeometryError:
        return first
    return second if explains_more(second.results, first.results) else first


def _with_own_constants(
    first: _Oriented, cameras: Cameras, with_cameras: Callable[[Cameras], _Input], shown: tuple[OwnConstant, ...]
) -> _Oriented:
    """The block; started again with cameras of their own for photographs whose camera constant may be another one, where these
    explain the photographs better; or as well as before, where the photographs are `shown` to be larger."""
    candidates = refined(shown, first.results.zooms)
    for own in candidates:
        second = _again(first, own, with_cameras(with_own_constant(cameras, own)))
        if second is None:
            continue
        better = explains_clearly_more(second.results, first.results)
        if better and moved_positions(second.results) > moved_positions(first.results):
            # What another constant is to explain it would have explained of the positions, too: it is the start that was better.
            same = _again(second, own.undone, with_cameras(cameras))
            first = same if same is not None and explains_clearly_more(same.results, first.results) else first
            continue
        # Without positions another flying height shows the ground as large.
        seen = own.photos in {one.photos for one in shown} and bool(first.results.problem.known.positioned.any())
        if better or (seen and not explains_clearly_more(first.results, second.results)):
            problem, values = second.results.problem, second.results.result.state.interior[:, 0]
            told = own_constant_findings(own, cameras, dict(zip(problem.camera_names, map(float, values), strict=True)))
            if not apart(told):
                continue
            return replace(second, results=replace(second.results, findings=(*told, *second.results.findings)))
    return first


def _again(first: _Oriented, own: OwnConstant, have: _Input) -> _Oriented | None:
    """The block with other cameras, started from where it is, or else from nothing; None where neither comes to an end."""
    results = first.results
    origin = None if results.datum.free else results.datum.origin
    for given in (where_it_is(results, own, have.material), None):
        try:
            return _oriented(have, start_blocks(have.material, given), None if given is None else origin)
        except GeometryError:
            continue
    return None


def _oriented(have: _Input, blocks: Blocks, origin: np.ndarray | None) -> _Oriented:
    starts, unoriented = blocks
    have, counted = _recounted(have, starts[0])
    parts = [_part(have, start, origin if i == 0 else None) for i, start in enumerate(starts)]
    parts = [parts[0], *(_without_doubtful_place(part, parts[0]) for part in parts[1:])]
    # Free groups cannot share a system with others; without any datum the largest one is the block.
    joined = [part for part in parts if not part.datum.free] or parts[:1]
    results, weak = _adjusted(have, joined)
    others = [_adjusted(have, [part]) for part in parts if all(part is not p for p in joined)]
    left = (*weak, *(photo for _, photos in others for photo in photos))
    results = replace(results, findings=(*counted, *results.findings))
    return _Oriented(results, tuple(one for one, _ in others), (*left, *unoriented), have.control)


def _without_doubtful_place(part: Part, block: Part) -> Part:
    """A group of photographs as a free block, where only an assumption places it and the block contradicts that."""
    if not looks_elsewhere(part.model, part.datum, block.model, block.datum):
        return part
    return replace(part, datum=free_of_its_place(part.model, part.known))


def _recounted(have: _Input, start: BlockStart) -> tuple[_Input, tuple[BlockFinding, ...]]:
    """The input with marks as they are counted in the photographs, and how they were counted."""
    found = counted_otherwise(have.upright, have.cameras, have.material, start, have.control)
    return (have, ()) if found is None else (replace(have, control=found[0]), (found[1],))


def _part(have: _Input, start: BlockStart, origin: np.ndarray | None) -> Part:
    model, known = known_of(have.photos, have.cameras, have.material, start, have.control, have.tops)
    sigma, names = vertical_sigma(have.choices, have.photos), tuple(point.name for point in taking_part(have.control))
    datum = datum_of_part(model, known, have.choices, sigma, names, bool(have.tops), origin)
    return Part(start, model, known, datum, origin)


def _adjusted(have: _Input, parts: list[Part]) -> tuple[BlockResults, tuple[Unoriented, ...]]:
    """The adjustment of parts that share a datum, and the photographs that were left out because it fails with them, or because
    they are poorly determined and contradict their position."""
    _require_control_for_shift(have.choices, parts)
    # Each round loses a photograph or ends, so there are at most as many rounds as photographs.
    left_out: tuple[Unoriented, ...] = ()
    while True:
        attempt = _attempt(have, parts)
        suspect = attempt.suspect
        fewer = [] if suspect is None else _without(have, parts, int(attempt.problem.active[suspect]))
        if fewer and suspect is not None:
            left_out += (Unoriented(photo=attempt.problem.names[suspect], reason=_why(attempt, suspect)),)
            parts = fewer
        elif isinstance(attempt.outcome, NotConverged) and len(parts) == 1 and not attempt.datum.free:
            # What was surveyed is the last thing to be doubted: without it there is a block, and a report that says why.
            parts = [_without_datum(have, parts[0])]
        elif isinstance(attempt.outcome, GeometryError):
            raise attempt.outcome
        elif returned := _with_agreeing(have, attempt, attempt.outcome, parts):
            parts = returned
        else:
            return _results(have, attempt, attempt.outcome), left_out


def _without_datum(have: _Input, part: Part) -> Part:
    names = tuple(have.material.names[i] for i in part.start.photos)
    points = tuple(point.name for point in taking_part(have.control))
    return replace(part, datum=given_up(part.model, part.known, part.datum, names, points))


def _require_control_for_shift(choices: BlockChoices, parts: list[Part]) -> None:
    placed = max(int(part.known.placed.sum()) for part in parts)
    if choices.gnss_shift == "constant" and placed < ENOUGH_CONTROL:
        raise GeometryError(
            "A common shift of the GNSS positions can only be determined with 3 or more control points; "
            f"{placed} can be used here. Give more control, or set gnss_shift: auto."
        )


@dataclass(frozen=True, eq=False)
class _Attempt:
    """One adjustment of a problem: its result or its failure, what was found about the interior orientation before it, and the
    poorly determined photograph to try without (`weak`, None: none), with the reason."""

    problem: Problem
    datum: Datum
    rays: Rays
    findings: tuple[BlockFinding, ...]
    outcome: ExplainedBlock | GeometryError
    weak: int | None
    why: str

    @property
    def suspect(self) -> int | None:
        """The number of the photograph to leave out: one that is poorly determined, or that keeps the rest from converging."""
        obstacle = self.outcome.photo if isinstance(self.outcome, NotConverged) else None
        return obstacle if self.weak is None else self.weak


def _why(attempt: _Attempt, suspect: int) -> str:
    """The sentence about the photograph that is left out."""
    name, rays = attempt.problem.names[suspect], int((attempt.rays.photo == suspect).sum())
    return obstructing(name, rays) if attempt.weak is None else set_aside(name, rays, attempt.why)


def _attempt(have: _Input, parts: list[Part]) -> _Attempt:
    choices = have.choices
    problem, datum = problem_of(have.material, parts, have.cameras, have.control)
    problem, receivers = with_receivers(problem, have.photos)
    problem, groups = with_gnss_groups(problem, have.photos)
    network, state, good = starting_values(have.material, problem, parts, datum, vertical_sigma(choices, have.photos))
    shifted = common_shift(network.photos) if choices.gnss_shift == "constant" else NOT_SHIFTED
    network = network.with_antenna(choices.lever_arm, lever_sigma(choices, problem.known), shifted, receivers)
    network = replace(network, gnss_group=groups)
    state = state.with_antenna(network)
    if choices.variation.kind != "none":
        motion = frame_motion(problem, have.photos, network, state, problem.rays.take(good))
        network = replace(network, variation=variation_of(choices.variation, motion))
    rays, test = problem.rays.take(good), BlunderTest(limit=choices.rejection)
    # Before the adjustment: undetermined parameters would make its normal equations singular.
    network, findings = determined(determinable_without_control(network, state, rays), state, rays, problem.camera_names)
    start = AdjustmentStart(network, state, rays, test, choices.interior)
    try:
        found = explained(start, have.photos, problem, datum, choices.gnss_shift, have.model(datum))
        # Positions that offsets bring into agreement take part again.
        aside = datum.positions_aside & ~found.tested.result.network.centre_weight.any(axis=1)
        weak = away_from_its_position(found.tested.result, aside)
    except GeometryError as error:
        # Without a result there are no rejected rays, so all that are sufficiently observed are judged.
        weak = weakest(network, state, sufficiently_observed(network, rays))
        return _Attempt(problem=problem, datum=datum, rays=rays, findings=findings, outcome=error, weak=weak, why=str(error))
    return _Attempt(problem=problem, datum=datum, rays=rays, findings=(*found.found, *findings), outcome=found, weak=weak, why=AWAY)


def _with_agreeing(have: _Input, attempt: _Attempt, adjusted: ExplainedBlock, parts: list[Part]) -> list[Part]:
    """The parts with those positions that the start had set aside, and that agree with the adjusted block; none where there are
    none.

    The start compares with a rough model; what agrees afterwards was set aside without need, and its absence may leave a tilt open.
    """
    if not attempt.datum.positions_aside.any():
        return []
    agree = agreeing_positions(BlockResults(have.cameras, attempt.problem, adjusted.tested.result, attempt.datum))
    if not agree:
        return []
    back = [np.isin([have.material.names[i] for i in part.start.photos], agree) for part in parts]
    datums = [replace(p.datum, positions_aside=p.datum.positions_aside & ~own) for p, own in zip(parts, back, strict=True)]
    return [replace(part, datum=datum) for part, datum in zip(parts, datums, strict=True)]


def _results(have: _Input, attempt: _Attempt, adjusted: ExplainedBlock) -> BlockResults:
    tested, sources, problem = adjusted.tested, adjusted.sources, attempt.problem
    unknown = unweighted(have.material.cameras, have.choices.interior)
    of_cameras = [_told_of_guess(have, finding) for finding in tested.findings]
    # Interior orientations that could not be adjusted are told as such: nothing more is known of them.
    undetermined = any(isinstance(finding, InteriorFixed) for finding in of_cameras)
    lenses = () if undetermined else contradicted_lenses(tested.result, problem.camera_names)
    findings = (*folding_cameras(have.cameras), *unknown, *attempt.findings, *of_cameras, *lenses)
    statements = source_statements(sources, problem)
    findings = (*findings, *contradicted_sources(sources, statements, have.control, problem))
    datum = explained_datum(attempt.datum, tested, DatumMisfit in covered_by(findings))
    if adjusted.parts is not None:
        datum = held_by_own(datum, own_turn(tested.result.network, adjusted.parts))
    datum = as_adjusted(datum, problem, tested.result)
    if adjusted.parts is not None:
        datum = replace(datum, sentence=f"{datum.sentence} {parts_sentence(adjusted.parts, tested.result.network)}")
    zooms = own_constants(sources, problem.names)
    return BlockResults(
        cameras=have.cameras,
        problem=problem,
        result=tested.result,
        datum=datum,
        findings=findings,
        restart=tested.restart,
        statements=statements,
        zooms=zooms,
        offsets=adjusted.offsets,
        own=None if adjusted.parts is None else adjusted.parts.own,
    )


def _told_of_guess(have: _Input, finding: BlockFinding) -> BlockFinding:
    """A contradicted camera constant with whether it was guessed."""
    if not isinstance(finding, ConstantContradicted):
        return finding
    camera = have.material.cameras[have.material.camera_names.index(finding.camera)]
    return finding.model_copy(update={"guessed": is_guessed(camera)})


def _without(have: _Input, parts: list[Part], photo: int) -> list[Part]:
    """The parts without a photograph; none where fewer than two photographs would be left in one."""
    left = [_part(have, without_photo(part.start, photo), part.origin) if photo in part.start.photos else part for part in parts]
    return left if all(len(part.start.photos) >= 2 for part in left) else []
