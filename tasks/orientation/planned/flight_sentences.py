"""What is to be expected of a planned block, in sentences: how it was flown, whether it can bend and what stops that, how
precise it will be."""

import numpy as np

from orthomill.schemas.camera import Cameras
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.findings.flight_findings import ExpectedFlight
from orthomill.schemas.photo import Photos
from orthomill.tasks.orientation.planned.expected_precision import ExpectedPrecision, expected_precision
from orthomill.tasks.orientation.planned.flight_pattern import FlightPattern, flight_pattern
from orthomill.tasks.orientation.planned.object_views import UNKNOWN_VIEWS, views_of_object
from orthomill.tasks.orientation.planned.planned_block import HeightSource, PlannedBlock, planned_block, tell_apart
from orthomill.tasks.orientation.planned.planned_network import PlannedMeasures, planned_network
from orthomill.tasks.orientation.planned.remedies import WORTH, Remedy, best_remedy, with_control

MOST = 60
"""Photographs of the part of a larger block whose adjustment is simulated, in a second or two."""
HOLDS = 2.0
"""Pixels on the ground: a block whose bend has a smaller standard error is said to hold its shape."""
LEVEL = 0.02
"""Scatter of flying heights, in units of the height, below which all strips have one height."""
LEVEL_VIEW = 60.0
"""degrees off the vertical from which on photographs show no ground that could be taken for flat"""
PARALLEL = np.radians(10.0)
"""Spread of views below which they are parallel."""
_KINDS = {
    "strip": "one strip",
    "corridor": "a corridor",
    "grid": "a grid",
    "cross": "a cross flight",
    "circle": "a circle",
    "free": "free-hand, without strips",
}
_HEIGHTS: dict[HeightSource, str] = {
    "relative": "by the heights above the place of take-off",
    "views": "where the views meet",
    "overlap": "guessed from an overlap of 75 % along the flight, for the tags do not tell it",
}


def expected_flight(photos: Photos, cameras: Cameras, control: np.ndarray | None = None) -> ExpectedFlight:
    """What the photographs let expect, before any is matched; `control` (n, 3) points in the project's system, where there are."""
    block = planned_block(photos, cameras)
    if block is None:
        return ExpectedFlight(pattern=_placeless(photos))
    if _off_vertical(block) > LEVEL_VIEW:
        return ExpectedFlight(pattern=_of_walls(block))
    pattern = _pattern(block, flight_pattern(block))
    part = _middle_part(block)
    measures = with_control(block, control)
    try:
        before = expected_precision(planned_network(part, measures))
    except GeometryError:
        return ExpectedFlight(pattern=pattern, accuracy="Expected accuracy: unknown; the photographs hardly overlap.")
    remedy = best_remedy(part, before, measures)
    return ExpectedFlight(pattern=pattern, bend=_bend(part, before, measures, remedy), accuracy=_accuracy(block, part, before))


def _placeless(photos: Photos) -> str | None:
    """Why nothing is said of the flight."""
    placed = [photo for photo in photos.photos if photo.position and photo.position_sigma]
    if not placed:
        return f"Flight: unknown without positions; pattern, overlap and accuracy cannot be foreseen. {UNKNOWN_VIEWS}"
    guessed = all(photo.relative_height is None for photo in placed)
    if guessed and len({photo.position for photo in placed}) > 1 and not tell_apart(placed):
        return (
            "Flight: the positions lie closer together than their standard errors tell apart, so that pattern, overlap and "
            f"accuracy cannot be foreseen, and the block may get neither place nor scale from them. {UNKNOWN_VIEWS}"
        )
    return "Flight: all positions are one place, so that pattern, overlap and accuracy cannot be foreseen."


def _of_walls(block: PlannedBlock) -> str:
    told = (
        f"The photographs look {_off_vertical(block):.0f} degrees off the vertical, at walls and not at the ground: what their "
        "block lets expect is not foreseen."
    )
    return " ".join(filter(None, (told, views_of_object(block.centre, block.axes))))


