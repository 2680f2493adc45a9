"""The words of the report for what the orientation found out: one function per finding, each a sentence with its remedy."""

from functools import singledispatch

import numpy as np

from orthomill.schemas.camera import INTERIOR
from orthomill.schemas.errors import some_of
from orthomill.schemas.findings.block_findings import (
    AxesExchanged,
    BlockBent,
    BlockElsewhere,
    BlockFinding,
    BlockSeparate,
    BlockUnexamined,
    CheckMeasurementsApart,
    ConstantContradicted,
    ConstantNominal,
    ControlContradicted,
    ControlOnALine,
    ControlUnmet,
    DatumGivenUp,
    DatumMisfit,
    DistanceContradicted,
    DistanceUnchecked,
    DistortionFolds,
    GroupsUnconnected,
    ImageErrorsCorrelated,
    InteriorDemanded,
    InteriorFixed,
    InteriorUndetermined,
    InteriorUnweighted,
    LargestReconstruction,
    LensContradicted,
    LooksUpward,
    MeasurementsRejected,
    Misfit,
    NoDatum,
    PhotosUnknown,
    PositionContradicted,
    PositionsAlongView,
    PositionsCrowded,
    PositionsElsewhere,
    PrincipalPointMoved,
    TiePointsMisfit,
    TiltUnobserved,
    Vector,
)
from orthomill.tasks.orientation.sources.source_sentences import SOURCE_SENTENCES
from orthomill.tasks.orientation.start.up_direction import SENTENCES

MOSTLY_CAMERA = 0.5
"""From this share of their variance on, correlated image errors are attributed to the camera, below it to single photographs."""
HIDDEN = 2.0
"""Displacements so many times what the residuals show of them are told with that part."""
IN_PIXELS = ("c", "x0", "y0")
"""Parameters of a camera with the unit px; the others of this sentence are coordinates of a photograph."""
KILOMETRE = 1000.0
OPEN_DEG = np.degrees(1.0)
"""A tilt with a larger standard error is called undetermined: linearised angles mean nothing there."""


@singledispatch
def finding_sentence(finding: BlockFinding) -> str:
    """The finding as a whole sentence: what was found, and what to do about it."""
    raise TypeError(f"the report has no words for {type(finding).__name__}")


@finding_sentence.register
def no_datum(finding: NoDatum) -> str:
    exact = "a scale" if finding.scale_share is None else f"an approximate scale (to {100 * finding.scale_share:.0f} %)"
    what = (
        f"The block has {exact} but no datum: its coordinates are metres in a system of its own."
        if finding.scaled
        else "The block has no datum: its files are in a local system of arbitrary scale, in units that are not metres."
    )
    return f"{what} Give positions or three control points."


@finding_sentence.register
def positions_crowded(finding: PositionsCrowded) -> str:
    return (
        "The positions of the photographs lie closer together than their own standard errors, so they determine neither place nor "
        "direction and take no part. Correct them, or state their true precision."
    )


@finding_sentence.register
def control_unmet(finding: ControlUnmet) -> str:
    upright, turned = (" as EXIF turns them", "the frame before that, ") if finding.turned else ("", "")
    return (
        f"The rays of {finding.points} of the {finding.measured} control points that are measured in two photographs or more do "
        f"not meet, and took no part. They were read as pixels of the photographs{upright}, and may be those of {turned}another "
        "size or another photograph: compare one measurement with its photograph."
    )


@finding_sentence.register
def tilt_unobserved(finding: TiltUnobserved) -> str:
    # Both numbers: a reader must see what the observations say, and what the assumption adds.
    alone = finding.tilt_sigma_deg
    fixed = "do not determine" if alone is None or alone > OPEN_DEG else f"determine only to {alone:.1f} degrees"
    return (
        f"Positions and control lie nearly on one line and {fixed} the tilt about it; it rests {SENTENCES[finding.basis]}, "
        f"then good to {finding.sigma_deg:.1f} degrees. Measure control away from the line, or fly parallel strips farther apart."
    )


@finding_sentence.register
def control_on_a_line(finding: ControlOnALine) -> str:
    return "The control is one-sided: its points lie nearly on one line. Add control away from that line."


@finding_sentence.register
def datum_misfit(finding: DatumMisfit) -> str:
    return (
        f"The known positions and the shape of the block disagree: the median misfit before the adjustment is {finding.ratio:.0f} "
        "standard errors. Positions, their standard errors or the CRS may be wrong."
    )


