"""What is weak in a block, in plain words: datum, control, cameras, overlap, stated precision."""

import numpy as np

from orthomill.schemas.errors import some_of
from orthomill.tasks.adjustment.model.adjustment_result import ObservationKind
from orthomill.tasks.orientation.interchange.foreign_block import MIRRORED
from orthomill.tasks.orientation.reporting.block_facts import CELLS, Facts, coverage, filled_areas
from orthomill.tasks.orientation.reporting.finding_sentences import finding_sentence

ONE_SIDED = 0.2
"""Share of the block's frame that control must cover"""


def block_warnings(facts: Facts) -> list[str]:
    """Whole sentences about what is weak in the block, and what to do."""
    return [
        *(u.reason for u in facts.block.unoriented),
        *(finding_sentence(finding) for finding in facts.precision.findings),
        *facts.control.remarks,
        *_control_warnings(facts),
        *_camera_warnings(facts),
        *_photo_warnings(facts),
        *_factor_warnings(facts),
        *_written_warnings(facts),
    ]


def _control_warnings(facts: Facts) -> list[str]:
    roles = [point.role for point in facts.control.points if point.role != "tie"]
    found = []
    if not roles:
        found.append(
            "There is no ground control: absolute position and height are as good as the positions of the photographs, and "
            "nothing independent checks them."
        )
    elif "check" not in roles:
        found.append(
            "There are no check points, so nothing independent confirms the block; turn some control points into check points."
        )
    tested = {p.name: p for p in facts.ground.points}
    if roles and not tested:
        return [
            *found,
            f"None of the {len(roles)} surveyed points was compared with the block, which has no place in their system.",
        ]
    found += _one_sided(facts)
    doubtful = []
    for point in (point for point in facts.control.points if point.role != "tie"):
        row = tested.get(point.name)
        if row is None or row.photos == 0:
            found.append(
                f"The {point.role} point {point.name} took no part: it has too few measurements in the oriented photographs, or "
                "all were rejected as blunders; compare its coordinates and its measurements."
            )
        elif point.name not in facts.precision.blunders and any(
            abs(d) > 4.0 * s + 1e-9 for d, s in zip(row.difference, row.predicted, strict=True)
        ):
            doubtful.append(f"{point.role} point {point.name}")
    if len(doubtful) == 1:
        found.append(
            f"The {doubtful[0]} differs from the block by more than four times the predicted standard error; it may be wrong."
        )
    elif doubtful:
        found.append(
            "Several points differ from the block by more than four times the predicted standard error: "
            f"{some_of(doubtful)}. One of them may be wrong and pull at the others, and what else is known cannot tell which. "
            "Leave them out one at a time, or give more control or positions."
        )
    return found


def _one_sided(facts: Facts) -> list[str]:
    """Control that frames only a small part of the block: beside it, the block hangs out like a lever."""
    control = np.array([point.xyz for point in facts.control.points if point.role == "control"]).reshape(-1, 3)[:, :2]
    ties = np.column_stack([facts.points.x, facts.points.y])
    if len(control) < 3 or len(ties) < 10:
        return []
    low, high = np.percentile(ties, [2, 98], axis=0)
    share = float(
        np.prod(np.clip(np.minimum(control.max(axis=0), high) - np.maximum(control.min(axis=0), low), 0, None) / (high - low))
    )
    if share >= ONE_SIDED:
        return []
    side = "north" if control[:, 1].mean() > ties[:, 1].mean() else "south"
    side += "-east" if control[:, 0].mean() > ties[:, 0].mean() else "-west"
    return [
        f"The control is one-sided: its frame covers {100 * share:.0f} % of the block's, towards the {side}. Away from it errors "
        "grow; add control on the other side."
    ]


