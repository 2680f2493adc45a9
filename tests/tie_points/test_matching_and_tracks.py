"""Pairs, matches and tracks on inputs small enough to know the answer."""

import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.observations import TiePoints
from orthomill.schemas.photo import PHOTOS, Photo, Photos
from orthomill.schemas.stage_contract import NotYet
from orthomill.tasks.tie_points.appearance import alike, sample, signature, vocabulary
from orthomill.tasks.tie_points.block_strength import distribution_index, measure, shared_points
from orthomill.tasks.tie_points.descriptor_search import mutual_matches
from orthomill.tasks.tie_points.match_records import Features, Observations, PairMatches, PairSummary, Refined, Scatter, Values
from orthomill.tasks.tie_points.matched_features import keep_matched
from orthomill.tasks.tie_points.pair_matching import without_parallax
from orthomill.tasks.tie_points.pair_selection import Neighbourhood, candidate_pairs, needs_appearance, viewed_ground
from orthomill.tasks.tie_points.refinement import start_affine
from orthomill.tasks.tie_points.stage import TiePointsStage
from orthomill.tasks.tie_points.tie_point_assembly import Weighting, assemble, with_measured_floor
from orthomill.tasks.tie_points.tracks import build_tracks, observation_key, track_scratch


def photos(count: int, position=lambda number: None) -> Photos:
    return Photos(
        photos=tuple(
            Photo(name=f"p{n}", path=f"p{n}.jpg", width=100, height=80, bands=1, dtype="uint8", camera="c", position=position(n))
            for n in range(count)
        )
    )


def features(*places: tuple[float, float]) -> Features:
    col, row = np.array(places, dtype=float).T
    one = np.ones(len(places), dtype=np.float32)
    return Features(col, row, one, 0 * one, one)


def matches(*pairs: tuple[int, int]) -> PairMatches:
    left, right = np.array(pairs, dtype=np.int32).reshape(-1, 2).T
    return PairMatches(left, right)


@settings(max_examples=30, deadline=None)
@given(count=st.integers(2, 40), other=st.integers(2, 40), seed=st.integers(0, 1000))
def test_mutual_matches_agree_with_a_plain_search(count, other, seed):
    generator = np.random.default_rng(seed)
    left = generator.integers(0, 256, (count, 128), dtype=np.uint8)
    right = generator.integers(0, 256, (other, 128), dtype=np.uint8)
    copied = min(count, other) // 2
    right[:copied] = np.clip(left[:copied].astype(int) + generator.integers(-6, 7, (copied, 128)), 0, 255)
    squared = ((left[:, None].astype(np.int64) - right[None].astype(np.int64)) ** 2).sum(axis=2)
    expected = []
    for number, row in enumerate(squared):
        best = row.argmin()
        if squared[:, best].argmin() == number and row[best] < 0.64 * np.delete(row, best).min():
            expected.append((number, best))
    assert mutual_matches(left, right, 0.8).tolist() == [list(pair) for pair in expected]


def test_repeated_texture_is_not_matched():
    same = np.tile(np.arange(128, dtype=np.uint8), (6, 1))
    assert len(mutual_matches(same, same, 0.8)) == 0
    assert len(mutual_matches(same[:1], same, 0.8)) == 0


def test_few_photographs_are_compared_with_all():
    assert candidate_pairs(photos(4), Neighbourhood(20, 5)) == ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