@finding_sentence.register
def block_bent(finding: BlockBent) -> str:
    how = []
    if finding.scatter_m is not None:
        how.append(f"against the positions of its photographs, which scatter by only {_rounded(finding.scatter_m)} m about that")
    if finding.views_deg is not None:
        away = f"{abs(finding.views_deg):.1f} degrees"
        how.append(f"against the attitudes of its photographs, from which the directions of view diverge by {away}")
    size, shape = f"{finding.pixels:.0f} pixels on the ground", "dome" if finding.bend_m < 0 else "bowl"
    if finding.in_metres:
        size = f"{_rounded(abs(finding.bend_m))} m over {finding.extent_m:.0f} m ({size}, a {shape})"
    else:
        size = f"{size} (a {shape})"
    what = f"The block bends by {size} {', and '.join(how)}"
    if not finding.grave:
        return f"{what}: about what a model of the lens leaves."
    cause = (
        "not the receiver but the camera is wrong"
        if finding.sure
        else "the camera is wrong, or heights of a barometer, which err where a drone brakes and turns"
    )
    return (
        f"{what}: {cause}. Give the camera's calibration or the standard errors of RTK positions, "
        "add strips across at another height or oblique photographs, or measure control in the middle and at the ends."
    )


@finding_sentence.register
def looks_upward(finding: LooksUpward) -> str:
    return (
        "By the control the photographs look upwards from below. Unless they show a ceiling, X and Y of the control are exchanged: "
        "compare its file."
    )


@finding_sentence.register
def axes_exchanged(finding: AxesExchanged) -> str:
    return (
        f"With X and Y of the control exchanged it fits the block to {finding.exchanged_m:.2f} m, but as given only to "
        f"{finding.given_m:.2f} m, and with photographs that look up from below the ground: it was not used. Exchange X and Y in "
        "the file."
    )


@finding_sentence.register
def distortion_folds(finding: DistortionFolds) -> str:
    return (
        f"The distortion of the camera {finding.camera} cannot be undone farther than {finding.reach_px:.0f} px from its principal "
        f"point, while a corner of the frame lies {finding.corner_px:.0f} px away (k1 = {finding.k1:.3g}, c = {finding.c:.0f} px): "
        "tie points farther out take no part, and those near the limit are poor. Look for a camera constant or distortion of "
        "another camera or image size, or calibrate with points that reach the corners."
    )


def _cameras(names: tuple[str, ...]) -> str:
    return " and ".join(names) if len(names) < 3 else f"{len(names)} cameras ({some_of(names)})"


@finding_sentence.register
def interior_undetermined(finding: InteriorUndetermined) -> str:
    # A share above 100 % is printed as it is: it shows how far the block is from determining the value.
    how = "not at all" if finding.share is None else f"only to {100 * finding.share:.0f} %"
    return (
        f"Self-calibration: the block determines {', '.join(INTERIOR[:3])} of {finding.camera} {how} (flat ground seen from above, "
        "points on a line or in one plane, or one position), so they kept their values. Give control at different heights, oblique "
        "photographs or photographs turned by 90 degrees, or a calibration."
    )


@finding_sentence.register
def interior_fixed(finding: InteriorFixed) -> str:
    return (
        f"The interior orientation of {_cameras(finding.cameras)} could not be adjusted: the block does not determine it. It was "
        "kept as it was given, so that heights may bend over the block; calibrate the camera, or add oblique photographs or "
        "control at different heights."
    )


@finding_sentence.register
def datum_given_up(finding: DatumGivenUp) -> str:
    return (
        "With its positions and control the block could not be adjusted, because they pull against its tie points, most of all "
        f"{', '.join(finding.worst)}: the block was adjusted without any of them. Compare their coordinates and measurements."
    )


@finding_sentence.register
def interior_unweighted(finding: InteriorUnweighted) -> str:
    return (
        f"The interior orientation of {_cameras(finding.cameras)} was given without standard errors, so there is nothing to "
        "weight it with and it kept its values. Give its standard error (sigma_c) if the block shall improve it, or say that it is "
        "held (interior: {kind: fixed})."
    )


@finding_sentence.register
def constant_contradicted(finding: ConstantContradicted) -> str:
    if finding.guessed and not finding.fixed:
        return (
            f"No tag tells the camera constant of {finding.camera}: {finding.given_px:.0f} px were guessed, "
            f"{finding.adjusted_px:.0f} px (standard error {_rounded(finding.sigma_px)} px) fit and were used. Give it, or "
            "calibrate the camera."
        )
    # With a fixed interior orientation the workflow decides, and the finding only reports.
    end = "but the workflow fixes it" if finding.fixed else "which was used"
    return (
        f"The block contradicts the camera constant of {finding.camera}: {finding.given_px:.0f} px were given, "
        f"{finding.adjusted_px:.0f} px (standard error {_rounded(finding.sigma_px)} px) fit, {end}. Look for a wrong focal length, "
        "zoom or photograph size, or calibrate the camera."
    )


