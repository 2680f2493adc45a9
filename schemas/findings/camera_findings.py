"""Findings about the interior orientation of the cameras of a block, and about the errors of its image measurements."""

from collections.abc import Sequence
from typing import Literal, Self

from orthomill.schemas.camera import INTERIOR
from orthomill.schemas.errors import some_of
from orthomill.schemas.findings.finding import SpokenFinding, two_digits

MOSTLY_CAMERA = 0.5
"""From this share of their variance on, correlated image errors are attributed to the camera, below it to single photographs."""
HIDDEN = 2.0
"""Displacements so many times what the residuals show of them are told with that part."""
IN_PIXELS = ("c", "x0", "y0")
"""Parameters of a camera with the unit px; the others of this sentence are coordinates of a photograph."""


class DistortionFolds(SpokenFinding):
    """The radial distortion of a camera cannot be inverted in the corners of its frame."""

    code: Literal["distortion_folds"] = "distortion_folds"
    camera: str
    reach_px: float
    """largest radius at which the distortion can be inverted"""
    corner_px: float
    """radius of the farthest corner"""
    # k1 refers to radii in units of c, so that its size means nothing in pixels without c.
    k1: float
    c: float

    @property
    def sentence(self) -> str:
        return (
            f"The distortion of the camera {self.camera} cannot be undone farther than {self.reach_px:.0f} px from its principal "
            f"point, while a corner of the frame lies {self.corner_px:.0f} px away (k1 = {self.k1:.3g}, c = {self.c:.0f} px): "
            "tie points farther out take no part, and those near the limit are poor. Look for a camera constant or distortion of "
            "another camera or image size, or calibrate with points that reach the corners."
        )

    @property
    def alike(self) -> str:
        return self.code

    @classmethod
    def of_many(cls, found: Sequence[Self]) -> str:
        listed = some_of([f"{finding.camera} ({finding.reach_px:.0f} of {finding.corner_px:.0f} px)" for finding in found])
        return (
            f"The distortion of {len(found)} cameras cannot be undone as far as the corners of their frames: {listed}. Tie points "
            "farther out take no part, and those near the limit are poor. Look for camera constants or distortions of other "
            "cameras or image sizes, or calibrate with points that reach the corners."
        )


class InteriorUndetermined(SpokenFinding):
    """The geometry does not determine c, x0, y0 of a camera, which kept their values."""

    code: Literal["interior_undetermined"] = "interior_undetermined"
    camera: str
    # A share, because without control a relative error of c is the same relative error of all height differences.
    share: float | None
    """predicted standard error in units of c; None: the normal equations are singular"""

    @property
    def sentence(self) -> str:
        # A share above 100 % is printed as it is: it shows how far the block is from determining the value.
        how = "not at all" if self.share is None else f"only to {100 * self.share:.0f} %"
        return (
            f"Self-calibration: the block determines {', '.join(INTERIOR[:3])} of {self.camera} {how} (flat ground seen from "
            "above, points on a line or in one plane, or one position), so they kept their values. Give control at different "
            "heights, oblique photographs or photographs turned by 90 degrees, or a calibration."
        )

    @property
    def alike(self) -> str:
        return self.code

    @classmethod
    def of_many(cls, found: Sequence[Self]) -> str:
        shares = [f"{f.camera} ({'not at all' if f.share is None else f'only to {100 * f.share:.0f} %'})" for f in found]
        return (
            f"Self-calibration: the block does not determine c, x0, y0 of {len(found)} cameras, which kept their values (flat "
            f"ground seen from above, points on a line or in one plane, or one position): {some_of(shares)}. Give control at "
            "different heights, oblique photographs or photographs turned by 90 degrees, or a calibration."
        )


class InteriorFixed(SpokenFinding):
    """The adjustment failed with free interior orientations, which were all fixed."""

    code: Literal["interior_fixed"] = "interior_fixed"
    cameras: tuple[str, ...]

    @property
    def sentence(self) -> str:
        return (
            f"The interior orientation of {_cameras(self.cameras)} could not be adjusted: the block does not determine it. It was "
            "kept as it was given, so that heights may bend over the block; calibrate the camera, or add oblique photographs or "
            "control at different heights."
        )