def _middle_part(block: PlannedBlock) -> PlannedBlock:
    """The photographs nearest to the middle, in order, where there are more than can be simulated in a second."""
    away = np.linalg.norm(block.centre[:, :2] - np.median(block.centre[:, :2], axis=0), axis=1)
    return block if len(away) <= MOST else block.take(np.sort(np.argsort(away, kind="stable")[:MOST]))


def _pattern(block: PlannedBlock, pattern: FlightPattern) -> str:
    strips = f" of {pattern.strips} strips" if pattern.strips > 1 else ""
    overlaps = [f"{100 * share:.0f} % {words}" for share, words in ((pattern.forward, "along"), (pattern.side, "across")) if share]
    overlap = f", overlap {' and '.join(overlaps)} on flat ground" if overlaps else ""
    look = "looking straight down" if _off_vertical(block) < 5 else f"looking {_off_vertical(block):.0f} degrees off the vertical"
    if not block.looks.any():
        look = "taken to look straight down"
    around = None
    if pattern.kind == "circle":
        # Without attitudes a circle says no more than that something is inside.
        around = views_of_object(block.centre, block.axes) if block.looks.any() else UNKNOWN_VIEWS
    told = (
        f"Flight: {_KINDS[pattern.kind]}{strips}, {look}, about {block.height:.0f} m above the ground "
        f"({_HEIGHTS[block.height_from]}){overlap}; a pixel is {_length(block.pixel)} on the ground."
    )
    return f"{told} {around}" if around else told


def _off_vertical(block: PlannedBlock) -> float:
    """degrees, of most photographs: single ones were taken before the take-off"""
    return float(np.degrees(np.median(np.arccos(np.clip(-block.axes[:, 2], -1.0, 1.0)))))


def _bend(block: PlannedBlock, before: ExpectedPrecision, measures: PlannedMeasures, remedy: Remedy | None) -> str:
    size = f"{_length(before.bend)} over {before.extent:.0f} m"
    if before.bend < HOLDS * block.pixel:
        return f"The ground keeps its shape: it may come out bent by {size} (standard error)." + _advice(before, remedy)
    why = f", for {', '.join(found)}" if (found := _weaknesses(block, measures)) else ""
    return f"The ground may come out bent, as a dome or a bowl, by {size} (standard error){why}." + _advice(before, remedy)


def _weaknesses(block: PlannedBlock, measures: PlannedMeasures) -> list[str]:
    """Why it can bend."""
    return [
        words
        for words, true in (
            ("its views are parallel", block.spread < PARALLEL),
            ("all are from one height", np.std(block.centre[:, 2]) < LEVEL * block.height),
            ("the camera is known from tags only", any(camera.source == "exif" for camera in block.cameras)),
            ("positions have no corrections", bool(block.common.any())),
            ("there is no control", not len(measures.control)),
        )
        if true
    ]


def _advice(before: ExpectedPrecision, remedy: Remedy | None) -> str:
    if remedy is None:
        return ""
    pairs = {"heights": (before.height, remedy.expected.height), "the bend": (before.bend, remedy.expected.bend)}
    # Of what hardly changes nothing is promised.
    changes = [f"{what} from {_length(a)} to {_length(b)}" for what, (a, b) in pairs.items() if b < WORTH * a]
    return f" What helps: {remedy.words} {' and '.join(changes)}." if changes else ""


def _accuracy(whole: PlannedBlock, part: PlannedBlock, expected: ExpectedPrecision) -> str:
    of = "" if len(part.centre) == len(whole.centre) else f", by the {len(part.centre)} photographs in the middle"
    shared = ", most of it common to the whole flight" if part.common.any() else ""
    return (
        f"Expected standard errors on the ground: {_length(expected.plan)} in plan, {_length(expected.height)} in height"
        f"{shared}; by a simulated adjustment{of}."
    )


def _length(metres: float) -> str:
    """A length with two digits, in m or mm."""
    return f"{float(f'{metres:.2g}'):g} m" if metres >= 0.0995 else f"{float(f'{1000 * metres:.2g}'):g} mm"