@finding_sentence.register
def lens_contradicted(finding: LensContradicted) -> str:
    names = ("k1", "k2")[: len(finding.fits)]
    given, fits = (
        ", ".join(f"{n} = {v:.3g}" for n, v in zip(names, values, strict=True)) for values in (finding.given, finding.fits)
    )
    return (
        f"The block contradicts the distortion of {finding.camera}: {given} was given and held, about {fits} fits, which moves the "
        f"border of the frame by {finding.border_px:.1f} px ({finding.ratio:.0f} standard errors). Heights bend over the block. "
        "Look for the lens, focus, zoom or lens model of another calibration, or let the distortion take part (interior: {kind: "
        "free})."
    )


@finding_sentence.register
def constant_nominal(finding: ConstantNominal) -> str:
    what = "guessed, as no tag tells it" if finding.guessed else "nominal, from EXIF"
    return (
        f"Without control the camera constant of {finding.camera} ({what}, {finding.c:.0f} px, within "
        f"{100 * finding.share:.0f} %) cannot be separated from the flying height: heights are uncertain by the same share. "
        "Calibrate the camera, or give three control points."
    )


@finding_sentence.register
def interior_demanded(finding: InteriorDemanded) -> str:
    before, after = finding.sigma0_px
    found = f"x0 = {finding.x0_px:.1f} px, y0 = {finding.y0_px:.1f} px and k3 = {finding.k3:.3g}"
    return (
        f"The tags of {finding.camera} leave its principal point and its outer distortion open, and its photographs fit together "
        f"only with {found} (sigma0 {before:.3f} px without, {after:.3f} px with them), which were adjusted: without them heights "
        "would bend over the block. A calibration of the camera saves that."
    )


@finding_sentence.register
def principal_point_moved(finding: PrincipalPointMoved) -> str:
    return (
        f"The principal point of {finding.camera} moved {finding.moved_px:.0f} px from its given place, many times its standard "
        "error: the block can hardly distinguish it from tangential distortion and the direction of the photographs, and "
        "systematic errors push it. Calibrate the camera, or fix x0 and y0 to compare."
    )


@finding_sentence.register
def image_errors_correlated(finding: ImageErrorsCorrelated) -> str:
    whose = (
        "mostly alike in all photographs of a camera"
        if finding.camera_share >= MOSTLY_CAMERA
        else "mostly different in each photograph"
    )
    # Residuals of a tenth of a pixel beside displacements of a whole one look like a mistake of the report.
    what = (
        f"whole regions of a photograph are displaced by {_rounded(finding.rms_px)} px on average, {whose}"
        if finding.shown_px is None or finding.rms_px < HIDDEN * finding.shown_px
        else f"residuals of whole regions of a photograph are alike by {_rounded(finding.shown_px)} px, {whose}, and are what is "
        f"left of displacements by about {_rounded(finding.rms_px)} px, most of which the orientation and the camera can absorb"
    )
    unit = " px" if finding.parameter in IN_PIXELS else ""
    return (
        f"Correlated image errors: {what}. The standard errors include them: {finding.parameter} of {finding.owner} is known to "
        f"{_rounded(finding.sigma)}{unit}, not to {_rounded(finding.white_sigma)}{unit}. Calibrate the camera, or turn some "
        "photographs by 90 degrees."
    )


def _rounded(value: float) -> str:
    """Two digits: not 3e+02 for hundreds, nor 0.00 for thousandths; a standard error has no more digits."""
    return f"{float(f'{value:.2g}'):g}"


@finding_sentence.register
def control_contradicted(finding: ControlContradicted) -> str:
    return (
        f"The control point {finding.point} contradicts the block {_misses(finding.difference, finding.ratio)}; it took no part. "
        "Compare its coordinates (name, CRS, height system) and its measurements in the photographs."
    )


@finding_sentence.register
def position_contradicted(finding: PositionContradicted) -> str:
    return (
        f"The position of {finding.photo} contradicts the block {_misses(finding.difference, finding.ratio)}; it took no part. "
        "Correct it or leave it out."
    )


def _misses(difference: Vector, ratio: float) -> str:
    there = ", ".join(f"{value:+.2f}" for value in difference)
    return f"(block minus given: {there} m in X, Y, Z; {ratio:.0f} times the predicted standard error)"


@finding_sentence.register
def positions_elsewhere(finding: PositionsElsewhere) -> str:
    away = finding.distance_m
    length = f"{away / KILOMETRE:.1f} km" if away >= KILOMETRE else f"{away:.0f} m"
    return (
        f"The positions of {finding.photos} photographs contradict the block: they lie {length} from where everything else puts "
        "these photographs, and took no part. They are of another place or in another CRS, or the control is; compare one "
        "photograph with a map."
    )


@finding_sentence.register
def positions_along_view(finding: PositionsAlongView) -> str:
    return (
        f"The positions of {finding.photos} photographs contradict the control by {abs(finding.along_m):.1f} m along the viewing "
        "direction and hardly across it, as heights in two systems do (above the ellipsoid and above the sea), or a wrong camera "
        "constant. The positions took no part; compare the systems, and the focal length."
    )


