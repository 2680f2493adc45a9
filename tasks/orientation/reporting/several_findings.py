"""Findings that a block makes of many cameras or photographs at once, in one sentence with a list: ten cameras of unknown focal
length are one thing to know, not ten."""

from collections.abc import Callable, Iterator, Sequence

from orthomill.schemas.errors import some_of
from orthomill.schemas.findings.block_findings import (
    BlockFinding,
    ConstantContradicted,
    ConstantNominal,
    DistortionFolds,
    InteriorUndetermined,
    PositionContradicted,
    PrincipalPointMoved,
    TiltUnobserved,
)
from orthomill.tasks.orientation.reporting.finding_sentences import finding_sentence


def finding_sentences(findings: Sequence[BlockFinding]) -> Iterator[str]:
    """The findings as whole sentences in their order; those of one kind that differ by their camera or photograph only are one."""
    kinds: dict[str, list[BlockFinding]] = {}
    for number, finding in enumerate(findings):
        kinds.setdefault(_alike(finding) if type(finding) in _OF_MANY else str(number), []).append(finding)
    for own in kinds.values():
        yield finding_sentence(own[0]) if len(own) == 1 else _OF_MANY[type(own[0])](own)


def _alike(finding: BlockFinding) -> str:
    """What findings that share a sentence have in common."""
    if isinstance(finding, ConstantContradicted):
        return f"{finding.code} {finding.guessed} {finding.fixed}"
    return f"{finding.code} {finding.guessed}" if isinstance(finding, ConstantNominal) else finding.code


def _nominal(found: Sequence[BlockFinding]) -> str:
    own = [finding for finding in found if isinstance(finding, ConstantNominal)]
    least, most = (round(100 * share(finding.share for finding in own)) for share in (min, max))
    within = f"{most} %" if least == most else f"{least} to {most} %"
    what = "guessed, as no tag tells them" if own[0].guessed else "nominal, from EXIF"
    listed = some_of([f"{finding.camera} ({finding.c:.0f} px)" for finding in own])
    return (
        f"Without control the camera constants of {len(own)} cameras ({what}, within {within}) cannot be separated from the flying "
        f"height: heights are uncertain by the same share. Calibrate the cameras, or give three control points. They are {listed}."
    )


def _contradicted(found: Sequence[BlockFinding]) -> str:
    own = [finding for finding in found if isinstance(finding, ConstantContradicted)]
    listed = some_of([f"{finding.camera} ({finding.given_px:.0f} px, {finding.adjusted_px:.0f} px fit)" for finding in own])
    used = "but the workflow fixes them" if own[0].fixed else "which were used"
    if own[0].guessed and not own[0].fixed:
        return (
            f"No tag tells the camera constants of {len(own)} cameras, and other values than the guessed ones fit and were used: "
            f"{listed}. Give them, or calibrate the cameras."
        )
    return (
        f"The block contradicts the camera constants of {len(own)} cameras; others fit, {used}: {listed}. Look for wrong focal "
        "lengths, zoom or photograph sizes, or calibrate the cameras."
    )


def _moved(found: Sequence[BlockFinding]) -> str:
    own = [finding for finding in found if isinstance(finding, PrincipalPointMoved)]
    listed = some_of([f"{finding.camera} ({finding.moved_px:.0f} px)" for finding in own])
    return (
        f"The principal points of {len(own)} cameras moved from their given places by many times their standard errors: {listed}. "
        "The block can hardly distinguish them from tangential distortion and the direction of the photographs, and systematic "
        "errors push them. Calibrate the cameras, or fix x0 and y0 to compare."
    )


def _folding(found: Sequence[BlockFinding]) -> str:
    own = [finding for finding in found if isinstance(finding, DistortionFolds)]
    listed = some_of([f"{finding.camera} ({finding.reach_px:.0f} of {finding.corner_px:.0f} px)" for finding in own])
    return (
        f"The distortion of {len(own)} cameras cannot be undone as far as the corners of their frames: {listed}. Tie points "
        "farther out take no part, and those near the limit are poor. Look for camera constants or distortions of other cameras or "
        "image sizes, or calibrate with points that reach the corners."
    )


def _undetermined(found: Sequence[BlockFinding]) -> str:
    own = [finding for finding in found if isinstance(finding, InteriorUndetermined)]
    shares = [f"{f.camera} ({'not at all' if f.share is None else f'only to {100 * f.share:.0f} %'})" for f in own]
    return (
        f"Self-calibration: the block does not determine c, x0, y0 of {len(own)} cameras, which kept their values (flat ground "
        f"seen from above, points on a line or in one plane, or one position): {some_of(shares)}. Give control at different "
        "heights, oblique photographs or photographs turned by 90 degrees, or a calibration."
    )


def _tilts(found: Sequence[BlockFinding]) -> str:
    own = [finding for finding in found if isinstance(finding, TiltUnobserved)]
    # The group whose tilt is known worst stands for all: each is held by its own positions.
    worst = max(own, key=lambda finding: (finding.sigma_deg, finding.tilt_sigma_deg or float("inf")))
    return f"In {len(own)} groups of photographs, each with a datum of its own, at worst: {finding_sentence(worst)}"


def _positions(found: Sequence[BlockFinding]) -> str:
    own = [finding for finding in found if isinstance(finding, PositionContradicted)]
    worst = sorted(own, key=lambda finding: -finding.ratio)
    listed = some_of([f"{finding.photo} ({_length(finding):.1f} m)" for finding in worst])
    return (
        f"The positions of {len(own)} photographs contradict the block and took no part, the worst first: {listed}. Correct them "
        "or leave them out."
    )


def _length(finding: PositionContradicted) -> float:
    return sum(value**2 for value in finding.difference) ** 0.5


_OF_MANY: dict[type, Callable[[Sequence[BlockFinding]], str]] = {
    ConstantNominal: _nominal,
    ConstantContradicted: _contradicted,
    PrincipalPointMoved: _moved,
    DistortionFolds: _folding,
    InteriorUndetermined: _undetermined,
    TiltUnobserved: _tilts,
    PositionContradicted: _positions,
}
