"""What the page of marks is told, and what it may change: the ledger, the judgement of the block, and the photographs."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from threading import Lock
from typing import Any, Protocol

import numpy as np

from orthomill.pipeline.serving.marking.field_files import GEOJSON, GPX, next_point_files, next_sentence
from orthomill.pipeline.serving.marking.mark_ledger import AreaChange, Change, MarkLedger
from orthomill.pipeline.serving.marking.mark_tables import left_out
from orthomill.pipeline.serving.marking.mask_images import MaskImages
from orthomill.pipeline.serving.marking.photograph_crops import PhotographCrops
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.errors import OrthomillError
from orthomill.schemas.marks import ExpectedSight, FoundTarget, MarkJudgement, MarkProposal, Marks, NextPoint
from orthomill.schemas.raster import Window

ReadGrey = Callable[[str, Window], np.ndarray]
TargetsOf = Callable[[str], tuple[FoundTarget, ...]]


class KnowsTheBlock(Protocol):
    """Whoever judges marks."""

    @property
    def oriented(self) -> bool:
        """Whether the photographs have orientations yet."""

    def judged(self, marks: Marks) -> MarkJudgement:
        """All marks against the block and each other."""

    def sights(self, marks: Marks, point: str) -> Sequence[ExpectedSight]:
        """The photographs that should show a point and have no mark of it."""

    def proposals(self, marks: Marks, name: str, read: ReadGrey) -> Sequence[MarkProposal]:
        """The marks of a point carried to the photographs that should show it."""

    def next_points(self, marks: Marks) -> Sequence[NextPoint]:
        """Where another control or check point would help most."""

    def automatic(self, marks: Marks, read: ReadGrey, targets_of: TargetsOf, told: Callable[[str], None]) -> Marks:
        """The marks with those that need nobody."""


class MarkingSession:
    """One project whose points are being marked, for all pages that look at it."""

    def __init__(self, project: str, ledger: MarkLedger, crops: PhotographCrops, block: KnowsTheBlock, masks: MaskImages) -> None:
        self.project, self.ledger, self.crops, self._block, self._masks = project, ledger, crops, block, masks
        # A process that ended between a change and its mask left the older one.
        masks.write(ledger.marks.areas)
        self._lock = Lock()
        self._judged: tuple[int, dict[str, Any]] = (0, {})

    def state(self, known: int = 0) -> dict[str, Any]:
        """Points, marks and their judgement; nothing but the revision for a page that `known`s it."""
        revision = self.ledger.revision
        if known == revision:
            return {"revision": revision}
        marks = self.ledger.marks
        return {
            "revision": revision,
            "points": [point.model_dump(mode="json") for point in marks.points],
            "distances": [one.model_dump(mode="json") for one in marks.distances],
            "left_out": [left_out(one, marks) for one in marks.distances],
            "areas": [one.model_dump(mode="json") for one in marks.areas],
            "judgement": self._judgement(revision, marks),
        }

    def photographs(self) -> dict[str, Any]:
        """What does not change while the page is open."""
        photos = [{"name": photo.name, "width": photo.width, "height": photo.height} for photo in self.crops.photos.values()]
        folders = {"folder": str(self.ledger.folder), "masks": self._masks.path}
        return {"project": self.project, "oriented": self._block.oriented, "photos": photos, **folders}

    def change(self, change: Change) -> dict[str, Any]:
        """Make a change; what everything is afterwards. Raises what `MarkLedger.apply` does."""
        self.ledger.apply(change)
        if isinstance(change, AreaChange) and change.photo:
            self._masks.write(self.ledger.marks.areas, change.photo)
        return self.state()

    def sights(self, point: str) -> list[dict[str, Any]]:
        """Where a point should be seen: photographs with the predicted place and its error ellipse."""
        marks = self.ledger.marks
        if point not in {one.name for one in marks.points}:
            return []
        return [_sight(one) for one in self._block.sights(marks, point)]

    def proposals(self, point: str) -> list[dict[str, Any]]:
        """Where matching and targets find a point in the photographs that should show it."""
        marks = self.ledger.marks
        if point not in {one.name for one in marks.points}:
            return []
        return [_proposal(one) for one in self._block.proposals(marks, point, self.crops.grey) if math.isfinite(one.place[0])]

    def mark_automatically(self, targets_of: TargetsOf, told: Callable[[str], None]) -> Marks:
        """Mark what needs nobody, and keep it; `targets_of`: the targets of a photograph, by its name; `told` is called with what
        is done next."""
        self.ledger.replace(self._block.automatic(self.ledger.marks, self.crops.grey, targets_of, told))
        return self.ledger.marks

    def next_points(self) -> list[str]:
        """Where to survey next, as sentences; kept beside the marks as GeoJSON and GPX where there are any."""
        found = self._block.next_points(self.ledger.marks)
        if not found:
            return [
                f"Where another point helps most is known once the block is oriented: orthomill run {self.project} --until "
                f"orientation"
            ]
        for name, text in next_point_files(found, self.ledger.crs).items():
            write_whole(self.ledger.folder / name, text.encode())
        kept = f"{self.ledger.folder / GEOJSON} and {GPX} have these places for the field."
        return [*map(next_sentence, found), kept]

    def _judgement(self, revision: int, marks: Marks) -> dict[str, Any]:
        # One after the other: all pages get the same answer, computed once.
        with self._lock:
            if self._judged[0] != revision:
                self._judged = revision, self._said(marks)
            return self._judged[1]

    def _said(self, marks: Marks) -> dict[str, Any]:
        try:
            found = self._block.judged(marks)
        except OrthomillError as error:
            return {"error": str(error)}
        return {
            "limit": round(found.limit * found.unit, 2),
            "unit": round(found.unit, 2),
            "marks": {f"{one.point}\t{one.photo}": [*_rounded(one.residual), _short(one.test)] for one in found.marks},
            "wrong": [asdict(one) | {"sentence": wrong_sentence(one)} for one in found.wrong],
            "points": {one.name: asdict(one) for one in found.points},
        }


def wrong_sentence(wrong: Any) -> str:
    """What is wrong, and what to do."""
    size = f"{wrong.test:.1f} standard errors"
    if wrong.photo is None:
        return (
            f"{wrong.point}: its marks agree with each other, but not with its coordinates ({size}): look for a wrong coordinate, "
            f"or for the name of another point."
        )
    off = f", {math.hypot(*wrong.off):.1f} px" if wrong.off else ""
    what = f"{wrong.point} in {wrong.photo} is off by {size}{off}"
    if wrong.others:
        return f"{what}; or its mark in {', '.join(wrong.others)} is: another mark of it would tell."
    if wrong.swapped:
        return f"{what}: it was exchanged with {wrong.instead}."
    return f"{what}: it lies on {wrong.instead}." if wrong.instead else f"{what}."


def _sight(sight: ExpectedSight) -> dict[str, Any]:
    long, short, angle = ellipse(sight.covariance)
    return {
        "photo": sight.photo,
        "col": round(sight.place[0], 2),
        "row": round(sight.place[1], 2),
        "ellipse": [round(long, 2), round(short, 2), round(angle, 1)],
        "known": sight.known,
        "before": sight.gain[0],
        "after": sight.gain[1],
        "inside": round(sight.inside, 1),
    }


def _proposal(one: MarkProposal) -> dict[str, Any]:
    return {
        "photo": one.photo,
        "col": round(one.place[0], 3),
        "row": round(one.place[1], 3),
        "sigma": round(one.sigma, 3) if math.isfinite(one.sigma) else None,
        "correlation": round(one.correlation, 3),
        "refused": one.refused,
        "by": one.by,
    }


def ellipse(covariance: np.ndarray) -> tuple[float, float, float]:
    """Semi-axes (px) of the standard error ellipse of (col, row), and the angle of the longer one from the column axis, clockwise
    on the screen, degrees."""
    values, axes = np.linalg.eigh(covariance)
    short, long = np.sqrt(np.maximum(values, 0.0))
    return float(long), float(short), float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))


def _rounded(pair: tuple[float, float]) -> list[float]:
    return [round(value, 3) for value in pair]


def _short(value: float | None) -> float | None:
    return None if value is None else round(value, 2)
