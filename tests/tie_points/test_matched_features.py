"""Which matched features tracks are made from: all of a small block, and of a large one each photograph's best share."""

import numpy as np
import pytest

from orthomill.tasks.tie_points.match_records import Features, MatchedFeatures, PairMatches
from orthomill.tasks.tie_points.matched_features import keep_matched, kept_matches
from orthomill.tasks.tie_points.search_settings import LEAST_SHARE
from orthomill.tasks.tie_points.tracks import build_tracks, tracks_of_kept

SIZE, COUNT, PHOTOS = (1600, 1200), 3000, 5
PAIRS = tuple((left, right) for left in range(PHOTOS) for right in range(left + 1, PHOTOS))


@pytest.fixture(scope="module")
def block() -> tuple[list[Features], list[PairMatches]]:
    """Five photographs with the same features in the same order; in every pair another four fifths of them are matched, but the
    first hundred in the first pair only."""
    rng = np.random.default_rng(2)
    one = np.ones(COUNT, np.float32)
    tables = [Features(rng.uniform(0, SIZE[0], COUNT), rng.uniform(0, SIZE[1], COUNT), one, one, one) for _ in range(PHOTOS)]
    found = []
    for pair in PAIRS:
        numbers = np.flatnonzero(rng.uniform(size=COUNT) < 0.8)
        numbers = numbers[(numbers >= 100) | (pair == PAIRS[0])].astype(np.int32)
        found.append(PairMatches(numbers, numbers))
    return tables, found


def kept_of(block, most: int):
    tables, found = block
    return keep_matched(iter(found), iter(found), iter(tables), PAIRS, (SIZE,) * PHOTOS, most)


def test_a_small_block_keeps_all_that_was_matched(block):
    tables, found = block
    counts, kept = kept_of(block, 10**6)
    assert counts.matches == sum(map(len, found)) and counts.features == len(kept)
    for photo in range(PHOTOS):
        own = [np.concatenate([match.left]) for match, pair in zip(found, PAIRS, strict=True) if photo in pair]
        assert np.array_equal(kept.number[kept.photo == photo], np.unique(np.concatenate(own)))
    all_of_them = build_tracks(iter(tables), tuple(found), PAIRS, (SIZE,) * PHOTOS)
    again = tracks_of_kept(iter(tables), iter(found), (), kept, PAIRS, (SIZE,) * PHOTOS)
    assert again["links"] == all_of_them["links"]


def test_of_a_large_block_every_photograph_keeps_its_share_all_over_its_frame(block):
    tables, found = block
    counts, kept = kept_of(block, 5000)
    assert np.array_equal(np.bincount(kept.photo), [1000] * PHOTOS) and counts.features == 5000
    for photo, table in enumerate(tables):
        own = kept.number[kept.photo == photo]
        assert (np.diff(own) > 0).all()
        parts = np.histogram2d(table.col[own], table.row[own], bins=8, range=((0, SIZE[0]), (0, SIZE[1])))[0]
        assert parts.min() >= 10 and parts.max() <= 20, "fifteen or sixteen where the frame has so many"
    assert counts.matches == sum(map(len, kept_matches(iter(found), PAIRS, kept)))
    times = np.bincount(np.concatenate([match.left for match in found]), minlength=COUNT)
    assert times[np.unique(kept.number)].mean() > times.mean(), "those that were matched most often stay"
    assert len(np.intersect1d(kept.number, np.arange(100))) < 40


def test_no_photograph_keeps_less_than_the_least_share(block):
    kept = kept_of(block, 10).kept
    assert np.array_equal(np.bincount(kept.photo), [LEAST_SHARE] * PHOTOS)


def test_matches_need_both_of_their_features():
    match = PairMatches(np.array([0, 1, 2], np.int32), np.array([5, 6, 7], np.int32))
    kept = MatchedFeatures(np.array([0, 0, 2, 2], np.int32), np.array([1, 2, 5, 6], np.int32))
    left, nothing = kept_matches(iter([match, match]), ((0, 2), (0, 1)), kept)
    assert left.left.tolist() == [1] and left.right.tolist() == [6] and not len(nothing)
