"""The words of the report for contradictions between sources."""

from collections.abc import Sequence

from orthomill.schemas.findings.block_findings import ConstantOfItsOwn, OffsetAdjusted, SourcesDisagree, UnitContradicted
from orthomill.tasks.orientation.control.control_heights import with_vertical

HEIGHT = 2
_KINDS = {
    "ellipsoidal": " (the tags say: above the ellipsoid)",
    "sea_level": " (the tags say: above the sea)",
    "barometric": " (the tags say: by the air pressure)",
    "relative": " (the tags say: above the place of take-off)",
}


def offset_adjusted(finding: OffsetAdjusted) -> str:
    """A constant error of all positions against the control, or of some against the others."""
    heights_only = finding.offset[0] is None and finding.offset[1] is None
    own, size = "heights of the positions" if heights_only else "positions", _height(finding) if heights_only else _vector(finding)
    if finding.against == "control":
        kind = _KINDS.get(finding.heights or "", "")
        cause, compare = (", as heights in two systems do", "height system") if heights_only else ("", "reference system")
        return (
            f"The {own}{kind} lie {size} the control{cause}: they were adjusted with one offset, and both keep their standard "
            f"errors. State the {compare} of each in the workflow, or correct one of them."
        )
    zoomed = (
        f" {finding.zoom:.3g} times the camera constant (zoom, a second camera) would put them there, too, but the photographs do "
        "not show it."
        if finding.zoom
        else ""
    )
    return (
        f"The {own} of {photographs(finding.photos)} lie {size} those of the others in the block: they were adjusted with an "
        f"offset of their own. Without it the block would be tilted by {finding.tilt_deg:.1f} degrees and lie up to "
        f"{finding.moved_m:.1f} m elsewhere.{zoomed} Which of them are right the block cannot say{_choice(finding)}: compare the "
        "heights of the flights, or give control."
    )


def _choice(finding: OffsetAdjusted) -> str:
    """What the result would be if the positions with the offset were the right ones."""
    height = finding.offset[HEIGHT]
    if height is None:
        return ""
    return f" (if theirs are, all lies {abs(height):.2f} m {'higher' if height > 0 else 'lower'})"


def photographs(names: Sequence[str]) -> str:
    """Photographs in a row, by the first and the last of them."""
    return ", ".join(names) if len(names) < 3 else f"{names[0]} to {names[-1]} ({len(names)} photographs)"


def _height(finding: OffsetAdjusted) -> str:
    value, sigma = finding.offset[HEIGHT] or 0.0, finding.sigma[HEIGHT] or 0.0
    return f"{abs(value):.2f} m (standard error {sigma:.2f} m) {'above' if value > 0 else 'below'}"


def _vector(finding: OffsetAdjusted) -> str:
    known = zip(("X", "Y", "height"), finding.offset, finding.sigma, strict=True)
    values = [
        f"{value:+.2f} m in {name} (standard error {sigma or 0.0:.2f} m)" for name, value, sigma in known if value is not None
    ]
    return f"{', '.join(values)} away from"


def constant_of_its_own(finding: ConstantOfItsOwn) -> str:
    """Photographs with a camera of their own."""
    factor = finding.c_px / finding.others_px
    return (
        f"{photographs(finding.photos)} were taken with {factor:.3g} times the camera constant of the other photographs of "
        f"{finding.camera} ({finding.c_px:.0f} and {finding.others_px:.0f} px): zoom, another lens or a second camera of the model "
        "that no tag tells. They were given a camera of their own. Without it, they seem to be taken from another height."
    )


def unit_contradicted(finding: UnitContradicted) -> str:
    """Control in feet that was taken for metres, or the other way round."""
    feet = finding.unit == "feet"
    what = "heights of the control" if finding.heights_only else "coordinates of the control"
    are = "in feet" if feet else "in metres that were taken for feet"
    return (
        f"The {what} are {are}: as given they miss the other sources by {finding.given_m:.1f} m in height, in that unit by "
        f"{finding.fits_m:.1f} m. The block is wrong until the file states its unit or is in metres: {_unit_remedy(finding)}."
    )


def _unit_remedy(finding: UnitContradicted) -> str:
    """The setting that states the unit, and where the control lies with it."""
    if not finding.heights_only:
        return "name the system in which it was surveyed, with the unit that it really has (control > crs)"
    code, unit = (6360, "US survey feet") if finding.unit == "feet" else (5703, "metres")
    given, there = finding.heights_m or (0.0, 0.0)
    heights = f"; its points then lie at {there:.1f} m instead of {given:.1f} m" if finding.heights_m else ""
    return f"write crs: {with_vertical(finding.crs, code)} below control (heights in {unit}){heights}"


def sources_disagree(finding: SourcesDisagree) -> str:
    """A contradiction for which no cause was found."""
    unit = finding.unit
    return (
        f"The sources contradict each other in the {finding.parameter} of the block: {finding.source} would change it by "
        f"{finding.value:+.2f} {unit} (standard error {finding.sigma:.2f}), all others by {finding.others:+.2f} {unit} (standard "
        f"error {finding.others_sigma:.2f}). No flight, height system, unit or camera constant explains it; compare them before "
        "the result is used."
    )


SOURCE_SENTENCES = (offset_adjusted, constant_of_its_own, unit_contradicted, sources_disagree)
