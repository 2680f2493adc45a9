"""One adjustment of a block, with the constant errors of its positions as unknowns where its sources demand them, and with what
positions have in common told apart from what each has of its own."""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import INTERIOR
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.findings.contradiction_findings import OffsetAdjusted
from orthomill.schemas.orientation import PositionOffset
from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.bundle import BlunderTest
from orthomill.tasks.adjustment.model.interior_settings import InteriorChoice
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.solve.minimise import UNDETERMINED
from orthomill.tasks.orientation.block.assembly import Problem
from orthomill.tasks.orientation.block.camera_constant import Tested
from orthomill.tasks.orientation.block.demanded_parameters import adjust_with_demanded, held_by_rule
from orthomill.tasks.orientation.exterior.own_errors import OwnParts, own_parts, with_own_parts
from orthomill.tasks.orientation.exterior.predicted_errors import with_predicted_errors
from orthomill.tasks.orientation.orientation_settings import ShiftChoice
from orthomill.tasks.orientation.sources.block_sources import BlockSources, block_sources, with_offsets
from orthomill.tasks.orientation.sources.causes import DETERMINED
from orthomill.tasks.orientation.sources.elevation_model import ElevationModel
from orthomill.tasks.orientation.sources.source_findings import offset_findings, offsets_of
from orthomill.tasks.orientation.start.georeference import Datum

ENOUGH_CONTROL = 3
"""Control points that place the block better than what positions have in common"""


@dataclass(frozen=True, eq=False)
class AdjustmentStart:
    """What an adjustment starts with."""

    network: Network
    state: State
    rays: Rays
    test: BlunderTest
    interior: InteriorChoice

    def adjusted(self, problem: Problem) -> Tested:
        """The adjustment. Raises GeometryError as `adjust_tested`."""
        held, fixed = _held(self.network, problem, self.interior), self.interior.kind == "fixed"
        tested = adjust_with_demanded(self.network, self.state, self.rays, self.test, problem.camera_names, held, fixed)
        return with_predicted_errors(tested, self.network, self.rays, self.test, problem, fixed)

    def again(self, network: Network, state: State) -> "AdjustmentStart":
        """The start of another adjustment from where the block is."""
        # Cameras begin as they are given: what a rule holds would stay where it was demanded, and other constants would be taken
        # for values with which the start was made.
        return replace(self, network=network, state=replace(state, interior=self.state.interior))


@dataclass(frozen=True, eq=False)
class ExplainedBlock:
    """An adjusted block, the `network` as it was given to the adjustment, what its sources say of it (None: a free block), the
    `offsets` that were adjusted with the findings about them and the sources `before` these, and the `parts` of the positions'
    errors, where they are told apart."""

    tested: Tested
    network: Network
    found: tuple[OffsetAdjusted, ...] = ()
    sources: BlockSources | None = None
    offsets: tuple[PositionOffset, ...] = ()
    before: BlockSources | None = None
    parts: OwnParts | None = None


def explained(
    start: AdjustmentStart, photos: Photos, problem: Problem, datum: Datum, shift: ShiftChoice, model: ElevationModel | None
) -> ExplainedBlock:
    """The adjustment; with constant errors of the positions as unknowns where the sources contradict each other without, and the
    findings about these; with both parts of the errors of positions where nothing else places the block. Raises GeometryError as
    `adjust_tested`."""
    block = _explained(start, photos, problem, datum, shift, model)
    controlled = int((problem.known.placed & ~datum.control_aside).sum()) >= ENOUGH_CONTROL
    if shift != "auto" or block.sources is None or controlled:
        return block
    return _with_own_parts(block, start, photos, problem, datum, model)


def _explained(
    start: AdjustmentStart, photos: Photos, problem: Problem, datum: Datum, shift: ShiftChoice, model: ElevationModel | None
) -> ExplainedBlock:
    tested, failure = None, None
    try:
        tested = start.adjusted(problem)
    except GeometryError as error:
        # Sources that contradict each other are a likely cause: the start shows them as well.
        failure = error
    network, state = (tested.result.network, tested.result.state) if tested else (start.network, start.state)
    sources = block_sources(photos, problem, datum, network, state, model)
    if shift == "auto" and sources is not None and sources.has_offsets:
        try:
            given = problem.known.position - datum.origin, problem.known.position_sigma
            network, state = with_offsets(sources, start.network, state, *given)
            again = start.again(network, state).adjusted(problem)
            offsets = offsets_of(again.result, problem.names, sources)
            found = tuple(offset_findings(offsets, sources, problem.names, _heights(photos, problem)))
            # What looked like an offset may be gone with a camera constant that the adjustment has replaced.
            if tested is None or any(map(_stands_out, found)):
                after = block_sources(photos, problem, datum, again.result.network, again.result.state, model)
                return ExplainedBlock(again, network, found, after, offsets, sources)
        except GeometryError as error:
            failure = failure or error
    if tested is None:
        raise failure or GeometryError(UNDETERMINED)
    return ExplainedBlock(tested, start.network, sources=sources)


def _with_own_parts(
    block: ExplainedBlock, start: AdjustmentStart, photos: Photos, problem: Problem, datum: Datum, model: ElevationModel | None
) -> ExplainedBlock:
    """The block with both parts of the errors of its positions; as it is where they err as much as stated."""
    result, sources = block.tested.result, block.sources
    parts = None if sources is None else own_parts(result, problem.known.position_sigma, sources.groups)
    if parts is None or sources is None:
        return block
    assumed = datum.basis in ("down", "level")
    network, state = with_own_parts(block.network, result.state, parts, sources.groups.flight, assumed)
    try:
        tested = start.again(network, state).adjusted(problem)
    except GeometryError:
        return block
    after = block_sources(photos, problem, datum, tested.result.network, tested.result.state, model)
    block = replace(block, tested=tested, network=network, sources=after, parts=parts)
    if block.before is None:
        return block
    offsets = offsets_of(tested.result, problem.names, block.before)
    found = tuple(offset_findings(offsets, block.before, problem.names, _heights(photos, problem)))
    return replace(block, offsets=offsets, found=found)


def _stands_out(found: OffsetAdjusted) -> bool:
    """Whether an offset exceeds its standard errors in any coordinate."""
    pairs = zip(found.offset, found.sigma, strict=True)
    return any(abs(value) > DETERMINED * sigma for value, sigma in pairs if value is not None and sigma is not None)


def _heights(photos: Photos, problem: Problem) -> str | None:
    """What the heights of the positions refer to, where all tags say the same."""
    kinds = {photos[name].height_kind for name in problem.names}
    return kinds.pop() if len(kinds) == 1 else None


def _held(network: Network, problem: Problem, choice: InteriorChoice) -> np.ndarray:
    """(C, 17) bool: interior parameters that the rule of nominal cameras keeps, and not the workflow."""
    nominal = np.array([choice.kind == "weighted" and camera.source == "exif" for camera in problem.cameras])
    named = np.isin(INTERIOR, choice.parameters if choice.kind == "weighted" else ())
    return held_by_rule(network.interior, nominal, named)
