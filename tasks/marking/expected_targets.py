"""Targets as proposals: in the photographs that should show a point, the one target that lies where it is expected."""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from orthomill.schemas.marks import ExpectedSight, FoundTarget, MarkedPoint, MarkProposal
from orthomill.schemas.raster import Window
from orthomill.tasks.marking.belief import Belief
from orthomill.tasks.marking.patch_matching import search_radius
from orthomill.tasks.marking.proposals import ReadGrey
from orthomill.tasks.marking.target_points import Detections, target_points
from orthomill.tasks.targets.photo_targets import photo_targets, stretched

TargetsOf = Callable[[str], tuple[FoundTarget, ...]]
"""the targets of a photograph"""
ROOM = 45
"""px about the search, for whole targets at its border"""
WITHIN = 3.5
"""Standard errors of the expected place within which a target is that of the point."""
CERTAIN = 0.5
"""Score of a target that is proposed; uncertain ones near it make it ambiguous all the same."""
# Set on a block with plates (20 photographs, the last of its four plates is creased) and two without any (a farm, 18; a castle,
# 10): plates have medians of 0.82 to 0.94 and of 0.041 to 0.098 px, in their best photographs 0.036 to 0.063 px; of what looks like
# one from all sides the median is 0.089 px or more, in the best photographs 0.067.
SURE, SURE_SIGMA = 0.8, 0.1
"""Median score and standard error (px) over all photographs from which targets that nobody expects are taken for some."""
BEST_SIGMA = 0.065
"""px: the second least of these standard errors. A crease or a shadow spoils some photographs of a plate, but not the best ones."""


def target_proposals(
    point: MarkedPoint, sights: Iterable[ExpectedSight], targets_at: Callable[[ExpectedSight], tuple[FoundTarget, ...]]
) -> tuple[MarkProposal, ...]:
    """The target that each of the `sights` shows where the point is expected; none where there is none, refused where there are
    several. Coded ones count by their name, which is that of the point; `targets_at`: the targets about an expected place."""
    out = []
    for sight in sights:
        near = [one for one in targets_at(sight) if _distance(one, sight) < WITHIN]
        own = [one for one in near if one.name == point.name]
        found = own or [one for one in near if not one.name and one.score > CERTAIN]
        if not found:
            continue
        best = max(found, key=lambda one: one.score)
        others = [one for one in near if one is not best and not own]
        refused = f"{len(others) + 1} targets lie where it is expected" if others else ""
        rival = max((one.score for one in others), default=0.0)
        out.append(MarkProposal(sight.photo, best.place, best.sigma, best.score, rival, refused, "target"))
    return tuple(out)


def local_targets(read: ReadGrey, sight: ExpectedSight, c: float) -> tuple[FoundTarget, ...]:
    """The targets about an expected place; `read`: grey values of a window of a photograph of the camera constant c px."""
    reach = search_radius(sight.covariance) + ROOM
    first = np.round(np.array(sight.place)).astype(int) - reach
    grey = read(sight.photo, Window(row=int(first[1]), col=int(first[0]), height=2 * reach + 1, width=2 * reach + 1))
    if not np.isfinite(grey).any():
        return ()
    found = photo_targets(stretched(grey), c)
    return tuple(replace(one, place=(one.place[0] + float(first[0]), one.place[1] + float(first[1]))) for one in found)


def _distance(target: FoundTarget, sight: ExpectedSight) -> float:
    away = np.array(target.place) - sight.place
    spread = sight.covariance + (target.sigma**2 + 1.0) * np.eye(2)
    return float(np.sqrt(away @ np.linalg.solve(spread, away)))


def coded_marks(photos: Iterable[str], targets_of: TargetsOf) -> dict[str, dict[str, FoundTarget]]:
    """Coded targets by their names: the photographs that show them."""
    found: dict[str, dict[str, FoundTarget]] = {}
    for photo in photos:
        for one in targets_of(photo):
            if one.name:
                found.setdefault(one.name, {})[photo] = one
    return found


def unexpected_targets(belief: Belief, targets_of: TargetsOf) -> list[dict[str, FoundTarget]]:
    """Uncoded targets that nobody has listed, each with the photographs that show it: those on which the photographs agree."""
    # Stones, spots and heads of trees are circles as well.
    own = {i: [one for one in targets_of(photo) if one.kind in ("chequered", "cross")] for i, photo in enumerate(belief.names)}
    found = {
        i: Detections(
            np.array([one.place for one in targets]).reshape(-1, 2),
            np.array([one.sigma for one in targets]),
            np.array([one.score for one in targets]),
        )
        for i, targets in own.items()
    }
    out = []
    for point in target_points(belief, found):
        shown = {belief.names[photo]: own[photo][row] for photo, row in point.rows.items()}
        sigma = np.sort([one.sigma for one in shown.values()])
        if point.score > SURE and np.median(sigma) < SURE_SIGMA and sigma[1] < BEST_SIGMA:
            out.append(shown)
    return out
