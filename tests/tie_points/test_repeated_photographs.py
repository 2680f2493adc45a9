"""Which of several photographs from one place takes part."""

from orthomill.tasks.tie_points.match_records import PairSummary
from orthomill.tasks.tie_points.repeated_photographs import repeated_photographs


def summaries(pairs, alike, inliers=()):
    return [
        PairSummary(left=str(i), right=str(j), tentative=50, inliers=dict(inliers).get((i, j), 0), alike=(i, j) in alike)
        for i, j in pairs
    ]


PAIRS = [(i, j) for i in range(5) for j in range(i + 1, 5)]


def test_without_repeated_pictures_all_take_part():
    assert repeated_photographs(PAIRS, summaries(PAIRS, set()), 5) == {}
    assert repeated_photographs([], [], 5) == {}


def test_the_first_of_copies_stays():
    assert repeated_photographs(PAIRS, summaries(PAIRS, {(1, 2), (1, 4)}), 5) == {1: (2, 4)}


def test_the_one_that_others_match_best_stays():
    found = summaries(PAIRS, {(1, 2), (2, 4)}, {(0, 1): 20, (2, 3): 15, (0, 2): 15}.items())
    assert repeated_photographs(PAIRS, found, 5) == {2: (1, 4)}


def test_matches_among_copies_tie_them_to_nothing():
    found = summaries(PAIRS, {(0, 1), (1, 2)}, {(0, 2): 200, (1, 3): 20}.items())
    assert repeated_photographs(PAIRS, found, 5) == {1: (0, 2)}


def test_every_place_has_its_own():
    assert repeated_photographs(PAIRS, summaries(PAIRS, {(0, 3), (1, 4)}), 5) == {0: (3,), 1: (4,)}
