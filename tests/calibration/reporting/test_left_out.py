"""Everything that a calibration does not use is listed with its reason."""

from types import SimpleNamespace

import numpy as np
import pytest

from orthomill.tasks.calibration.board_tables import Arranged, ArrangedPhoto, PhotoSearch, Prediction
from orthomill.tasks.calibration.diagnosis.left_out import LeftOut, LeftOutReason, left_out
from orthomill.tasks.calibration.report.left_out_words import unused, what_is_left_out


def results(search: dict, photo: dict, used: tuple[int, ...] | None = (0,), predicted: tuple[int, ...] = ()):
    """The results of one photograph `a` with the boards `used`; None: the photograph is not used."""
    predictions = tuple(Prediction(board=board, pixels=((1.0, 1.0),)) for board in predicted)
    own = ArrangedPhoto(**{"photo": "a", "names": (0,), "certain": True, "predictions": predictions, **photo})
    found = PhotoSearch(**{"photo": "a", "boards": 1, "blur": 1.0, "overexposed": 0.0, **search})
    boards = np.array(used or (), dtype=int)
    return SimpleNamespace(
        target=SimpleNamespace(corners=(9, 6)),
        photos=[] if used is None else ["a"],
        searches=(found,),
        arranged=Arranged(boards=3, photos=(own,)),
        result=SimpleNamespace(corners=SimpleNamespace(photo=np.zeros(len(boards), dtype=int), board=boards)),
    )


def test_nothing_is_listed_when_everything_is_used():
    assert left_out(results({}, {})) == [] and unused(results({}, {})) == ()


@pytest.mark.parametrize(
    ("search", "photo", "used", "reason", "what", "words"),
    [
        ({"boards": 0}, {"names": ()}, None, LeftOutReason.NO_BOARD, "photograph", "no board with 9 x 6 inner corners"),
        ({}, {"names": (-1,)}, None, LeftOutReason.PHOTO_MISFIT, "photograph", "do not fit the places of the others"),
        ({}, {"names": (0, -1), "certain": False}, (0,), LeftOutReason.AMBIGUOUS, "1 board", "these may be any"),
        ({}, {"names": (0, 1, -1, -1)}, (0, 1), LeftOutReason.BOARD_MISFIT, "2 boards", "more than was stated"),
        ({}, {"certain": False}, (0,), LeftOutReason.SINGLE_BOARD, "other boards", "only one board is visible"),
        ({"unnumbered": 2}, {}, (0,), LeftOutReason.UNNUMBERED, "2 cut boards", "too few of their sides"),
        ({"false": 1}, {}, (0,), LeftOutReason.NOT_ALTERNATING, "1 find", "do not alternate"),
        ({"larger": 3}, {}, (0,), LeftOutReason.LARGER, "3 boards", "more corners than 9 x 6"),
        ({"other": ((7, 4), (7, 4))}, {}, (0,), LeftOutReason.OTHER_SIZE, "2 boards", "7 x 4 inner corners"),
    ],
)
def test_every_reason_is_found_and_worded(search, photo, used, reason, what, words):
    found = left_out(results(search, photo, used))
    assert [one.reason for one in found] == [reason]
    (grid,) = unused(results(search, photo, used))
    (row,) = grid.rows
    assert row[:2] == ("a", what) and words in row[2] and "{" not in row[2]


def test_a_predicted_board_without_a_corner_is_listed_by_its_number():
    found = left_out(results({}, {}, (0, 1), predicted=(1, 2)))
    assert found == [LeftOut("a", LeftOutReason.HIDDEN, 1, 2)]
    assert what_is_left_out(found[0]) == "board 3"


def test_several_reasons_of_one_photograph_are_listed_together():
    found = left_out(results({"unnumbered": 1, "false": 2, "larger": 1}, {"names": (0, -1)}))
    assert [(one.reason, one.count) for one in found] == [
        (LeftOutReason.BOARD_MISFIT, 1),
        (LeftOutReason.UNNUMBERED, 1),
        (LeftOutReason.NOT_ALTERNATING, 2),
        (LeftOutReason.LARGER, 1),
    ]