class InteriorUnweighted(SpokenFinding):
    """Weighted interior orientations without standard errors, which therefore kept their values."""

    code: Literal["interior_unweighted"] = "interior_unweighted"
    cameras: tuple[str, ...]

    @property
    def sentence(self) -> str:
        return (
            f"The interior orientation of {_cameras(self.cameras)} was given without standard errors, so there is nothing to "
            "weight it with and it kept its values. Give its standard error (sigma_c) if the block shall improve it, or say that "
            "it is held (interior: {kind: fixed})."
        )


class ConstantContradicted(SpokenFinding):
    """The block contradicts the camera constant that was given."""

    code: Literal["constant_contradicted"] = "constant_contradicted"
    camera: str
    given_px: float
    adjusted_px: float
    sigma_px: float
    fixed: bool
    """the workflow fixes the interior orientation, so the given value was kept"""
    guessed: bool = False
    """nothing gave the value: no tag told a focal length"""

    @property
    def sentence(self) -> str:
        if self.guessed and not self.fixed:
            return (
                f"No tag tells the camera constant of {self.camera}: {self.given_px:.0f} px were guessed, "
                f"{self.adjusted_px:.0f} px (standard error {two_digits(self.sigma_px)} px) fit and were used. Give it, or "
                "calibrate the camera."
            )
        # With a fixed interior orientation the workflow decides, and the self only reports.
        end = "but the workflow fixes it" if self.fixed else "which was used"
        return (
            f"The block contradicts the camera constant of {self.camera}: {self.given_px:.0f} px were given, "
            f"{self.adjusted_px:.0f} px (standard error {two_digits(self.sigma_px)} px) fit, {end}. Look for a wrong focal length, "
            "zoom or photograph size, or calibrate the camera."
        )

    @property
    def alike(self) -> str:
        return f"{self.code} {self.guessed} {self.fixed}"

    @classmethod
    def of_many(cls, found: Sequence[Self]) -> str:
        listed = some_of([f"{finding.camera} ({finding.given_px:.0f} px, {finding.adjusted_px:.0f} px fit)" for finding in found])
        used = "but the workflow fixes them" if found[0].fixed else "which were used"
        if found[0].guessed and not found[0].fixed:
            return (
                f"No tag tells the camera constants of {len(found)} cameras, and other values than the guessed ones fit and were "
                f"used: {listed}. Give them, or calibrate the cameras."
            )
        return (
            f"The block contradicts the camera constants of {len(found)} cameras; others fit, {used}: {listed}. Look for wrong "
            "focal lengths, zoom or photograph sizes, or calibrate the cameras."
        )


class LensContradicted(SpokenFinding):
    """The block contradicts the radial distortion that was given and held."""

    code: Literal["lens_contradicted"] = "lens_contradicted"
    camera: str
    given: tuple[float, ...]
    fits: tuple[float, ...]
    """k1 and, where the lens has it, k2"""
    border_px: float
    """by which the other distortion moves the border of the frame, less a scale"""
    ratio: float
    """length of the change in standard errors"""

    @property
    def sentence(self) -> str:
        names = ("k1", "k2")[: len(self.fits)]
        given, fits = (
            ", ".join(f"{n} = {v:.3g}" for n, v in zip(names, values, strict=True)) for values in (self.given, self.fits)
        )
        return (
            f"The block contradicts the distortion of {self.camera}: {given} was given and held, about {fits} fits, which moves "
            f"the border of the frame by {self.border_px:.1f} px ({self.ratio:.0f} standard errors). Heights bend over the block. "
            "Look for the lens, focus, zoom or lens model of another calibration, or let the distortion take part (interior: "
            "{kind: free})."
        )


class ConstantNominal(SpokenFinding):
    """A nominal camera constant kept its value, and its uncertainty reached the heights."""

    code: Literal["constant_nominal"] = "constant_nominal"
    camera: str
    c: float
    share: float
    """its standard error in units of c"""
    guessed: bool = False
    """no tag told a focal length"""

    @property
    def sentence(self) -> str:
        what = "guessed, as no tag tells it" if self.guessed else "nominal, from EXIF"
        return (
            f"Without control the camera constant of {self.camera} ({what}, {self.c:.0f} px, within "
            f"{100 * self.share:.0f} %) cannot be separated from the flying height: heights are uncertain by the same share. "
            "Calibrate the camera, or give three control points."
        )

    @property
    def alike(self) -> str:
        return f"{self.code} {self.guessed}"

    @classmethod
    def of_many(cls, found: Sequence[Self]) -> str:
        least, most = (round(100 * share(finding.share for finding in found)) for share in (min, max))
        within = f"{most} %" if least == most else f"{least} to {most} %"
        what = "guessed, as no tag tells them" if found[0].guessed else "nominal, from EXIF"
        listed = some_of([f"{finding.camera} ({finding.c:.0f} px)" for finding in found])
        return (
            f"Without control the camera constants of {len(found)} cameras ({what}, within {within}) cannot be separated from the "
            "flying height: heights are uncertain by the same share. Calibrate the cameras, or give three control points. They "
            f"are {listed}."
        )