@finding_sentence.register
def distance_contradicted(finding: DistanceContradicted) -> str:
    which = f"The distance from {finding.first} to {finding.second} ({finding.length:.3f} m) contradicts"
    off = f"block minus given: {finding.difference:+.3f} m"
    if finding.outcome == "downweighted":
        return (
            f"{which} the other distances ({off}), and too few of them show which is wrong; the scale of the block lies between "
            "them. Measure it again, or one more."
        )
    end = (
        "it took no part. Compare it with its two points"
        if finding.outcome == "excluded"
        else "too few others show which of them is wrong. Measure it again"
    )
    return f"{which} the block ({off}, {finding.ratio:.0f} times the predicted standard error); {end}."


@finding_sentence.register
def distance_unchecked(finding: DistanceUnchecked) -> str:
    return (
        "One distance alone gives the scale of the block, and nothing checks it: measure two more, so that a wrong one can be "
        "identified."
    )


@finding_sentence.register
def measurements_rejected(finding: MeasurementsRejected) -> str:
    count = len(finding.rejected)
    them = "it" if count == 1 else "them"
    # A measurement that lies on another point was made at the right place under a wrong name.
    named = sum(one.lies_on is not None for one in finding.rejected)
    advice = f"Give {them} the right name" if named == count else f"Measure {them} again"
    if 0 < named < count:
        advice = "Give those on another point its name, and measure the others again"
    return (
        f"{count} of {finding.measured} measurements of the {finding.role} point {finding.point} in photographs contradict the "
        f"others and took no part: {_places(finding.rejected)}. {advice}."
    )


@finding_sentence.register
def check_measurements_apart(finding: CheckMeasurementsApart) -> str:
    return (
        f"{len(finding.apart)} of {finding.measured} measurements of the check point {finding.point} in photographs do not meet "
        f"the others, which lie on its coordinates: {_places(finding.apart)}. Measure again, or give the right name."
    )


def _places(misfits: tuple[Misfit, ...]) -> str:
    return ", ".join(f"{one.photo} ({_off(one)}{f', where {one.lies_on} lies' if one.lies_on else ''})" for one in misfits)


def _off(misfit: Misfit) -> str:
    return "not where the block sees it" if misfit.misfit_px is None else f"{misfit.misfit_px:.0f} px off"


@finding_sentence.register
def groups_unconnected(finding: GroupsUnconnected) -> str:
    # The largest group is the block itself and needs no names.
    others = "; ".join(", ".join(group) for group in finding.groups[1:])
    return (
        f"The photographs form {len(finding.groups)} groups which no reliable tie points connect; each is held by its own "
        f"positions and control only. Apart from the largest: {others}. Photographs between them would join them."
    )


@finding_sentence.register
def block_separate(finding: BlockSeparate) -> str:
    return (
        f"{', '.join(finding.photos)} form a separate group which neither tie points nor positions or control connect to the "
        "block; it is kept as a free block of its own and takes no part in later stages. Run its photographs as a project of their "
        "own, or give positions or control that place it."
    )


@finding_sentence.register
def largest_reconstruction(finding: LargestReconstruction) -> str:
    return f"The file contains {finding.count} reconstructions; the largest, of {finding.photos} photographs, is taken."


@finding_sentence.register
def photos_unknown(finding: PhotosUnknown) -> str:
    return (
        f"The block that was read has {len(finding.photos)} photographs which the project does not have: {some_of(finding.photos)}."
    )


@finding_sentence.register
def block_elsewhere(finding: BlockElsewhere) -> str:
    x, y, z = finding.offset
    return (
        f"The block that was read from {finding.source} puts its photographs elsewhere than their positions do (median: {x:+.1f}, "
        f"{y:+.1f}, {z:+.1f} m in X, Y, Z): its coordinates are in another reference or height system than the project, or the "
        "positions are of another place."
    )


@finding_sentence.register
def tie_points_misfit(finding: TiePointsMisfit) -> str:
    return (
        f"The project's tie points miss the orientation that was read from {finding.source} by {finding.rms_px:.1f} px, "
        f"{finding.factor:.0f} times their standard errors: it is not that of these photographs and cameras. Look for another "
        "order or unit of the angles, other axes, a camera of other pixels, or photographs under wrong names; or let the "
        "photographs be oriented here (exterior: {kind: adjusted})."
    )


@finding_sentence.register
def block_unexamined(finding: BlockUnexamined) -> str:
    return (
        f"No tie points of the project examine the orientation that was read from {finding.source}: with the stage tie_points in "
        "the workflow the report would show how well it fits."
    )


for _sentence in SOURCE_SENTENCES:
    finding_sentence.register(_sentence)
