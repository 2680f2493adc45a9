"""Findings about sources of a block that contradict each other, with the cause where one explains it."""

from collections.abc import Sequence
from typing import Literal

from orthomill.schemas.findings.finding import SpokenFinding
from orthomill.schemas.maps.compound_systems import with_vertical

HEIGHT = 2
_LIKE = {
    "shift in height": "Heights in two systems look like that (above the ellipsoid, the sea, the place of take-off)",
    "scale": "A map of another scale (a web map, distances on the ground), another unit or camera constant looks like that",
}
"""What contradictions in a parameter are usually made of, where no single cause stands out"""
_KINDS = {
    "ellipsoidal": " (the tags say: above the ellipsoid)",
    "sea_level": " (the tags say: above the sea)",
    "barometric": " (the tags say: by the air pressure)",
    "relative": " (the tags say: above the place of take-off)",
}


class OffsetAdjusted(SpokenFinding):
    """Positions have a constant error against the other sources, which was adjusted as an unknown of its own."""

    code: Literal["offset_adjusted"] = "offset_adjusted"
    photos: tuple[str, ...]
    against: Literal["control", "others"]
    """all positions against the control, or those of these photographs against the other positions"""
    offset: tuple[float | None, float | None, float | None]
    """m in X, Y and height; None where there is none"""
    sigma: tuple[float | None, float | None, float | None]
    """against the other positions as these scatter, for what they have in common is no error of their difference"""
    tilt_deg: float
    """by which the block would be tilted without it"""
    moved_m: float
    """by which the block would lie elsewhere without it, at most"""
    heights: str | None = None
    """what tags say that the heights of the positions refer to"""
    zoom: float | None = None
    """by how many times another camera constant of these photographs would explain it, too; None: it would not"""
    stated: tuple[float, float, float] | None = None
    """standard errors that are stated of the positions, m"""

    @property
    def as_stated(self) -> bool:
        """Whether the positions are no farther apart than their stated standard errors let two flights be, so that nothing else has
        to explain the offset."""
        if self.against == "control" or self.zoom or self.stated is None:
            return False
        return all(value is None or abs(value) <= sigma for value, sigma in zip(self.offset, self.stated, strict=True))

    @property
    def sentence(self) -> str:
        heights_only = self.offset[0] is None and self.offset[1] is None
        own, size = "heights of the positions" if heights_only else "positions", _height(self) if heights_only else _vector(self)
        if self.against == "control":
            kind = _KINDS.get(self.heights or "", "")
            cause, compare = (", as heights in two systems do", "height system") if heights_only else ("", "reference system")
            return (
                f"The {own}{kind} lie {size} the control{cause}: they were adjusted with one offset, and both keep their standard "
                f"errors. State the {compare} of each in the workflow, or correct one of them."
            )
        zoomed = (
            f" {self.zoom:.3g} times the camera constant (zoom, a second camera) would put them there, too, but the photographs do "
            "not show it."
            if self.zoom
            else ""
        )
        told = f"The {own} of {photographs(self.photos)} lie {size} those of the others in the block"
        if self.as_stated:
            return (
                f"{told}, which is no more than what is stated of them: they were adjusted with an offset of their own, and the "
                "place of the block stays as uncertain as stated."
            )
        return (
            f"{told}: they were adjusted with an "
            f"offset of their own. Without it the block would be tilted by {self.tilt_deg:.1f} degrees and lie up to "
            f"{self.moved_m:.1f} m elsewhere.{zoomed} Which of them are right the block cannot say{_choice(self)}: compare the "
            "heights of the flights and the focal lengths (zoom, a second camera), or give control."
        )


class PositionsDrift(SpokenFinding):
    """The positions of a flight move evenly against the block, which follows them in part."""

    code: Literal["positions_drift"] = "positions_drift"
    photos: tuple[str, ...]
    """in the order of time"""
    hours: float
    drift: tuple[float | None, float | None, float | None]
    """m in X, Y and height from the first photograph to the last; None where nothing shows it"""
    sigma: tuple[float | None, float | None, float | None]

    @property
    def sentence(self) -> str:
        known = zip(("X", "Y", "height"), self.drift, self.sigma, strict=True)
        values = (
            f"{value:+.2f} m in {name} (standard error {sigma or 0.0:.2f} m)" for name, value, sigma in known if value is not None
        )
        return (
            f"The positions of {photographs(self.photos)} drift against the block, in {_duration(self.hours)} by "
            f"{', '.join(values)}: the receiver or its base did not hold its solution. The block follows a part of that, as a tilt "
            "or a bend. Process the positions again with the data of a base station, or give control at both ends of the flight."
        )


