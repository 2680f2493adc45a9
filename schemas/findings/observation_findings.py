"""Findings about single observations that contradict a block: control points, positions, distances, measurements."""

import math
from collections.abc import Sequence
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict

from orthomill.schemas.errors import some_of
from orthomill.schemas.findings.finding import SpokenFinding, Vector

KILOMETRE = 1000.0


# Lists made on photographs of another size, or on the sensor's frame where EXIF turns the photograph, are wrong in all their lines.
class ControlUnmet(SpokenFinding):
    """The rays of most control points do not meet where the tie points put the photographs."""

    code: Literal["control_unmet"] = "control_unmet"
    points: int
    measured: int
    """control points that are measured in two oriented photographs or more, all of them"""
    turned: bool
    """whether EXIF turns a photograph"""

    @property
    def sentence(self) -> str:
        upright, turned = (" as EXIF turns them", "the frame before that, ") if self.turned else ("", "")
        return (
            f"The rays of {self.points} of the {self.measured} control points that are measured in two photographs or more do "
            f"not meet, and took no part. They were read as pixels of the photographs{upright}, and may be those of "
            f"{turned}another size or another photograph: compare one measurement with its photograph."
        )


class MarksInAnotherFrame(SpokenFinding):
    """The marks of control points are counted in another way than in the photographs, and were read so."""

    code: Literal["marks_in_another_frame"] = "marks_in_another_frame"
    counted: str
    """how, in words; empty where only their size is another"""
    change: str
    """what makes them marks of the photographs once they have their size, in words; or empty"""
    factor: float = 1.0
    """by which pixels of the list become those of the photographs"""
    given_px: float
    """standard error of a mark by how the rays of points miss each other, as the marks were read"""
    found_px: float
    """and counted so"""
    points: int

    @property
    def sentence(self) -> str:
        return (
            f"The marks of the {self.points} control points are counted {self._how()}: so the rays of a point meet to "
            f"{self.found_px:.2g} px, and as they were read at first to {self.given_px:.0f} px. They took part as counted so; "
            f"compare one with its photograph, and in the list of the marks {self._correction()}."
        )

    def _how(self) -> str:
        size = f"in copies reduced by {self.factor:.4g}" if self.factor > 1 else f"in pictures {1 / self.factor:.4g} times as large"
        return ", ".join(word for word in (self.counted, size if self._resized else "") if word)

    def _correction(self) -> str:
        size = f"multiply columns and rows by {self.factor:.4g}" if self._resized else ""
        return ", then ".join(word for word in (size, self.change) if word)

    @property
    def _resized(self) -> bool:
        return self.factor != 1.0


class ControlContradicted(SpokenFinding):
    """A control point was left out because it contradicts the block."""

    code: Literal["control_contradicted"] = "control_contradicted"
    point: str
    difference: Vector
    """block minus given, m"""
    # By component and not by length: standard errors in plan and height differ, so that the length would hide an error in plan.
    ratio: float
    """its largest component in predicted standard errors"""

    @property
    def sentence(self) -> str:
        return (
            f"The control point {self.point} contradicts the block {_misses(self.difference, self.ratio)}; it took no part. "
            "Compare its coordinates (name, CRS, height system) and its measurements in the photographs."
        )


class PositionContradicted(SpokenFinding):
    """The position of a photograph was left out because it contradicts the block."""

    code: Literal["position_contradicted"] = "position_contradicted"
    photo: str
    difference: Vector
    ratio: float

    @property
    def sentence(self) -> str:
        return (
            f"The position of {self.photo} contradicts the block {_misses(self.difference, self.ratio)}; it took no part. "
            "Correct it or leave it out."
        )

    @property
    def alike(self) -> str:
        return self.code

    @classmethod
    def of_many(cls, found: Sequence[Self]) -> str:
        worst = sorted(found, key=lambda finding: -finding.ratio)
        listed = some_of([f"{finding.photo} ({math.hypot(*finding.difference):.1f} m)" for finding in worst])
        return (
            f"The positions of {len(found)} photographs contradict the block and took no part, the worst first: {listed}. Correct "
            "them or leave them out."
        )


class PositionsElsewhere(SpokenFinding):
    """Many positions contradict the block at once."""

    code: Literal["positions_elsewhere"] = "positions_elsewhere"
    photos: int
    # Length of the median, not median of the lengths: random errors cancel, and the common displacement remains.
    distance_m: float
    """length of the median difference"""

    @property
    def sentence(self) -> str:
        away = self.distance_m
        length = f"{away / KILOMETRE:.1f} km" if away >= KILOMETRE else f"{away:.0f} m"
        return (
            f"The positions of {self.photos} photographs contradict the block: they lie {length} from where everything else puts "
            "these photographs, and took no part. They are of another place or in another CRS, or the control is; compare one "
            "photograph with a map."
        )


