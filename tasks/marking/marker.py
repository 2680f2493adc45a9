"""Everything that the marking page asks: one value with the state of knowledge of a project, oriented or not."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orthomill.schemas.camera import Cameras
from orthomill.schemas.marks import ExpectedSight, MarkJudgement, MarkProposal, Marks, NextPoint
from orthomill.schemas.observations import GroundPoints, ImageResiduals, TiePoints
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.tasks.marking.automatic_marks import automatic_marks
from orthomill.tasks.marking.belief import Belief, block_belief, stored_belief, tag_belief
from orthomill.tasks.marking.expected_targets import TargetsOf, local_targets, target_proposals
from orthomill.tasks.marking.judging import judged, point_place, sights
from orthomill.tasks.marking.matched_places import SharedFeatures, shared_features, transferred
from orthomill.tasks.marking.next_points import next_points
from orthomill.tasks.marking.proposals import ReadGrey, proposals


@dataclass(frozen=True, eq=False)
class RunTables:
    """What a run has left so far: tables that do not exist yet are None."""

    photos: Photos
    cameras: Cameras
    block: Block | None = None
    tie_points: TiePoints | None = None
    residuals: ImageResiduals | None = None
    ground: GroundPoints | None = None


@dataclass(frozen=True, eq=False)
class Marker:
    """Judges marks and says where points should be seen."""

    tables: RunTables
    belief: Belief

    @property
    def oriented(self) -> bool:
        return self.belief.oriented

    def judged(self, marks: Marks) -> MarkJudgement:
        """All marks against the block and each other."""
        return judged(self.belief, marks)

    def sights(self, marks: Marks, point: str) -> tuple[ExpectedSight, ...]:
        """The photographs that should show a point and have no mark of it, the most useful first."""
        found = {sight.photo: sight for sight in sights(self.belief, marks, point)}
        if not self.oriented:
            found |= self._matched(marks, point, found)
        return tuple(sorted(found.values(), key=lambda sight: (sight.known != "matched", sight.gain[1])))

    def proposals(self, marks: Marks, name: str, read: ReadGrey) -> tuple[MarkProposal, ...]:
        """The marks of a point carried to the photographs that should show it; `read`: grey values of a window of a photograph."""
        point = next(one for one in marks.points if one.name == name)
        expected = tuple(sight for sight in self.sights(marks, name) if sight.photo in self.belief.number)
        place = point_place(self.belief, marks, name)
        if place is None:
            return ()
        found = {one.photo: one for one in proposals(self.belief, point, expected, place, read)} if point.marks else {}
        # A target has a centre of its own; where none is found, or several, patches decide.
        for one in target_proposals(point, expected, lambda sight: local_targets(read, sight, self._constant(sight.photo))):
            if not one.refused or one.photo not in found:
                found[one.photo] = one
        return tuple(found.values())

    def _constant(self, photo: str) -> float:
        """px: the camera constant of a photograph."""
        return self.belief.camera_of(self.belief.number[photo]).c

    def next_points(self, marks: Marks) -> tuple[NextPoint, ...]:
        """Where another control or check point would help most; empty before the photographs are oriented."""
        return next_points(self.belief, marks) if self.oriented else ()

    def automatic(self, marks: Marks, read: ReadGrey, targets_of: TargetsOf, told: Callable[[str], None]) -> Marks:
        """The marks with those that need nobody: coded targets by their names, targets and matches where points are expected, and
        targets that nobody listed as tie points. `targets_of`: all targets of a photograph; `told` is called
        with what is done next."""
        return automatic_marks(self, self.belief, marks, read, targets_of, told)

    @cached_property
    def _features(self) -> SharedFeatures | None:
        return None if self.tables.tie_points is None else shared_features(self.tables.tie_points)

    def _matched(self, marks: Marks, name: str, by_tags: dict[str, ExpectedSight]) -> dict[str, ExpectedSight]:
        """Places by the features that photographs share with one that has a mark, the best known of each photograph."""
        point = next(one for one in marks.points if one.name == name)
        found: dict[str, ExpectedSight] = {}
        if self._features is None:
            return found
        names = self.tables.photos.names
        for number, other in enumerate(names):
            for photo, mark in point.marks.items():
                if other in point.marks or photo not in names:
                    continue
                seen = transferred(self._features, names.index(photo), np.array([mark.col, mark.row]), number)
                if seen is None or (other in found and found[other].covariance[0, 0] <= seen[1][0, 0]):
                    continue
                (col, row), frame = map(float, seen[0]), self.tables.photos.photos[number]
                inside = min(col, row, frame.width - 1 - col, frame.height - 1 - row)
                gain = by_tags[other].gain if other in by_tags else (0.0, 0.0)
                if inside > -5.0:
                    found[other] = ExpectedSight(other, (col, row), seen[1], "matched", gain, inside)
        return found


def marker(tables: RunTables, ground: float | None = None) -> Marker:
    """The marker of a project, by the best that its run has left; `ground`: a height of the terrain, m, for photographs that are
    not oriented."""
    if tables.block is None:
        return Marker(tables, tag_belief(tables.photos, tables.cameras, ground))
    if tables.tie_points is None or tables.residuals is None or tables.ground is None or not len(tables.ground.track):
        return Marker(tables, stored_belief(tables.block, tables.cameras))
    return Marker(
        tables, block_belief(tables.block, tables.cameras, tables.photos, tables.tie_points, tables.residuals, tables.ground)
    )


def marker_of(
    photos: Photos,
    cameras: Cameras,
    heights: float | None = None,
    block: Block | None = None,
    tie_points: TiePoints | None = None,
    residuals: ImageResiduals | None = None,
    ground: GroundPoints | None = None,
) -> Marker:
    """As `marker`, by the tables of a run; `heights`: of the terrain, m."""
    return marker(RunTables(photos, cameras, block, tie_points, residuals, ground), heights)
