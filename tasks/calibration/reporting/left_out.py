"""Every photograph and board that takes no part in a calibration, with its reason."""

from collections import Counter
from collections.abc import Iterator

from orthomill.schemas.stage_report import Grid
from orthomill.tasks.calibration.board_tables import ArrangedPhoto, PhotoSearch
from orthomill.tasks.calibration.reporting.calibration_results import CalibrationResults
from orthomill.tasks.calibration.solving.solving import CalibrationTarget


def unused(account: CalibrationResults) -> tuple[Grid, ...]:
    """The table of what is not used; none when everything is."""
    used = {
        (account.photos[p], b)
        for p, b in zip(account.result.corners.photo.tolist(), account.result.corners.board.tolist(), strict=True)
    }
    predicted = {(own.photo, prediction.board) for own in account.arranged.photos for prediction in own.predictions}
    rows = [row for search, own in zip(account.searches, account.arranged.photos, strict=True)
            for row in (*_left_out(account, search, own), *_refused(search, account.target))]  # fmt: skip
    rows += [(photo, f"board {board + 1}", "cut by the frame or hidden: no corner was found where it must be")
             for photo, board in sorted(predicted - used)]  # fmt: skip
    if not rows:
        return ()
    return (Grid(title="Not used", columns=("photo", "what", "reason"), rows=tuple(rows)),)


def _left_out(account: CalibrationResults, search: PhotoSearch, own: ArrangedPhoto) -> Iterator[tuple[str, str, str]]:
    """What was found in a photograph and is not used."""
    strangers = sum(name < 0 for name in own.names)
    if not search.boards + search.cut:
        corners = "{} x {}".format(*account.target.corners)
        yield search.photo, "photograph", f"no board with {corners} inner corners was found, whole or cut"
    elif own.photo not in account.photos:
        yield search.photo, "photograph", "its boards do not fit the places of the others"
    elif strangers and not own.certain:
        yield search.photo, _number(strangers, "board"), "only one board could be told from the others: these may be any"
    elif strangers:
        yield search.photo, _number(strangers, "board"), "they do not fit the places of the others, or are more than was stated"
    elif not own.certain:
        yield search.photo, "other boards", "only one board is seen, so that cut ones cannot be told apart"
    if search.unnumbered:
        yield (
            search.photo,
            _number(search.unnumbered, "cut board"),
            "too few of their sides are seen to say which corners they show",
        )


def _refused(search: PhotoSearch, target: CalibrationTarget) -> Iterator[tuple[str, str, str]]:
    """What looked like a board and is none, or none of this kind."""
    if search.false:
        yield search.photo, _number(search.false, "find"), "their squares do not alternate: no boards"
    if search.larger:
        yield search.photo, _number(search.larger, "board"), "they have more corners than {} x {}".format(*target.corners)
    for (columns, rows), times in Counter(search.other).items():
        yield search.photo, _number(times, "board"), f"{columns} x {rows} inner corners"


def _number(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("" if count == 1 else "s")
