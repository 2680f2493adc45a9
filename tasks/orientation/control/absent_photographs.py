"""Measurements in photographs that the project does not have: skipped, and which points that leaves without enough others."""

from dataclasses import dataclass, field
from typing import Literal

from orthomill.schemas.errors import some_of
from orthomill.schemas.findings.control_findings import PhotographsAbsent
from orthomill.schemas.observations import ControlPoint

Rule = Literal["skip", "refuse"]
_RAYS = {"control": 1, "check": 1, "tie": 2}
"""measurements that a point of each role needs to be of any use"""


@dataclass
class Skipped:
    """(point, photograph) of the measurements that were skipped; with the rule "refuse" there are none."""

    rule: Rule = "skip"
    measurements: list[tuple[str, str]] = field(default_factory=list)

    def takes(self, point: str, photo: str) -> bool:
        """Whether a measurement in an absent photograph is skipped, and thus no mistake."""
        if self.rule == "skip":
            self.measurements.append((point, photo))
        return self.rule == "skip"

    def lost(self, points: dict[str, ControlPoint]) -> tuple[str, ...]:
        """The points that are of no use without their skipped measurements."""
        touched = dict.fromkeys(name for name, _ in self.measurements)
        return tuple(name for name in touched if len(points[name].measurements) < _RAYS[points[name].role])

    def mistake(self, points: dict[str, ControlPoint]) -> str | None:
        """The sentence where nothing is left: names that are written differently are no photographs that were dropped."""
        if not self.measurements or any(point.measurements for point in points.values()):
            return None
        return (
            f"None of the photographs that control points are measured in is in the project: {some_of(self._photos)}; correct the "
            "names, which are those of the files with or without their extension."
        )

    def finding(self, points: dict[str, ControlPoint]) -> PhotographsAbsent | None:
        """What was skipped; None when nothing was."""
        if not self.measurements:
            return None
        return PhotographsAbsent(measurements=len(self.measurements), photos=self._photos, lost=self.lost(points))

    @property
    def _photos(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(photo for _, photo in self.measurements))
