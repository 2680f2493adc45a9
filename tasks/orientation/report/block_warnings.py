"""What is poorly determined in a block, in plain words: datum, control, cameras, overlap, stated precision."""

from collections.abc import Iterator

from orthomill.schemas.errors import some_of
from orthomill.schemas.findings.camera_findings import ConstantNominal, ImageErrorsCorrelated, InteriorUndetermined
from orthomill.schemas.findings.datum_findings import ControlOnALine
from orthomill.schemas.findings.foreign_findings import TiePointsMisfit
from orthomill.schemas.findings.observation_findings import MeasurementsRejected
from orthomill.schemas.observations import ControlPoint
from orthomill.schemas.orientation import GroundResidual
from orthomill.tasks.adjustment.testing.adjustment_result import ObservationKind
from orthomill.tasks.imagery.photograph_rows import rows_of_photos
from orthomill.tasks.orientation.examined.block_facts import CELLS, Facts, filled_areas, told_findings
from orthomill.tasks.orientation.examined.block_numbers import accuracy, contradicts_precision, framed_control, wrong_alone
from orthomill.tasks.orientation.examined.photographed_surface import coverage
from orthomill.tasks.orientation.interchange.foreign_block import MIRRORED
from orthomill.tasks.orientation.report.camera_warnings import camera_warnings
from orthomill.tasks.orientation.report.photographs_left_out import left_out_sentences
from orthomill.tasks.orientation.report.several_findings import finding_sentences
from orthomill.tasks.orientation.report.worse_than_stated import worse_marks, worse_than_stated

ONE_SIDED = 0.2
"""Share of the block's frame that the frame of the control must cover"""
DOUBTFUL = 4.0
"""A surveyed point that misses the block by more of its predicted standard errors is doubtful."""
CHECKED = 0.3
"""Share of an error that its difference shows, below which a coordinate is not called wrong: others would look the same."""
ROUNDING = 1e-9
"""m: a point without redundancy fits exactly but for rounding, and has a predicted standard error of nearly 0."""
NAMED = 3
"""photographs that a warning names; the table has all"""
LEAST_MEASUREMENTS, LEAST_AREAS = 30, 5
"""Tie points of a photograph, and the areas of its frame with any, below which its orientation is poorly determined: six unknowns
need points in opposite corners."""
LEAST_OVERLAP = 60.0
"""% of the photographed surface that two photographs must see: forward overlap of a common flight"""
COSTLY = (ConstantNominal, InteriorUndetermined, ImageErrorsCorrelated, ControlOnALine, MeasurementsRejected, TiePointsMisfit)
"""Findings that cost accuracy without putting the whole block in doubt"""
MANY = 0.15
"""Share of rejected measurements that right tie points do not reach"""
_WRONG_COORDINATE = "A wrong coordinate among few control points has the same effect."


def block_warnings(facts: Facts) -> Iterator[str]:
    """Whole sentences about what is poorly determined in the block, and what to do."""
    yield from left_out_sentences(facts.block.unoriented)
    yield from finding_sentences(told_findings(facts.control, facts.precision))
    yield from (finding.sentence for finding in facts.control.findings)
    yield from _control_warnings(facts)
    yield from camera_warnings(facts)
    yield from _photo_warnings(facts)
    yield from _overlap_warnings(facts)
    yield from _factor_warnings(facts)
    yield from _written_warnings(facts)


def block_losses(facts: Facts) -> Iterator[str]:
    """Those of them that cost accuracy or ground, the dearest first."""
    yield from left_out_sentences(facts.block.unoriented)
    yield from _overlap_warnings(facts)
    yield from finding_sentences([finding for finding in facts.precision.findings if isinstance(finding, COSTLY)])
    yield from _control_warnings(facts)
    yield from _photo_warnings(facts)
    yield from _factor_warnings(facts)