class PositionsAlongView(SpokenFinding):
    """Positions and control contradict each other along the viewing direction only."""

    code: Literal["positions_along_view"] = "positions_along_view"
    # Heights of another vertical datum and a wrong camera constant both displace positions along the view only.
    photos: int
    along_m: float

    @property
    def sentence(self) -> str:
        return (
            f"The positions of {self.photos} photographs contradict the control by {abs(self.along_m):.1f} m along the viewing "
            "direction and hardly across it, as heights in two systems do (above the ellipsoid and above the sea), or a wrong "
            "camera constant. The positions took no part; compare the systems, and the focal length."
        )


class DistanceContradicted(SpokenFinding):
    """A measured distance contradicts the block."""

    code: Literal["distance_contradicted"] = "distance_contradicted"
    first: str
    second: str
    length: float
    """m, on the map of the project where something tells its scale"""
    measured: float | None = None
    """m: on the ground, as the file states it; None where `length` is that"""
    difference: float
    """block minus given, m"""
    ratio: float
    """difference in predicted standard errors"""
    outcome: Literal["excluded", "undecided", "downweighted", "check"]
    """left out; kept, because nothing shows which observation is wrong; kept with a larger standard error; no part in any case"""

    @property
    def sentence(self) -> str:
        which = f"The distance from {self.first} to {self.second} ({self._lengths}) contradicts"
        off = f"block minus given: {self.difference:+.3f} m"
        if self.outcome == "downweighted":
            return (
                f"{which} the other distances ({off}), and too few of them show which is wrong; the scale of the block lies "
                "between them. Measure it again, or one more."
            )
        end = (
            "it took no part. Compare it with its two points"
            if self.outcome == "excluded"
            else "it took no part, as one to a check point. Compare it with its two points"
            if self.outcome == "check"
            else "too few others show which of them is wrong. Measure it again"
        )
        return f"{which} the block ({off}, {self.ratio:.0f} times the predicted standard error); {end}."

    @property
    def _lengths(self) -> str:
        """As the file states it, and on the map where that differs by a millimetre."""
        on_map = f"{self.length:.3f} m"
        measured = on_map if self.measured is None else f"{self.measured:.3f} m"
        return measured if measured == on_map else f"measured {measured}, on the map {on_map}"


# Without redundancy the residual of the only distance is zero whatever its error, so that no test can report a blunder.
class DistanceUnchecked(SpokenFinding):
    """One distance alone gives the scale."""

    code: Literal["distance_unchecked"] = "distance_unchecked"

    @property
    def sentence(self) -> str:
        return (
            "One distance alone gives the scale of the block, and nothing checks it: measure two more, so that a wrong one can be "
            "identified."
        )


class Misfit(BaseModel):
    """A measurement in a photograph that does not fit; `misfit_px`: how far it is off (None: by more than the frame is wide);
    `lies_on`: the control point on which it lies instead."""

    model_config = ConfigDict(frozen=True)

    photo: str
    misfit_px: float | None
    # Confusing two points is a frequent blunder of manual measurement; naming the other one tells the user where to correct it.
    lies_on: str | None = None


class MeasurementsRejected(SpokenFinding):
    """Individual image measurements of a surveyed point were rejected."""

    code: Literal["measurements_rejected"] = "measurements_rejected"
    role: Literal["control", "tie"]
    point: str
    measured: int
    rejected: tuple[Misfit, ...]

    @property
    def sentence(self) -> str:
        count = len(self.rejected)
        them = "it" if count == 1 else "them"
        # A measurement that lies on another point was made at the right place under a wrong name.
        named = sum(one.lies_on is not None for one in self.rejected)
        advice = f"Give {them} the right name" if named == count else f"Measure {them} again"
        if 0 < named < count:
            advice = "Give those on another point its name, and measure the others again"
        return (
            f"{count} of {self.measured} measurements of the {self.role} point {self.point} in photographs contradict the "
            f"others and took no part: {_places(self.rejected)}. {advice}."
        )


# A class of its own: check points take no part in the adjustment, so that nothing of them can be rejected there.
class CheckMeasurementsApart(SpokenFinding):
    """Individual image measurements of a check point disagree with the others, which agree with its coordinates."""

    code: Literal["check_measurements_apart"] = "check_measurements_apart"
    point: str
    measured: int
    apart: tuple[Misfit, ...]

    @property
    def sentence(self) -> str:
        return (
            f"{len(self.apart)} of {self.measured} measurements of the check point {self.point} in photographs do not meet "
            f"the others, which lie on its coordinates: {_places(self.apart)}. Measure again, or give the right name."
        )


def _misses(difference: Vector, ratio: float) -> str:
    there = ", ".join(f"{value:+.2f}" for value in difference)
    return f"(block minus given: {there} m in X, Y, Z; {ratio:.0f} times the predicted standard error)"


def _places(misfits: tuple[Misfit, ...]) -> str:
    return ", ".join(f"{one.photo} ({_off(one)}{f', where {one.lies_on} lies' if one.lies_on else ''})" for one in misfits)


def _off(misfit: Misfit) -> str:
    return "not where the block sees it" if misfit.misfit_px is None else f"{misfit.misfit_px:.0f} px off"
