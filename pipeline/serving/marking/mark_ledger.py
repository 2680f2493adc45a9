"""The marks of a project as they are kept: every change is on the disk before it is answered.

A change names what its page saw before. Where that is no longer so, another page has changed it meanwhile: the change is refused,
and the page is told what stands there now. A change that has been made already is no mistake, so that a page may send it again
when it does not know whether it arrived.
"""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from threading import Lock
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from orthomill.pipeline.serving.marking.mark_tables import mark_files
from orthomill.pipeline.storage.whole_files import whole_file
from orthomill.schemas.errors import StoreError
from orthomill.schemas.marks import HiddenArea, Mark, MarkedPoint, Marks, PointRole
from orthomill.schemas.observations import Distance

LEDGER = "marks.json"


class _Change(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class PointFields(_Change):
    """A point without its marks."""

    name: str = Field(min_length=1, max_length=80, pattern=r"^[^,;\"\x00-\x1f]*[^,;\"\x00-\x20][^,;\"\x00-\x1f]*$")
    role: PointRole = "control"
    xyz: tuple[float, float, float] | None = None
    sigma: tuple[
        Annotated[float, Field(gt=0, le=1000)], Annotated[float, Field(gt=0, le=1000)], Annotated[float, Field(gt=0, le=1000)]
    ] = (0.03, 0.03, 0.05)


class MarkChange(_Change):
    """A mark set, moved or (`after` None) taken away."""

    kind: Literal["mark"]
    point: str
    photo: str
    before: Mark | None
    after: Mark | None


class PointChange(_Change):
    """A point made, edited, renamed or taken away; its marks stay with it."""

    kind: Literal["point"]
    before: PointFields | None
    after: PointFields | None


class DistanceChange(_Change):
    """A distance between two points made, edited or taken away."""

    kind: Literal["distance"]
    before: Distance | None
    after: Distance | None


class AreaChange(_Change):
    """A part of a photograph hidden or (`after` None) shown again."""

    kind: Literal["area"]
    before: HiddenArea | None
    after: HiddenArea | None

    @property
    def photo(self) -> str:
        """Whose area it is."""
        return next((area.photo for area in (self.after, self.before) if area), "")


Change = Annotated[MarkChange | PointChange | DistanceChange | AreaChange, Field(discriminator="kind")]
CHANGES: TypeAdapter[Change] = TypeAdapter(Change)


class OvertakenError(StoreError):
    """Another page has changed the same thing meanwhile."""


class MarkLedger:
    """The marks in `folder`, in the reference system `crs`; one process writes them. `sizes`: photographs and their (width,
    height). Raises StoreError for a ledger that cannot be read."""

    def __init__(self, folder: Path, crs: str, sizes: Mapping[str, tuple[int, int]]) -> None:
        self.folder, self.crs, self._sizes = folder, crs, sizes
        self._lock = Lock()
        self.marks = _read(folder / LEDGER)
        self.revision = 1

    @property
    def is_new(self) -> bool:
        """Whether nothing has been kept yet."""
        return not (self.folder / LEDGER).exists()

    def replace(self, marks: Marks) -> None:
        """Keep other marks instead."""
        with self._lock:
            self._keep(marks)

    def apply(self, change: Change) -> None:
        """Make a change and keep it. Raises OvertakenError where something else stands there than the page saw, StoreError for what
        cannot be."""
        with self._lock:
            changed = self._changed(change)
            if changed is not None:
                self._keep(changed)

    def _changed(self, change: Change) -> Marks | None:
        """The marks after a change; None where it has been made already."""
        if isinstance(change, MarkChange):
            return self._marked(change)
        if isinstance(change, AreaChange):
            return self._hidden(change)
        return self._pointed(change) if isinstance(change, PointChange) else self._measured(change)

    def _keep(self, marks: Marks) -> None:
        _write_through(self.folder / LEDGER, marks.model_dump_json(indent=1))
        self.marks = marks
        self.revision += 1
        # Derived files last: they are written again from the ledger whenever something changes.
        for name, text in mark_files(marks, self.crs).items():
            _write_through(self.folder / name, text)

    def _marked(self, change: MarkChange) -> Marks | None:
        point = next((one for one in self.marks.points if one.name == change.point), None)
        if point is None:
            raise OvertakenError(f"There is no point {change.point} any more: another page has taken it away or renamed it.")
        now = point.marks.get(change.photo)
        if now == change.after:
            return None
        if now != change.before:
            raise OvertakenError(f"{change.point} in {change.photo} was changed by another page meanwhile; its mark is shown now.")
        if change.after is not None:
            self._check(change.photo, change.after)
        marks = {photo: mark for photo, mark in point.marks.items() if photo != change.photo}
        if change.after is not None:
            marks[change.photo] = change.after
        return self._with_point(point.name, point.model_copy(update={"marks": dict(sorted(marks.items()))}))

    def _check(self, photo: str, mark: Mark) -> None:
        if photo not in self._sizes:
            raise StoreError(f"The project has no photograph {photo}.")
        width, height = self._sizes[photo]
        if not (-0.5 <= mark.col <= width - 0.5 and -0.5 <= mark.row <= height - 0.5):
            raise StoreError(f"({mark.col:.1f}, {mark.row:.1f}) is outside of {photo}, which has {width} x {height} px.")

    def _pointed(self, change: PointChange) -> Marks | None:
        before, after = change.before, change.after
        old = None if before is None else next((one for one in self.marks.points if one.name == before.name), None)
        there = None if after is None else next((one for one in self.marks.points if one.name == after.name), None)
        if (after is None and old is None) or (there is not None and _fields(there) == after):
            return None
        if (None if old is None else _fields(old)) != before:
            raise OvertakenError(f"The point {before.name if before else ''} was changed by another page meanwhile.")
        if after is None or old is None:
            if there is not None:
                raise StoreError(f"There is a point {there.name} already; give the new one another name.")
            made = None if after is None else MarkedPoint(**after.model_dump())
            return self._with_point(old.name if old else "", made)
        if there is not None and there is not old:
            raise StoreError(f"There is a point {there.name} already; give this one another name.")
        renamed = self._with_point(old.name, MarkedPoint(**after.model_dump(), marks=old.marks))
        names = {old.name: after.name}
        distances = tuple(
            one.model_copy(update={"first": names.get(one.first, one.first), "second": names.get(one.second, one.second)})
            for one in renamed.distances
        )
        return renamed.model_copy(update={"distances": distances})

    def _with_point(self, name: str, point: MarkedPoint | None) -> Marks:
        """The marks with a point in the place of another; at the end where it is new, without it for None."""
        here = [one.name for one in self.marks.points]
        if name not in here:
            return self.marks.model_copy(update={"points": (*self.marks.points, *((point,) if point else ()))})
        points = tuple(point if one.name == name else one for one in self.marks.points)
        left = tuple(one for one in points if one is not None)
        kept = {one.name for one in left} | ({name} if point else set())
        distances = tuple(one for one in self.marks.distances if {one.first, one.second} <= kept)
        return self.marks.model_copy(update={"points": left, "distances": distances})

    def _measured(self, change: DistanceChange) -> Marks | None:
        before, after, now = change.before, change.after, list(self.marks.distances)
        if after in now or (after is None and before not in now):
            return None
        if before is not None and before not in now:
            raise OvertakenError("The distance was changed by another page meanwhile.")
        if after is not None:
            names = {point.name for point in self.marks.points}
            if after.first == after.second or not {after.first, after.second} <= names or not (after.length > 0 < after.sigma):
                raise StoreError("A distance needs two different points, a positive length and a positive standard error.")
        kept = [one for one in now if one != before]
        return self.marks.model_copy(update={"distances": (*kept, *((after,) if after else ()))})

    def _hidden(self, change: AreaChange) -> Marks | None:
        now = self.marks.areas
        # An area that is gone already was shown again by another page, or by this one before its answer was lost.
        if change.after in now or (change.after is None and change.before not in now):
            return None
        if change.after is not None and change.after.photo not in self._sizes:
            raise StoreError(f"The project has no photograph {change.after.photo}.")
        kept = tuple(area for area in now if area != change.before)
        return self.marks.model_copy(update={"areas": (*kept, *((change.after,) if change.after else ()))})


def _fields(point: MarkedPoint) -> PointFields:
    return PointFields(name=point.name, role=point.role, xyz=point.xyz, sigma=point.sigma)


def _read(path: Path) -> Marks:
    if not path.exists():
        return Marks()
    try:
        return Marks.model_validate(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, ValidationError) as error:
        raise StoreError(f"{path} cannot be read as marks; restore it from a copy, or move it away to begin anew.") from error


def _write_through(path: Path, text: str) -> None:
    """Write a file whole, and wait until it is on the disk: a power cut after the answer must not lose a mark."""
    with whole_file(path) as stream:
        stream.write(text.encode())
        stream.flush()
        os.fsync(stream.fileno())