def _control_warnings(facts: Facts) -> Iterator[str]:
    surveyed = [point for point in facts.control.points if point.role != "tie"]
    if not surveyed and not len(facts.image):
        yield (
            "The orientation was taken as it is from another source, and nothing here checks it: what rests on it is as good as "
            "that source."
        )
    # Of a block without datum a finding of its own says what it lacks.
    elif not surveyed and not facts.without_datum and all(photo.position is None for photo in facts.photos.photos):
        yield (
            "There is no ground control, and no photograph has a position: the block has its own shape, but no place, direction or "
            "scale on the ground. Measure at least five points on the ground, and keep some of them as check points."
        )
    elif not surveyed and not facts.without_datum:
        yield (
            "There is no ground control: absolute position and height are as good as the positions of the photographs, and nothing "
            "independent checks them. Measure at least five points on the ground, and keep some of them as check points."
        )
    elif surveyed and all(point.role != "check" for point in surveyed):
        yield "There are no check points, so nothing independent confirms the block; turn some control points into check points."
    # A free block has no coordinates to compare: one sentence instead of one for every point.
    if surveyed and not facts.ground.points:
        yield f"None of the {len(surveyed)} surveyed points was compared with the block, which has no place in their system."
        return
    yield from _one_sided(facts)
    compared = {row.name: row for row in facts.ground.points}
    # Check points without a mark have their own sentence.
    marked = [point for point in surveyed if point.measurements or point.role != "check"]
    yield from (_unused(point) for point in marked if not _took_part(compared.get(point.name)))
    yield from _doubtful_points(facts, surveyed, compared)
    yield from _contradicting_checks(facts)


def _contradicting_checks(facts: Facts) -> Iterator[str]:
    """Check points that are, all together, farther from the block than it predicts, although none stands out."""
    checks = facts.ground.of_role("check")
    found = accuracy(checks)
    if found is None or not contradicts_precision(found, facts.ground.checked):
        return
    if alone := wrong_alone(checks, facts.ground.checked):
        point, others = alone
        x, y, z = point.difference
        yield (
            f"The check point {point.name} contradicts the block, by {x:+.2f}, {y:+.2f}, {z:+.2f} m, and is alone with that: the "
            f"other {others.points} differ by {others.by_predicted:.1f} times what the adjustment predicts for them. Compare its "
            "coordinates and its marks. It is counted until it is left out."
        )
    else:
        yield (
            f"The check points differ from the block by {found.by_predicted:.1f} times what the adjustment predicts for them, all "
            "taken together, and chance does not make that: their survey, that of the control, the marks or the model of the "
            f"camera is worse than stated. Take the stated standard errors of the block {found.by_predicted:.1f} times as large."
        )


def _took_part(row: GroundResidual | None) -> bool:
    return row is not None and row.photos > 0


def _unused(point: ControlPoint) -> str:
    return (
        f"The {point.role} point {point.name} took no part: it has too few measurements in the oriented photographs, or all were "
        "rejected as blunders; compare its coordinates and its measurements."
    )


def _doubtful_points(facts: Facts, surveyed: list[ControlPoint], compared: dict[str, GroundResidual]) -> Iterator[str]:
    """Points that differ from the block, although the blunder tests kept them."""
    tested = [point for point in surveyed if _took_part(compared.get(point.name)) and point.name not in facts.precision.blunders]
    # A check point that is wrong by itself has a sentence of its own.
    alone = wrong_alone(facts.ground.of_role("check"), facts.ground.checked)
    tested = [point for point in tested if alone is None or point.name != alone[0].name]
    doubtful = [f"{point.role} point {point.name}" for point in tested if _differs(compared[point.name])]
    if len(doubtful) == 1:
        yield f"The {doubtful[0]} differs from the block by more than four times the predicted standard error; it may be wrong."
    elif doubtful:
        yield (
            "Several points differ from the block by more than four times the predicted standard error: "
            f"{some_of(doubtful)}. One of them may be wrong and affect the others, and the other observations cannot show which. "
            "Leave them out one at a time, or give more control or positions."
        )


