"""Findings about place, direction, scale and shape of a block: what holds it, and what is missing or looks wrong."""

import math
from collections.abc import Sequence
from typing import Literal, Self

from orthomill.schemas.findings.finding import SpokenFinding, two_digits

BASIS: dict[str, str] = {
    "attitude": "on the attitudes that came with the photographs",
    "down": "on the assumption that the photographs look straight down on average",
    "level": "on the assumption that the photographs were taken level and upright on average",
}
"""What the tilt about a line of known points rests on"""
OPEN_DEG = math.degrees(1.0)
"""A tilt with a larger standard error is called undetermined: linearised angles mean nothing there."""


class NoDatum(SpokenFinding):
    """A free network; `scaled`: measured distances give its scale, or positions an approximate one."""

    code: Literal["no_datum"] = "no_datum"
    scaled: bool
    scale_share: float | None = None
    """standard error of an approximate scale, in units of it; None: measured distances give it, or nothing does"""

    @property
    def sentence(self) -> str:
        exact = "a scale" if self.scale_share is None else f"an approximate scale (to {100 * self.scale_share:.0f} %)"
        what = (
            f"The block has {exact} but no datum: its coordinates are metres in a system of its own."
            if self.scaled
            else "The block has no datum: its files are in a local system of arbitrary scale, in units that are not metres."
        )
        return f"{what} Give positions or three control points."


class DatumGivenUp(SpokenFinding):
    """With positions and control the adjustment did not converge: they pull against the tie points, `worst` most of all."""

    code: Literal["datum_given_up"] = "datum_given_up"
    worst: tuple[str, ...]
    """names of control points and photographs, the largest misfit first"""

    @property
    def sentence(self) -> str:
        return (
            "With its positions and control the block could not be adjusted, because they pull against its tie points, most of all "
            f"{', '.join(self.worst)}: the block was adjusted without any of them. Compare their coordinates and measurements."
        )


class PositionsCrowded(SpokenFinding):
    """The positions lie closer together than their own standard errors."""

    code: Literal["positions_crowded"] = "positions_crowded"

    @property
    def sentence(self) -> str:
        return (
            "The positions of the photographs lie closer together than their own standard errors, so they determine neither place "
            "nor direction and take no part. Correct them, or state their true precision."
        )


class TiltUnobserved(SpokenFinding):
    """Positions and control lie nearly on one line, and an assumption determines the tilt about it, if any does."""

    code: Literal["tilt_unobserved"] = "tilt_unobserved"
    # None where it is infinite: Infinity is no JSON, and other programs that read the tables need not accept it.
    tilt_sigma_deg: float | None
    """standard error of the tilt from positions and control alone; None: they do not determine it"""
    basis: Literal["attitude", "down", "level"] | None
    """where the up direction comes from; None: what could be assumed of it, positions and control contradict"""
    sigma_deg: float
    """standard error of the tilt with the up direction"""

    @property
    def sentence(self) -> str:
        # Both numbers: a reader must see what the observations say, and what the assumption adds.
        alone = self.tilt_sigma_deg
        fixed = "do not determine" if alone is None or alone > OPEN_DEG else f"determine only to {alone:.1f} degrees"
        rests = (
            "and they show that the photographs look elsewhere than could be assumed, so that nothing else tells it"
            if self.basis is None
            else f"it rests {BASIS[self.basis]}, then good to {self.sigma_deg:.1f} degrees"
        )
        return (
            f"Positions and control lie so near to one line, for their standard errors, that they {fixed} the tilt about it; "
            f"{rests}. Measure control away from the line, or fly parallel strips farther apart."
        )

    @property
    def alike(self) -> str:
        return self.code

    @classmethod
    def of_many(cls, found: Sequence[Self]) -> str:
        # The group whose tilt is known worst stands for all: each is held by its own positions.
        worst = max(found, key=lambda finding: (finding.sigma_deg, finding.tilt_sigma_deg or float("inf")))
        return f"In {len(found)} groups of photographs, each with a datum of its own, at worst: {worst.sentence}"


class ControlOnALine(SpokenFinding):
    """The control points lie nearly on one line."""

    code: Literal["control_on_a_line"] = "control_on_a_line"

    @property
    def sentence(self) -> str:
        return "The control is one-sided: its points lie nearly on one line. Add control away from that line."


class DatumMisfit(SpokenFinding):
    """Positions and control do not fit the shape of the block."""

    code: Literal["datum_misfit"] = "datum_misfit"
    # A median: a single wrong position or point has a message of its own and must not look like a datum that does not fit.
    ratio: float
    """median misfit before the adjustment, in standard errors"""

    @property
    def sentence(self) -> str:
        return (
            f"The known positions and the shape of the block disagree: the median misfit before the adjustment is {self.ratio:.0f} "
            "standard errors. Positions, their standard errors or the CRS may be wrong."
        )


_STRAIGHTER = 0.5
"""Where a block bends by less than this share without its control, the control bends it"""