class InteriorDemanded(SpokenFinding):
    """The block demanded the principal point and k3 of a nominal camera, which are otherwise kept."""

    code: Literal["interior_demanded"] = "interior_demanded"
    camera: str
    x0_px: float
    y0_px: float
    k3: float
    sigma0_px: tuple[float, float]
    """without and with them"""

    @property
    def sentence(self) -> str:
        before, after = self.sigma0_px
        found = f"x0 = {self.x0_px:.1f} px, y0 = {self.y0_px:.1f} px and k3 = {self.k3:.3g}"
        return (
            f"The tags of {self.camera} leave its principal point and its outer distortion open, and its photographs fit together "
            f"only with {found} (sigma0 {before:.3f} px without, {after:.3f} px with them), which were adjusted: without them "
            "heights would bend over the block. A calibration of the camera saves that."
        )


class PrincipalPointMoved(SpokenFinding):
    """The principal point left its given place by many standard errors."""

    code: Literal["principal_point_moved"] = "principal_point_moved"
    camera: str
    moved_px: float

    @property
    def sentence(self) -> str:
        return (
            f"The principal point of {self.camera} moved {self.moved_px:.0f} px from its given place, many times its standard "
            "error: the block can hardly distinguish it from tangential distortion and the direction of the photographs, and "
            "systematic errors push it. Calibrate the camera, or fix x0 and y0 to compare."
        )

    @property
    def alike(self) -> str:
        return self.code

    @classmethod
    def of_many(cls, found: Sequence[Self]) -> str:
        listed = some_of([f"{finding.camera} ({finding.moved_px:.0f} px)" for finding in found])
        return (
            f"The principal points of {len(found)} cameras moved from their given places by many times their standard errors: "
            f"{listed}. The block can hardly distinguish them from tangential distortion and the direction of the photographs, and "
            "systematic errors push them. Calibrate the cameras, or fix x0 and y0 to compare."
        )


class ImageErrorsCorrelated(SpokenFinding):
    """The errors of neighbouring image measurements are correlated, which makes standard errors notably larger."""

    code: Literal["image_errors_correlated"] = "image_errors_correlated"
    rms_px: float
    """of a coordinate over the frame, what the unknowns absorb included: an estimate from the part that the residuals show"""
    shown_px: float | None = None
    """of a coordinate, the part that the residuals show"""
    camera_share: float
    """the part of the variance that all photographs of a camera have in common"""
    # The parameter that loses most, as an example: the loss differs between parameters, and one factor for all would mislead.
    parameter: str
    owner: str
    """camera or photograph whose `parameter` loses most precision"""
    sigma: float
    white_sigma: float
    """its standard error with the correlation, and under the assumption of white noise"""

    @property
    def sentence(self) -> str:
        whose = (
            "mostly alike in all photographs of a camera"
            if self.camera_share >= MOSTLY_CAMERA
            else "mostly different in each photograph"
        )
        # Residuals of a tenth of a pixel beside displacements of a whole one look like a mistake of the report.
        what = (
            f"whole regions of a photograph are displaced by {two_digits(self.rms_px)} px on average, {whose}"
            if self.shown_px is None or self.rms_px < HIDDEN * self.shown_px
            else f"residuals of whole regions of a photograph are alike by {two_digits(self.shown_px)} px, {whose}, and are what "
            f"is left of displacements by about {two_digits(self.rms_px)} px, most of which the orientation and the camera can "
            "absorb"
        )
        unit = " px" if self.parameter in IN_PIXELS else ""
        return (
            f"Correlated image errors: {what}. The standard errors include them: {self.parameter} of {self.owner} is known to "
            f"{two_digits(self.sigma)}{unit}, not to {two_digits(self.white_sigma)}{unit}. Calibrate the camera, or turn some "
            "photographs by 90 degrees."
        )


def _cameras(names: tuple[str, ...]) -> str:
    return " and ".join(names) if len(names) < 3 else f"{len(names)} cameras ({some_of(names)})"