def _differs(row: GroundResidual) -> bool:
    checked = (True,) * 3 if row.redundancy is None else tuple(share >= CHECKED for share in row.redundancy)
    rows = zip(row.difference, row.predicted, checked, strict=True)
    return any(known and abs(d) > DOUBTFUL * s + ROUNDING for d, s, known in rows)


def _one_sided(facts: Facts) -> Iterator[str]:
    """Control that frames only a small part of the block: away from it errors of rotation and scale grow with the distance."""
    framed = framed_control(facts)
    if framed is None or framed.share >= ONE_SIDED:
        return
    side = f"{'north' if framed.north else 'south'}-{'east' if framed.east else 'west'}"
    yield (
        f"The control is one-sided: its frame covers {100 * framed.share:.0f} % of the block's, towards the {side}. Away from it "
        "errors grow; add control on the other side."
    )


def _photo_warnings(facts: Facts) -> Iterator[str]:
    names, weak = facts.photos.names, []
    rows = dict(zip(names, rows_of_photos(facts.image.photo, len(names)), strict=True))
    # A fixed block without tie points has no measurements at all, which is reported once and not for every photograph.
    for photo in facts.block.photos if len(facts.image) else ():
        # Used measurements only: rejected ones determine nothing.
        mine = rows[photo.photo]
        own = facts.image.take(mine[facts.image.used[mine]])
        filled = filled_areas(own, facts.block.camera_of(photo.photo))
        if len(own) < LEAST_MEASUREMENTS or filled < LEAST_AREAS:
            weak.append(f"{photo.photo} ({len(own)} measurements in {filled} areas)")
    if weak:
        yield (
            f"Weakly tied, with few measurements or in few of the {CELLS * CELLS} areas of the frame: {some_of(weak, NAMED)}. More "
            "overlap there would help, or photographs with less water and leaves."
        )


def _overlap_warnings(facts: Facts) -> Iterator[str]:
    # Without tie points the surface is not known, on which overlap is counted.
    by_two, _ = coverage(facts)
    if len(facts.points) and by_two < LEAST_OVERLAP:
        yield (
            f"Weak overlap: only {by_two:.0f} % of the photographed surface is seen by two photographs or more, and the rest gets "
            "no heights. Take photographs with more overlap."
        )


def _factor_warnings(facts: Facts) -> Iterator[str]:
    precision = facts.precision
    yield from (worse.sentence for worse in worse_than_stated(facts))
    # Below 1 the measurements are better than stated, which needs no warning.
    pointing = next((group.factor for group in precision.groups if group.name == ObservationKind.POINTINGS), 1.0)
    if pointing > 1.0:
        # Without datum no coordinate takes part: only the measurements themselves can be wrong.
        cause = "Some may lie in the wrong place." if facts.without_datum else _WRONG_COORDINATE
        yield f"{worse_marks(facts.control, pointing)} {cause}"
    share = precision.rejected / max(precision.rejected + precision.rays, 1)
    if share > MANY:
        yield f"{100 * share:.0f} % of the image measurements were rejected; the tie points contain many wrong matches."


def _written_warnings(facts: Facts) -> Iterator[str]:
    """What the files for other programs cannot express: scans in a frame of their own, and mirrored photographs."""
    if any(photo.scan is not None for photo in facts.photos.photos):
        yield (
            "The photographs are scans that were transformed into a common frame: the cameras written for COLMAP and OpenSfM "
            "belong to that frame and not to the scan files. exterior_orientation.csv holds for both."
        )
    upright = [photo.name for photo in facts.photos.photos if photo.exif_orientation in MIRRORED]
    mirrored = [name for name in upright if name in facts.block.names]
    if mirrored:
        yield (
            f"EXIF mirrors {some_of(mirrored)}, which no orientation in space expresses: files for COLMAP and OpenSfM show the "
            "photographs upright. Save them upright for other programs."
        )