def test_many_photographs_grow_linearly_and_follow_positions():
    grid = photos(400, lambda n: (50.0 * (n % 20), 60.0 * (n // 20), 500.0))
    pairs = candidate_pairs(grid, Neighbourhood(20, 8))
    assert len(pairs) < 400 * 8
    assert (0, 20) in pairs and (0, 399) not in pairs
    assert all(left < right for left, right in pairs) and len(set(pairs)) == len(pairs)


def test_neighbours_in_sequence_are_compared_whatever_is_known():
    assert candidate_pairs(photos(50), Neighbourhood(20, 6))[:3] == ((0, 1), (0, 2), (1, 2))
    assert needs_appearance(photos(50), Neighbourhood(20, 6)) and not needs_appearance(photos(20), Neighbourhood(20, 6))
    assert not needs_appearance(photos(50, lambda n: (10.0 * n, 0.0, 100.0)), Neighbourhood(20, 6))


def test_oblique_photographs_are_paired_by_the_ground_they_show():
    """Two strips 240 m apart whose cameras look at the ground between them; or away from each other."""
    row = photos(40, lambda n: (40.0 * (n % 20), 240.0 * (n // 20), 100.0)).photos
    for turn, least, most in ((45.0, 20, 200), (-45.0, 0, 3)):
        tilted = [p.model_copy(update={"attitude": (turn if n < 20 else -turn, 0.0, 0.0)}) for n, p in enumerate(row)]
        across = [pair for pair in candidate_pairs(Photos(photos=tuple(tilted)), Neighbourhood(10, 6)) if pair[0] < 20 <= pair[1]]
        assert least <= len(across) <= most
    assert np.allclose(viewed_ground(tilted)[[3, 23]], [[120.0, -120.0], [120.0, 360.0]])


def described(scene, seed, count=600):
    """Features of a photograph of one of several scenes: half of its descriptors are the scene's own, a little changed."""
    rng = np.random.default_rng(seed)
    own = np.random.default_rng(1000 + scene).gamma(0.6, 40.0, (count // 2, 128))[rng.permutation(count // 2)[: count // 3]]
    other = rng.gamma(0.6, 40.0, (count - len(own), 128))
    descriptors = np.vstack([own + rng.normal(0, 6, own.shape), other]).clip(0, 255).astype(np.uint8)
    place = rng.uniform(0, 1000, (2, count))
    size = np.concatenate([np.full(len(own), 9.0), np.full(len(other), 5.0)]).astype(np.float32)
    zero = np.zeros(count, np.float32)
    return Features(*place, size, zero, zero), Values(descriptors.ravel())


def test_photographs_without_positions_are_paired_by_appearance():
    """Sixty photographs of six scenes, shuffled: almost all pairs that the search names are of one scene."""
    scenes = np.random.default_rng(2).permutation(np.repeat(np.arange(6), 10))
    features = [described(scene, seed) for seed, scene in enumerate(scenes.tolist())]
    words = vocabulary(tuple(sample(one) for one in features))
    found = alike(photos(60), tuple(signature(one, words) for one in features), Neighbourhood(15, 6)).pairs
    searched = [pair for pair in found if pair[1] - pair[0] > 2]
    right = [scenes[left] == scenes[right] for left, right in searched]
    assert np.mean(right) > 0.9 and len(found) <= 60 * 6 + 60 * 2


def test_a_placed_photograph_needs_no_search_by_appearance():
    features = [described(0, seed) for seed in range(30)]
    words = vocabulary(tuple(sample(one) for one in features))
    mixed = photos(30, lambda n: (10.0 * n, 0.0, 100.0) if n != 12 else None)
    found = set(alike(mixed, tuple(signature(one, words) for one in features), Neighbourhood(15, 4)).pairs)
    assert len([pair for pair in found - set(candidate_pairs(mixed, Neighbourhood(15, 4))) if 12 in pair]) >= 1
    assert all(12 in pair for pair in found - set(candidate_pairs(mixed, Neighbourhood(15, 4))))


def test_tracks_run_over_photographs_and_contradictions_are_dropped():
    tables = (features((10, 10), (50, 40), (90, 70)), features((12, 10), (52, 40), (52, 44)), features((14, 10), (54, 40)))
    found = (matches((0, 0), (1, 1)), matches((1, 1)), matches((0, 0), (2, 1)))
    result = build_tracks(iter(tables), found, ((0, 1), (0, 2), (1, 2)), ((100, 80),) * 3)
    assert result["links"].conflicts == 1 and result["links"].tracks == 1
    for number in range(3):
        own = result[observation_key(number)]
        assert own.track.tolist() == [0] and own.col[0] == 10 + 2 * number
    assert result[observation_key(0)].reference.tolist() == [2], "the photograph that shows the point nearest to its centre"
    assert result["links"].pairs == ((0, 2), (1, 2))


def test_two_directions_at_one_place_are_one_point():
    tables = (features((10, 10), (10, 10)), features((12, 10)), features((14, 10)))
    found = (matches((0, 0)), matches((1, 0)))
    result = build_tracks(iter(tables), found, ((0, 1), (0, 2)), ((100, 80),) * 3)
    assert result["links"].tracks == 1 and result["links"].conflicts == 0
    assert [len(result[observation_key(number)]) for number in range(3)] == [1, 1, 1]


@pytest.mark.parametrize("per_pair", [200, 2000])
def test_memory_of_tracks_is_what_their_count_declares(per_pair):
    rng, count, many = np.random.default_rng(3), 30, 4000
    tables = [features(*rng.uniform(0, 4000, (many, 2))) for _ in range(count)]
    pairs = tuple((left, left + step) for step in (1, 2, 3) for left in range(count - step))
    # Mostly the same feature numbers everywhere, as true tracks have, so that components of all lengths arise.
    found = tuple(matches(*[(k, k) for k in rng.choice(many, per_pair, replace=False)]) for _ in pairs)
    counts = keep_matched(iter(found), iter(found), iter(tables), pairs, ((4000, 4000),) * count, 10**6).counts
    assert counts.matches == per_pair * len(pairs) and counts.features <= 2 * counts.matches
    tracemalloc.start()
    build_tracks(iter(tables), found, pairs, ((4000, 4000),) * count)
    used = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0.5 * track_scratch(counts) < used < track_scratch(counts)


def test_no_common_ground_is_one_sentence():
    with pytest.raises(GeometryError, match="None of the 1 pairs of the 2 photographs shows common ground"):
        build_tracks(iter((features((1, 1)), features((1, 1)))), (matches(),), ((0, 1),), ((100, 80),) * 2)


def test_a_single_photograph_is_named():
    class View:
        project = SimpleNamespace(tile=128)

        def table(self, table):
            if table == PHOTOS:
                return photos(1)
            raise NotYet

    with pytest.raises(GeometryError, match=r"single photograph \(p0\)"):
        list(TiePointsStage().plan(View()))


def test_the_start_affine_rotates_and_scales_and_replaces_outliers():
    one = np.ones(20, dtype=np.float32)
    base = Observations(np.arange(20), np.zeros(20), 0.0 * one, 0.0 * one, 2 * one, 350 * one)
    angle = np.full(20, 20.0, dtype=np.float32)
    angle[0] = 200.0
    other = Observations(np.arange(20), np.zeros(20), 0.0 * one, 0.0 * one, 3 * one, angle)
    affine = start_affine(base, other)
    turn = np.radians(30)
    expected = 1.5 * np.array([np.cos(turn), -np.sin(turn), np.sin(turn), np.cos(turn)])
    assert affine == pytest.approx(np.tile(expected, (20, 1)), abs=1e-6)


def test_unrefined_observations_are_kept_wide_or_dropped():
    one = np.zeros(2)
    left = Observations(np.array([0, 1], np.int32), np.zeros(2, np.int32), one + 5, one + 6, one + 2, one)
    right = Observations(np.array([0, 1], np.int32), np.zeros(2, np.int32), one + 7, one + 8, one + 2, one)
    refined = Refined(
        np.ones(2, np.int32),
        np.array([0, 1], np.int32),
        np.array([7.5, np.nan]),
        np.array([8.5, np.nan]),
        np.array([0.04, np.nan], np.float32),
        np.array([1, 7], np.uint8),
    )
    kept, summary = assemble((left, right), (refined,), Weighting(0.03, 0.7, "keep"))
    assert kept.col.tolist() == [5, 7.5, 5, 7] and kept.sigma == pytest.approx([0.03, 0.05, 0.03, 0.7])
    assert summary.outcomes == {1: 1, 7: 1}
    dropped, _ = assemble((left, right), (refined,), Weighting(0.03, 0.7, "drop"))
    assert dropped.col.tolist() == [5, 7.5] and dropped.track.tolist() == [0, 0]


def test_the_floor_is_the_median_scatter_but_never_below_the_setting():
    weighting = Weighting(0.03, 0.7, "drop")
    scatters = tuple(Scatter(points=100, sigma=sigma) for sigma in (0.2, None, 0.3, 0.1))
    assert with_measured_floor(weighting, scatters).floor == pytest.approx(0.2)
    assert with_measured_floor(weighting, (Scatter(points=3, sigma=None),)).floor == 0.03


def test_strength_of_photographs_counts_shared_points():
    points = TiePoints(
        np.repeat(np.arange(40), 2), np.tile([0, 1], 40), np.linspace(0, 99, 80), np.linspace(0, 79, 80), np.ones(80)
    )
    assert shared_points(points, 3).tolist() == [[0, 40, 0], [40, 0, 0], [0, 0, 0]]
    strength = measure(points, photos(3))
    assert strength.partners.tolist() == [1, 1, 0] and strength.block[2] == -1
    assert strength.observations.tolist() == [40, 40, 0]


def test_a_pair_is_accepted_only_with_inliers():
    assert not PairSummary(left="a", right="b", tentative=20, inliers=0).accepted


def test_the_distribution_index_is_one_for_even_and_zero_for_one_corner():
    def points(col, row):
        zero = np.zeros(len(col), np.int32)
        return TiePoints(
            np.arange(len(col), dtype=np.int32), zero, np.asarray(col, float), np.asarray(row, float), zero.astype(np.float32)
        )

    col, row = (v.ravel() for v in np.meshgrid(np.arange(5.0, 90.0, 10.0), np.arange(5.0, 90.0, 10.0)))
    size = np.array([90, 90])
    assert distribution_index(points(col, row), size) == pytest.approx(1.0)
    assert distribution_index(points(col / 3.1, row / 3.1), size) == 0.0
    half = col < 30
    assert distribution_index(points(col[half], row[half]), size) == pytest.approx(0.5)
    assert distribution_index(points([], []), size) == 0.0


def test_matches_at_the_same_place_reveal_a_repeated_picture():
    rng = np.random.default_rng(1)
    here = rng.uniform(0, 1000, (100, 2))
    assert without_parallax((here, here + rng.normal(0, 0.2, here.shape)))
    assert not without_parallax((here, here + np.array([5.0, 0.0]))), "a small base is a base"
    assert not without_parallax((here[:10], here[:10]))


def test_a_repeated_photograph_is_not_used_in_tracks():
    tables = tuple(Features(*(np.arange(20.0) * k for k in (1, 2)), *(np.ones(20, np.float32),) * 3) for _ in range(3))
    same = PairMatches(np.arange(20, dtype=np.int32), np.arange(20, dtype=np.int32))
    pairs = ((0, 1), (0, 2), (1, 2))
    summaries = tuple(PairSummary(left=str(i), right=str(j), tentative=20, inliers=20, alike=(i, j) == (0, 1)) for i, j in pairs)
    tracks = build_tracks(iter(tables), (same, same, same), pairs, ((100, 100),) * 3, summaries)
    assert [len(tracks[observation_key(number)]) for number in range(3)] == [20, 0, 20]