def _correlation_warnings(facts: Facts) -> list[str]:
    """One sentence for every camera whose parameters hang together, and one for each that hangs together with the flying height."""
    within: dict[str, list[str]] = {}
    found = []
    for c in facts.precision.correlations:
        (first, _, camera), (second, _, other) = c.first.partition(" of "), c.second.partition(" of ")
        if camera == other:
            within.setdefault(camera, []).append(f"{first} and {second} ({c.value:.2f})")
        else:
            found.append(
                f"{c.first} and {c.second} can hardly be told apart (correlation {c.value:.2f}): their values are not to be used "
                "one without the other."
                + (" Control at different heights, or oblique photographs, would part them." if "height" in c.second else "")
            )
    return found + [
        f"Parameters of the camera {camera} can hardly be told apart: {', '.join(pairs)}. Their values are not to be used one "
        "without the other; together they are as good as their residuals."
        for camera, pairs in within.items()
    ]


def _camera_warnings(facts: Facts) -> list[str]:
    found = _correlation_warnings(facts)
    for name, camera in facts.block.cameras.items():
        before = facts.before.cameras.get(name, camera)
        if before.source == "exif" and camera.source != "block":
            found.append(
                f"The camera {name} is known from EXIF only and was not adjusted: heights may bend over the block. Calibrate it, "
                "or let its interior orientation take part."
            )
        if camera.source == "block" and abs(camera.c / before.c - 1.0) > 0.06:
            found.append(
                f"The adjusted camera constant of {name} is {100 * (camera.c / before.c - 1):+.1f} % off the one it started with; "
                "it may have taken up other errors (a rolling shutter, wrong heights). Hold it fixed with a calibrated value to "
                "compare."
            )
    return found


def _photo_warnings(facts: Facts) -> list[str]:
    names, weak, found = facts.photos.names, [], []
    for photo in facts.block.photos if len(facts.image) else ():
        own = facts.image.take((facts.image.photo == names.index(photo.photo)) & facts.image.used)
        filled = filled_areas(own, facts.block.camera_of(photo.photo))
        if len(own) < 30 or filled < 5:
            weak.append(f"{photo.photo} ({len(own)} measurements in {filled} areas)")
    if weak:
        found.append(
            f"Weakly tied, with few measurements or in few of the {CELLS * CELLS} areas of the frame: {', '.join(weak)}. Where a "
            "frame is empty nothing holds its orientation; more overlap would help, or photographs with less water and leaves."
        )
    two, _ = coverage(facts)
    if two < 60.0:
        found.append(f"Weak overlap: only {two:.0f} % of the photographed ground is seen by two photographs or more.")
    return found


def _written_warnings(facts: Facts) -> list[str]:
    """What the files for other programs cannot say: they know neither scans in a frame of their own nor mirrored photographs."""
    found = []
    if any(photo.scan is not None for photo in facts.photos.photos):
        found.append(
            "The photographs are scans that were put into a common frame: the cameras written for COLMAP and OpenSfM belong to "
            "that frame and not to the scan files. exterior_orientation.csv holds for both."
        )
    upright = [photo.name for photo in facts.photos.photos if photo.exif_orientation in MIRRORED]
    mirrored = [name for name in upright if name in facts.block.names]
    if mirrored:
        found.append(
            f"EXIF mirrors {some_of(mirrored)}, which no orientation in space expresses: the files for COLMAP and OpenSfM hold the "
            "photographs upright. Save them upright for other programs."
        )
    return found


def _factor_warnings(facts: Facts) -> list[str]:
    found, precision = [], facts.precision
    if precision.position_factor > 1.0:
        found.append(
            f"The GNSS positions are worse than stated: their standard errors were enlarged {precision.position_factor:.1f} times."
        )
    if precision.control_factor > 1.0:
        found.append(
            f"The ground control is worse than stated: its standard errors were enlarged {precision.control_factor:.1f} times."
        )
    pointing = next((group.factor for group in precision.groups if group.name == ObservationKind.POINTINGS), 1.0)
    if pointing > 1.0:
        found.append(
            "The measurements of surveyed points in the photographs fit worse than stated: their standard errors were enlarged "
            f"{pointing:.1f} times. A wrong coordinate among few control points does this, too."
        )
    share = precision.rejected / max(precision.rejected + precision.rays, 1)
    if share > 0.15:
        found.append(f"{100 * share:.0f} % of the image measurements were rejected; the tie points hold many wrong matches.")
    return found