class BlockBent(SpokenFinding):
    """Heights bend over the block against its positions, or its photographs diverge from their attitudes."""

    code: Literal["block_bent"] = "block_bent"
    bend_m: float
    """from the middle of the block to its ends; negative: the ends are too low"""
    extent_m: float
    """of the photographs"""
    pixels: float
    """the bend in pixels on the ground"""
    scatter_m: float | None
    """of the positions about the bend; None: they show none"""
    views_deg: float | None
    """by which directions of view diverge from the attitudes over the block; None: they do not"""
    grave: bool
    """it is more than models of lenses leave"""
    sure: bool = True
    """it cannot be the receiver: attitudes show it, too, or positions scatter so little about it"""
    in_metres: bool = True
    """false: in the units of a block without a datum"""
    open_m: float | None = None
    """standard error of the bend by the photographs, where it is within three of these"""
    without_control_m: float | None = None
    """size of the bend of the same photographs without their control; None: there is none, or it was not tried"""

    @property
    def by_control(self) -> bool:
        """Whether it is the control that bends the block."""
        return self.without_control_m is not None and self.without_control_m < _STRAIGHTER * abs(self.bend_m)

    @property
    def sentence(self) -> str:
        how = []
        if self.scatter_m is not None:
            how.append(f"against the positions of its photographs, which scatter by only {two_digits(self.scatter_m)} m about that")
        if self.views_deg is not None:
            away = f"{abs(self.views_deg):.1f} degrees"
            how.append(f"against the attitudes of its photographs, from which the directions of view diverge by {away}")
        size, shape = f"{self.pixels:.0f} pixels on the ground", "dome" if self.bend_m < 0 else "bowl"
        if self.in_metres:
            size = f"{two_digits(abs(self.bend_m))} m over {self.extent_m:.0f} m ({size}, a {shape})"
        else:
            size = f"{size} (a {shape})"
        what = f"The block bends by {size} {', and '.join(how)}"
        if not self.grave:
            return f"{what}: about what a model of the lens leaves."
        if self.by_control:
            return (
                f"{what}: the control bends it, for without the control the same photographs bend by "
                f"{two_digits(self.without_control_m or 0.0)} m only. Compare coordinates and heights of the control, their unit, "
                "their standard errors and their marks; or go on without it (control: {kind: none})."
            )
        cause = (
            "not the receiver but the camera is wrong"
            if self.sure
            else "the camera is wrong, or heights of a barometer, which err where a drone brakes and turns"
        )
        if self.open_m is not None and self.scatter_m is not None:
            # Tried on a real flight: the residuals are the same, and a k1 that differs by 0.02 takes up the bend.
            cause += (
                f". The photographs leave it open (standard error {two_digits(self.open_m)} m) and would follow positions whose "
                "heights are stated to be as good to each other as they scatter "
                f"(positions > sigma_height: {two_digits(self.scatter_m)})"
            )
        return (
            f"{what}: {cause}. Give the camera's calibration or the standard errors of RTK positions, "
            "add strips across at another height or oblique photographs, or measure control in the middle and at the ends."
        )


class LooksUpward(SpokenFinding):
    """According to the control, the photographs look up from below the ground."""

    code: Literal["looks_upward"] = "looks_upward"

    @property
    def sentence(self) -> str:
        return (
            "By the control the photographs look upwards from below. Unless they show a ceiling, X and Y of the control are "
            "exchanged: compare its file."
        )


class AxesExchanged(SpokenFinding):
    """The control fits only with X and Y exchanged."""

    code: Literal["axes_exchanged"] = "axes_exchanged"
    # Geodetic systems often name the northing X and list it first. Both misfits are kept, to show how clear the case is.
    exchanged_m: float
    given_m: float
    """root mean square misfits"""

    @property
    def sentence(self) -> str:
        return (
            f"With X and Y of the control exchanged it fits the block to {self.exchanged_m:.2f} m, but as given only to "
            f"{self.given_m:.2f} m, and with photographs that look up from below the ground: it was not used. Exchange X and Y in "
            "the file."
        )


class PointsExchanged(SpokenFinding):
    """The control fits only with two of its points exchanged."""

    code: Literal["points_exchanged"] = "points_exchanged"
    first: str
    second: str
    exchanged_m: float
    given_m: float | None
    """root mean square misfits; None: as given the photographs would look up from below the ground"""

    @property
    def sentence(self) -> str:
        given = f"as given to {self.given_m:.2f} m" if self.given_m is not None else "as given it shows the ground from below"
        return (
            f"The control points {self.first} and {self.second} seem to be exchanged: with the coordinates of one at the other the "
            f"control fits the block to {self.exchanged_m:.2f} m, {given}. Neither was used; exchange their names or coordinates "
            "in the file."
        )


class GroupsUnconnected(SpokenFinding):
    """No tie points connect these groups of photographs; each has a datum of its own. The largest comes first."""

    code: Literal["groups_unconnected"] = "groups_unconnected"
    # The largest comes first, because it is the one that the others have to be connected to.
    groups: tuple[tuple[str, ...], ...]

    @property
    def sentence(self) -> str:
        # The largest group is the block itself and needs no names.
        others = "; ".join(", ".join(group) for group in self.groups[1:])
        return (
            f"The photographs form {len(self.groups)} groups which no reliable tie points connect; each is held by its own "
            f"positions and control only. Apart from the largest: {others}. Photographs between them would join them."
        )


class BlockSeparate(SpokenFinding):
    """Photographs that form a free block of their own."""

    code: Literal["block_separate"] = "block_separate"
    photos: tuple[str, ...]

    @property
    def sentence(self) -> str:
        return (
            f"{', '.join(self.photos)} form a separate group which neither tie points nor positions or control connect surely to "
            "the block; it is kept as a free block of its own and takes no part in later stages. Run its photographs as a project "
            "of their own, or give positions or control that place it."
        )
