"""Which warnings about the block put every result of the project in doubt: place, scale, tilt or shape may be wrong as a whole."""

from collections.abc import Iterator

from orthomill.schemas.findings.block_findings import BlockFinding
from orthomill.schemas.findings.camera_findings import ConstantContradicted, DistortionFolds, LensContradicted
from orthomill.schemas.findings.contradiction_findings import (
    ConstantOfItsOwn,
    OffsetAdjusted,
    PositionsDrift,
    ScaleContradicted,
    SourcesDisagree,
    UnitContradicted,
)
from orthomill.schemas.findings.datum_findings import (
    AxesExchanged,
    BlockBent,
    BlockSeparate,
    DatumMisfit,
    GroupsUnconnected,
    LooksUpward,
    NoDatum,
    PointsExchanged,
    TiltUnobserved,
)
from orthomill.schemas.findings.foreign_findings import BlockElsewhere
from orthomill.schemas.findings.observation_findings import (
    ControlContradicted,
    ControlUnmet,
    DistanceContradicted,
    MarksInAnotherFrame,
    PositionsElsewhere,
)
from orthomill.tasks.orientation.examined.block_facts import Facts, told_findings
from orthomill.tasks.orientation.report.several_findings import finding_sentences
from orthomill.tasks.orientation.report.worse_than_stated import CONTRADICTED, worse_than_stated

GRAVE = (
    NoDatum,
    PointsExchanged,
    UnitContradicted,
    ScaleContradicted,
    ConstantOfItsOwn,
    OffsetAdjusted,
    PositionsDrift,
    BlockBent,
    SourcesDisagree,
    MarksInAnotherFrame,
    ControlUnmet,
    LooksUpward,
    AxesExchanged,
    DatumMisfit,
    BlockElsewhere,
    PositionsElsewhere,
    ControlContradicted,
    DistanceContradicted,
    GroupsUnconnected,
    BlockSeparate,
    ConstantContradicted,
    LensContradicted,
    DistortionFolds,
    TiltUnobserved,
)
"""In the order in which they are told: causes that explain a contradiction come before what is left of it. Other findings concern
single points and photographs, or a precision that is stated."""


def block_doubts(facts: Facts) -> Iterator[str]:
    """Sentences that are among the warnings, the gravest first."""
    # Control that was left out for its place or its heights leaves the block without what its user relies on; without a datum, or
    # with all of it read in another way, that is the least of it.
    control = [finding.sentence for finding in facts.control.findings if finding.grave]
    told = told_findings(facts.control, facts.precision)
    graver = [finding for finding in told if isinstance(finding, GRAVE) and not _is_minor(finding)]
    found = list(finding_sentences(sorted(graver, key=lambda finding: GRAVE.index(type(finding)))))
    # What explains that they do not fit has been told by then.
    found += [worse.sentence for worse in worse_than_stated(facts) if worse.factor >= CONTRADICTED]
    whole = any(isinstance(finding, NoDatum | MarksInAnotherFrame) for finding in graver)
    yield from (*found, *control) if whole else (*control, *found)


def _is_minor(finding: BlockFinding) -> bool:
    """Whether the block found a camera constant that nothing gave, so that there is none that it contradicts; a bend as small as
    models of lenses leave; or an offset of positions that is no larger than their stated standard errors."""
    if isinstance(finding, BlockBent):
        return not finding.grave
    if isinstance(finding, OffsetAdjusted):
        return finding.as_stated
    return isinstance(finding, ConstantContradicted) and finding.guessed and not finding.fixed
