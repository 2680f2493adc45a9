"""Tracks against plain union-find, patches against plain slices, and the order in which both are stored."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.tie_points.match_records import Features, Observations, PairMatches, Values
from orthomill.tasks.tie_points.patches import Strip, chosen_patches, nearest_pixels, strip_patches
from orthomill.tasks.tie_points.tracks import build_tracks, observation_key

PAIRS = ((0, 1), (0, 2), (1, 2))
COUNT = 12


def features(seed: int) -> tuple[Features, ...]:
    """Three photographs with COUNT distinct places each."""
    rng = np.random.default_rng(seed)
    one = np.ones(COUNT, np.float32)
    return tuple(Features(*rng.permutation(1000)[: 2 * COUNT].reshape(2, -1).astype(float), one, 0 * one, one) for _ in range(3))


def components(links: list[tuple[tuple[int, int], tuple[int, int]]]) -> list[set[tuple[int, int]]]:
    """Connected components of (photo, feature) nodes, by merging sets."""
    found: list[set[tuple[int, int]]] = []
    for left, right in links:
        joined = [one for one in found if left in one or right in one]
        found = [one for one in found if one not in joined] + [set().union({left, right}, *joined)]
    return found


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.sampled_from(range(3)), st.integers(0, COUNT - 1), st.integers(0, COUNT - 1)), min_size=1, max_size=25),
    st.integers(0, 99),
)
def test_tracks_are_the_components_that_meet_every_photograph_once(drawn, seed):
    tables = features(seed)
    by_pair = [sorted({(i, j) for pair, i, j in drawn if pair == number}) for number in range(3)]
    matches = tuple(PairMatches(*np.array(own, np.int32).reshape(-1, 2).T) for own in by_pair)
    links = [((PAIRS[n][0], i), (PAIRS[n][1], j)) for n, own in enumerate(by_pair) for i, j in own]
    merged = components(links)
    good = {frozenset(one) for one in merged if len({photo for photo, _ in one}) == len(one)}
    if not good:
        with pytest.raises(GeometryError, match=f"All {len(merged)} tracks of tie points are contradictory"):
            build_tracks(iter(tables), matches, PAIRS, ((1000, 1000),) * 3)
        return
    found = build_tracks(iter(tables), matches, PAIRS, ((1000, 1000),) * 3)
    tracks: dict[int, set[tuple[int, int]]] = {}
    for photo in range(3):
        own = found[observation_key(photo)]
        assert isinstance(own, Observations) and np.all(np.diff(own.track) > 0)
        for track, col in zip(own.track, own.col, strict=True):
            tracks.setdefault(int(track), set()).add((photo, int(np.flatnonzero(tables[photo].col == col)[0])))
    assert {frozenset(one) for one in tracks.values()} == good
    assert found["links"].tracks == len(good) and found["links"].conflicts == len(merged) - len(good)


def test_the_reference_is_the_photograph_with_the_most_central_point():
    one = np.ones(1, np.float32)
    tables = tuple(Features(np.array([col]), np.array([300.0]), one, 0 * one, one) for col in (100.0, 390.0, 700.0))
    same = PairMatches(np.zeros(1, np.int32), np.zeros(1, np.int32))
    found = build_tracks(iter(tables), (same,) * 3, PAIRS, ((800, 600),) * 3)
    assert {int(found[observation_key(number)].reference[0]) for number in range(3)} == {1}
    assert found["links"].pairs == ((0, 1), (1, 2))


SHAPE, HALF = (70, 90), 4


def observed(col, row) -> Observations:
    col, row = np.asarray(col, float), np.asarray(row, float)
    one = np.ones(len(col), np.float32)
    return Observations(np.arange(len(col), dtype=np.int32), np.zeros(len(col), np.int32), col, row, one, one)


def by_strips(pixels: np.ndarray, own: Observations, tile: int) -> np.ndarray:
    """The patches of all observations, asked for in two parts and in another order."""
    strips = [Strip(0, SHAPE, row, min(tile, SHAPE[0] - row), HALF) for row in range(0, SHAPE[0], tile)]
    values = tuple(strip_patches(pixels[strip.window.slices], pixels[::4, ::4], own, strip) for strip in strips)
    rows = np.random.default_rng(1).permutation(len(own))
    found = np.empty((len(own), 2 * HALF + 1, 2 * HALF + 1), np.uint8)
    for part in np.array_split(rows, 2):
        found[part] = chosen_patches(values, own, part, 0, tile, HALF)
    return found


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.floats(0, 89), st.floats(0, 69)), min_size=1, max_size=20), st.sampled_from([16, 33, 70]))
def test_patches_are_the_pixels_around_every_observation(places, tile):
    pixels = np.random.default_rng(2).integers(1, 256, (*SHAPE, 1), dtype=np.uint8)
    own = observed(*zip(*places, strict=True))
    padded = np.pad(pixels[:, :, 0], HALF)
    found = by_strips(pixels, own, tile)
    for patch, (col, row) in zip(found, places, strict=True):
        c, r = round(col), round(row)
        assert np.array_equal(patch, padded[r : r + 2 * HALF + 1, c : c + 2 * HALF + 1])


def test_black_pixels_differ_from_the_outside():
    patch = by_strips(np.zeros((*SHAPE, 1), np.uint8), observed([0.0], [0.0]), 70)[0]
    assert (patch[HALF:, HALF:] == 1).all() and not patch[:HALF].any() and not patch[:, :HALF].any()


@pytest.mark.parametrize("level", [0, 1, 3])
def test_positions_of_a_level_and_their_nearest_pixels(level):
    positions, pixels = nearest_pixels(observed([101.3, 7.0], [55.0, 200.9]), level)
    assert np.allclose(positions, (np.array([[101.3, 55.0], [7.0, 200.9]]) - (2**level - 1) / 2) / 2**level)
    assert np.abs(positions - pixels).max() <= 0.5 and pixels.dtype == np.int64


def test_a_photograph_without_observations_has_no_patches():
    strip = Strip(0, SHAPE, 0, 70, HALF)
    none = strip_patches(np.ones((*SHAPE, 1), np.uint8), np.ones((4, 4, 1), np.uint8), observed([], []), strip)
    assert isinstance(none, Values) and len(none) == 0