class ConstantOfItsOwn(SpokenFinding):
    """Photographs were taken with another camera constant than the others of their camera, and got a camera of their own; or only
    their positions say so (`used` false), and they kept it."""

    code: Literal["constant_of_its_own"] = "constant_of_its_own"
    photos: tuple[str, ...]
    camera: str
    """which all of them were thought to have"""
    c_px: float
    others_px: float
    """the camera constants of these photographs and of the others"""
    used: bool = True

    @property
    def sentence(self) -> str:
        factor = self.c_px / self.others_px
        if not self.used:
            return (
                f"By their positions {photographs(self.photos)} were taken with {factor:.3g} times the camera constant of the "
                f"other photographs of {self.camera} (zoom, another lens, a second camera of the model), but the photographs "
                "themselves do not show it clearly: they kept one camera, and the positions contradict it. Compare the focal "
                "lengths, or give these photographs a camera of their own (camera > serves)."
            )
        return (
            f"{photographs(self.photos)} were taken with {factor:.3g} times the camera constant of the other photographs of "
            f"{self.camera} ({self.c_px:.0f} and {self.others_px:.0f} px): zoom, another lens or a second camera of the model "
            "that no tag tells. They were given a camera of their own. Without it, they seem to be taken from another height."
        )


class UnitContradicted(SpokenFinding):
    """The control fits the other sources in another unit of length than metres."""

    code: Literal["unit_contradicted"] = "unit_contradicted"
    unit: Literal["feet", "metres"]
    """what its coordinates are in; `metres`: they were taken for feet"""
    heights_only: bool
    given_m: float
    """misfit in height as given"""
    fits_m: float
    """misfit in height in that unit"""
    crs: str = ""
    """the system in which the control was read"""
    heights_m: tuple[float, float] | None = None
    """median height of the control as given and in that unit"""

    @property
    def sentence(self) -> str:
        feet = self.unit == "feet"
        what = "heights of the control" if self.heights_only else "coordinates of the control"
        are = "in feet" if feet else "in metres that were taken for feet"
        return (
            f"The {what} are {are}: as given they miss the other sources by {self.given_m:.1f} m in height, in that unit by "
            f"{self.fits_m:.1f} m. The block is wrong until the file states its unit or is in metres: {_unit_remedy(self)}."
        )


class ScaleContradicted(SpokenFinding):
    """The plan of the control is that of a map of another scale than positions say."""

    code: Literal["scale_contradicted"] = "scale_contradicted"
    factor: float
    """how many times as large it is"""
    sigma: float
    map_factor: float | None = None
    """metres of the map in which the control was read to a metre on the ground; None: not known"""

    @property
    def sentence(self) -> str:
        # Distances on the ground are larger than those of a map whose scale is below 1.
        ground = self.map_factor is not None and abs(self.factor * self.map_factor - 1.0) < 3.0 * self.sigma
        like = (
            f"That is what distances on the ground are on this map (1 m is {self.map_factor:.5f} m on it): the control was "
            "surveyed in a local system, or was scaled to the ground"
            if ground
            else "A web map, distances on the ground, another projection or a calibrated site look like that"
        )
        return (
            f"In plan the control is {self.factor:.5f} times as large as positions say (standard error {self.sigma:.5f}): one of "
            f"them is in a map of another scale. {like}. Give both in one system (control > crs, positions > crs); the block was "
            "adjusted as if they were."
        )


class SourcesDisagree(SpokenFinding):
    """A source contradicts all others in a parameter of the block, and no cause explains it."""

    code: Literal["sources_disagree"] = "sources_disagree"
    source: str
    parameter: str
    unit: str
    value: float
    sigma: float
    others: float
    others_sigma: float

    @property
    def sentence(self) -> str:
        unit = self.unit
        return (
            f"The sources contradict each other in the {self.parameter} of the block: {self.source} would change it by "
            f"{self.value:+.2f} {unit} (standard error {self.sigma:.2f}), all others by {self.others:+.2f} {unit} (standard "
            f"error {self.others_sigma:.2f}). {_LIKE.get(self.parameter, 'No flight, height system, unit or zoom explains it')}; "
            "compare them before the result is used."
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


def _duration(hours: float) -> str:
    return f"{hours:.1f} h" if hours >= 1.0 else f"{60.0 * hours:.0f} min"


def _height(finding: OffsetAdjusted) -> str:
    value, sigma = finding.offset[HEIGHT] or 0.0, finding.sigma[HEIGHT] or 0.0
    return f"{abs(value):.2f} m (standard error {sigma:.2f} m) {'above' if value > 0 else 'below'}"


def _vector(finding: OffsetAdjusted) -> str:
    known = zip(("X", "Y", "height"), finding.offset, finding.sigma, strict=True)
    values = [
        f"{value:+.2f} m in {name} (standard error {sigma or 0.0:.2f} m)" for name, value, sigma in known if value is not None
    ]
    return f"{', '.join(values)} away from"


def _unit_remedy(finding: UnitContradicted) -> str:
    """The setting that states the unit, and where the control lies with it."""
    if not finding.heights_only:
        return "name the system in which it was surveyed, with the unit that it really has (control > crs)"
    code, unit = (6360, "US survey feet") if finding.unit == "feet" else (5703, "metres")
    given, there = finding.heights_m or (0.0, 0.0)
    heights = f"; its points then lie at {there:.1f} m instead of {given:.1f} m" if finding.heights_m else ""
    return f"write crs: {with_vertical(finding.crs, code)} below control (heights in {unit}){heights}"
