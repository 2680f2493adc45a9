"""The table of boards and photographs that were not used, with reasons."""

from orthomill.schemas.stage_report import Grid
from orthomill.tasks.calibration.diagnosis.calibration_results import CalibrationResults
from orthomill.tasks.calibration.diagnosis.left_out import LeftOut, LeftOutReason, left_out

_NOUNS = {
    LeftOutReason.NO_BOARD: "photograph",
    LeftOutReason.PHOTO_MISFIT: "photograph",
    LeftOutReason.SINGLE_BOARD: "other boards",
    LeftOutReason.UNNUMBERED: "cut board",
    LeftOutReason.NOT_ALTERNATING: "find",
}


def unused(results: CalibrationResults) -> tuple[Grid, ...]:
    """The table of what is not used; none when everything is."""
    rows = tuple((one.photo, what_is_left_out(one), one.reason.format(*one.corners)) for one in left_out(results))
    return (Grid(title="Not used", columns=("photo", "what", "reason"), rows=rows),) if rows else ()


def what_is_left_out(one: LeftOut) -> str:
    """The subject of a reason: a photograph, boards by their count, or a board by its number."""
    noun = _NOUNS.get(one.reason, "board")
    if one.board is not None:
        return f"{noun} {one.board + 1}"
    return f"{one.count} {noun}" + ("" if one.count == 1 else "s") if one.count else noun
