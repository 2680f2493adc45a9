"""Every photograph and board that is not used in a calibration, as a code with its numbers, and the table of them."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

from orthomill.tasks.calibration.board_tables import ArrangedPhoto, PhotoSearch
from orthomill.tasks.calibration.diagnosis.calibration_results import CalibrationResults
from orthomill.tasks.calibration.solving.solving import CalibrationTarget


class LeftOutReason(StrEnum):
    """Why something in a photograph is not used. In braces: columns and rows of corners."""

    NO_BOARD = "no board with {0} x {1} inner corners was found, whole or cut"
    PHOTO_MISFIT = "its boards do not fit the places of the others"
    AMBIGUOUS = "only one board could be identified: these may be any"
    BOARD_MISFIT = "they do not fit the places of the others, or are more than was stated"
    SINGLE_BOARD = "only one board is visible, so that cut ones cannot be identified"
    UNNUMBERED = "too few of their sides are visible to say which corners they show"
    NOT_ALTERNATING = "their squares do not alternate: no boards"
    LARGER = "they have more corners than {0} x {1}"
    OTHER_SIZE = "{0} x {1} inner corners"
    HIDDEN = "cut by the frame or hidden: no corner was found where it must be"


@dataclass(frozen=True)
class LeftOut:
    """`count` boards or finds of a photograph that are not used, 0 for the photograph itself; `board`: the number of a known board,
    from 0; `corners`: columns and rows, for the reasons that state them."""

    photo: str
    reason: LeftOutReason
    count: int = 0
    board: int | None = None
    corners: tuple[int, int] = (0, 0)


def left_out(results: CalibrationResults) -> list[LeftOut]:
    """Everything that is not used: photo by photo, then the boards that the second search did not find."""
    # By name of the photograph: the adjustment numbers only those that take part.
    corners = results.result.corners
    used = {(results.photos[p], b) for p, b in zip(corners.photo.tolist(), corners.board.tolist(), strict=True)}
    predicted = {(own.photo, prediction.board) for own in results.arranged.photos for prediction in own.predictions}
    found = [
        one
        for search, own in zip(results.searches, results.arranged.photos, strict=True)
        for one in (*_of_photo(results, search, own), *_rejected(search, results.target))
    ]
    return found + [LeftOut(photo, LeftOutReason.HIDDEN, 1, board) for photo, board in sorted(predicted - used)]


def _of_photo(results: CalibrationResults, search: PhotoSearch, own: ArrangedPhoto) -> Iterator[LeftOut]:
    """Boards that were found in a photograph and are not used."""
    unnamed = sum(name < 0 for name in own.names)
    # One reason per photograph, the first that explains all the others.
    if not search.boards + search.cut:
        yield LeftOut(search.photo, LeftOutReason.NO_BOARD, corners=results.target.corners)
    elif own.photo not in results.photos:
        yield LeftOut(search.photo, LeftOutReason.PHOTO_MISFIT)
    elif unnamed:
        reason = LeftOutReason.BOARD_MISFIT if own.certain else LeftOutReason.AMBIGUOUS
        yield LeftOut(search.photo, reason, unnamed)
    elif not own.certain:
        yield LeftOut(search.photo, LeftOutReason.SINGLE_BOARD)
    if search.unnumbered:
        yield LeftOut(search.photo, LeftOutReason.UNNUMBERED, search.unnumbered)


def _rejected(search: PhotoSearch, target: CalibrationTarget) -> Iterator[LeftOut]:
    """Candidates that are no boards, or boards of another kind."""
    if search.false:
        yield LeftOut(search.photo, LeftOutReason.NOT_ALTERNATING, search.false)
    if search.larger:
        yield LeftOut(search.photo, LeftOutReason.LARGER, search.larger, corners=target.corners)
    for corners, times in Counter(search.other).items():
        yield LeftOut(search.photo, LeftOutReason.OTHER_SIZE, times, corners=corners)
