"""From pixels to refined tie points over photographs whose every homologous point is known."""

from itertools import chain

import numpy as np
import pytest
from textured_plane import CAMERA, NAMES, cameras, photograph, texture, true_partner, views

from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window, tiles_of
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching
from orthomill.tasks.matching.windows.window_settings import CombinedWindow, EntropyWindow, FoerstnerWindow
from orthomill.tasks.tie_points.features import CELL, Detection, photo_features, tile_features
from orthomill.tasks.tie_points.match_records import DESCRIPTOR, FeatureTables
from orthomill.tasks.tie_points.pair_matching import PairRules, epipolar_agreement, epipolar_scatter, match_pair
from orthomill.tasks.tie_points.patches import Strip, strip_patches
from orthomill.tasks.tie_points.refinement import PatchRules, Refinable, refine_pair, refine_pairs
from orthomill.tasks.tie_points.tie_point_assembly import Weighting, assemble
from orthomill.tasks.tie_points.tracks import build_tracks, observation_key

SHAPE = (CAMERA.height, CAMERA.width)
RULES = PatchRules(0, 128, LeastSquaresMatching(max_shift=3.0, min_correlation=0.7))
PAIRS = ((0, 1), (0, 2), (1, 2))


def features_of(pixels: np.ndarray, tile: int, limit: int = 1500) -> FeatureTables:
    parts = []
    for cell in tiles_of(SHAPE, tile):
        detection = Detection(0, SHAPE, cell.window, limit, 0.02)
        parts.append(tile_features(pixels[detection.window.slices], pixels[::2, ::2], detection))
    return photo_features(tuple(part.features for part in parts), tuple(part.descriptors for part in parts), 0, limit)


@pytest.fixture(scope="module")
def photos():
    image = texture()
    return [photograph(view, image, seed) for seed, view in enumerate(views())]


@pytest.fixture(scope="module")
def found(photos):
    return [features_of(pixels, 512) for pixels in photos]


def test_a_faint_photograph_has_its_points_where_the_plain_one_has_them(photos, found):
    """A ninth of the contrast: haze, water, dusk."""
    faint = features_of(np.rint(110 + photos[0] / 9.0).astype(np.uint8), 512)
    own, plain = (np.column_stack([one.features.col, one.features.row]) for one in (faint, found[0]))
    away = np.hypot(*(own[:, None] - plain).transpose(2, 0, 1)).min(axis=1)
    assert len(own) > 0.25 * len(plain) and (away < 0.5).mean() > 0.6


@pytest.fixture(scope="module")
def matched(found):
    sides = [tuple(one) for one in found]
    rules = PairRules(0.8, 1.5)
    return [match_pair(sides[left], sides[right], cameras(), (NAMES[left], NAMES[right]), rules) for left, right in PAIRS]


@pytest.fixture(scope="module")
def tracked(found, matched):
    tables = tuple(one.features for one in found)
    return build_tracks(iter(tables), tuple(pair.matches for pair in matched), PAIRS, ((CAMERA.width, CAMERA.height),) * 3)


@pytest.fixture(scope="module")
def refined(photos, tracked):
    return refined_by(photos, tracked, RULES)


def refined_by(photos, tracked, rules):
    observations, patches = cut_by(photos, tracked, rules)
    results = [
        refine_pair(
            (observations[i], observations[j]), patches[i], patches[j], cameras(), (i, j), (NAMES[i], NAMES[j]), (rules, rules)
        )
        for i, j in tracked["links"].pairs
    ]
    return tuple(result.refined for result in results)


def cut_by(photos, tracked, rules):
    """Observations and strips of patches of every photograph."""
    observations = [tracked[observation_key(number)] for number in range(3)]
    patches = []
    for pixels, own in zip(photos, observations, strict=True):
        strips = [Strip(0, SHAPE, row, min(128, SHAPE[0] - row), rules.half) for row in range(0, SHAPE[0], 128)]
        patches.append(tuple(strip_patches(pixels[strip.window.slices], pixels[::2, ::2], own, strip) for strip in strips))
    return observations, patches


def test_the_pairs_of_a_photograph_are_refined_as_each_of_them_alone(photos, tracked, refined):
    observations, patches = cut_by(photos, tracked, RULES)
    assert tracked["links"].pairs == ((0, 1), (0, 2), (1, 2)) and tracked["links"].first == (0, 1)
    one, *partners = (Refinable(number, NAMES[number], RULES, len(patches[number])) for number in range(3))
    streams = iter(observations[1:]), chain(*patches[1:])
    together = refine_pairs(observations[0], patches[0], *streams, cameras(), one, tuple(partners))
    for name in ("photo", "track", "col", "row", "sigma", "outcome"):
        alone = np.concatenate([getattr(pair, name) for pair in refined[:2]])
        assert np.array_equal(getattr(together.refined, name), alone, equal_nan=True)
    assert len(together.scatters.pairs) == 2


def points_in_relief(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Exact homologous pixels of ground points up to 8 m high in the first two photographs."""
    generator = np.random.default_rng(4)
    ground = views()[0].at_height(generator.uniform([20, 20], [420, 360], (count, 2)), 0.0)
    ground[:, 2] += generator.uniform(0, 8, count)
    return views()[0].project(ground), views()[1].project(ground)


def test_tiles_find_the_points_of_the_whole(photos, found):
    tiled = features_of(photos[0], 128)
    whole = found[0]
    assert len(tiled.features) == len(whole.features)
    near = np.abs(tiled.features.col - whole.features.col) + np.abs(tiled.features.row - whole.features.row) < 1e-2
    same = (tiled.descriptors.rows(DESCRIPTOR) == whole.descriptors.rows(DESCRIPTOR)).all(axis=1)
    assert near.mean() > 0.99 and same.mean() > 0.99


def test_points_are_spread_over_the_frame(found):
    features = found[0].features
    cells = np.unique(np.column_stack([features.col // CELL, features.row // CELL]), axis=0)
    assert len(cells) == (CAMERA.height // CELL) * (CAMERA.width // CELL)
    assert len(features) <= 1500


def test_accepted_matches_are_true(found, matched):
    for (i, j), pair in zip(PAIRS, matched, strict=True):
        left, right = found[i].features.take(pair.matches.left), found[j].features.take(pair.matches.right)
        truth = true_partner(views()[i], views()[j], np.column_stack([left.col, left.row]))
        miss = np.hypot(truth[:, 0] - right.col, truth[:, 1] - right.row)
        assert pair.summary.accepted and len(miss) > 50
        assert (miss < 2.0).mean() > 0.97


def test_photographs_of_different_ground_are_not_accepted(found):
    other = features_of(photograph(views()[0], texture(seed=9)), 512)
    sides = [tuple(one) for one in (found[0], other)]
    result = match_pair(sides[0], sides[1], cameras(), ("a", "b"), PairRules(0.8, 1.5))
    assert not result.summary.accepted and len(result.matches) == 0


def test_nominal_cameras_are_checked_without_their_constant():
    nominal = CAMERA.model_copy(update={"source": "exif", "c": 500.0})
    left, right = points_in_relief(400)
    wrong = np.arange(400) % 5 == 0
    right[wrong] += [8.0, 25.0]
    agree = epipolar_agreement((left, right), (nominal, nominal), 1.5)
    assert agree[~wrong].mean() > 0.95 and agree[wrong].mean() < 0.2


def test_refined_points_are_many_times_better_than_detected_ones(tracked, refined):
    before, after, sigma = errors_of(tracked, refined)
    scatter = [1.4826 * np.median(np.abs(errors)) for errors in (before, after)]
    assert scatter[1] < 0.06 and scatter[1] < scatter[0] / 3
    assert 0.5 < scatter[1] / np.median(sigma) < 2.5, "formal standard errors mean what they say"


@pytest.mark.parametrize(
    "window", [EntropyWindow(min_entropy=4.0), FoerstnerWindow(min_weight=3000.0), CombinedWindow()], ids=lambda window: window.kind
)
def test_windows_chosen_point_by_point_refine_as_well(photos, tracked, refined, window):
    """Points without a window have no match, and the outcome says why."""
    sized = refined_by(photos, tracked, PatchRules(0, 128, RULES.matching.model_copy(update={"window": window})))
    before, after, _ = errors_of(tracked, sized)
    assert len(after) > 100 and 1.4826 * np.median(np.abs(after)) < 1.4826 * np.median(np.abs(before)) / 2
    outcomes, fixed = (np.concatenate([table.outcome for table in tables]) for tables in (sized, refined))
    assert not np.array_equal(outcomes, fixed) and Outcome.NOT_TRIED not in outcomes


def errors_of(tracked, refined):
    """Detected and refined places (N, 2) minus the true ones, px, and the standard errors of the refined ones."""
    observations = [tracked[observation_key(number)] for number in range(3)]
    before, after, sigma = [], [], []
    for table in refined:
        for row in np.flatnonzero(table.outcome == int(Outcome.CONVERGED)):
            other = observations[table.photo[row]]
            at = np.searchsorted(other.track, table.track[row])
            home = other.reference[at]
            start = np.searchsorted(observations[home].track, table.track[row])
            point = np.array([[observations[home].col[start], observations[home].row[start]]])
            truth = true_partner(views()[home], views()[table.photo[row]], point)[0]
            before.append(np.array([other.col[at], other.row[at]]) - truth)
            after.append(np.array([table.col[row], table.row[row]]) - truth)
            sigma.append(table.sigma[row])
    return np.array(before), np.array(after), np.array(sigma)


def test_the_result_is_sorted_complete_and_repeatable(tracked, refined):
    observations = tuple(tracked[observation_key(number)] for number in range(3))
    kept, summary = assemble(observations, refined, Weighting(0.03, 0.7, "keep"))
    dropped, _ = assemble(observations, refined, Weighting(0.03, 0.7, "drop"))
    assert len(kept) == sum(len(table) for table in observations)
    assert len(dropped) == len(kept) or len(dropped) < len(kept)
    order = kept.track.astype(np.int64) * 3 + kept.photo
    assert np.all(np.diff(order) > 0) and kept.track.max() + 1 == tracked["links"].tracks
    assert np.bincount(dropped.track).min() >= 2
    assert sum(summary.outcomes.values()) == sum(len(table) for table in refined)
    assert kept.sigma.min() >= np.float32(0.03)


def test_scatter_about_epipolar_lines_is_that_of_the_points():
    left, right = points_in_relief(400)
    right += np.random.default_rng(5).normal(0, 0.2, (400, 2))
    right[:20] += 15.0
    assert epipolar_scatter((left, right), (CAMERA, CAMERA)).sigma == pytest.approx(0.2, rel=0.2)
    assert epipolar_scatter((left[:10], right[:10]), (CAMERA, CAMERA)).sigma is None


def test_patches_at_the_border_mark_what_is_outside(photos, tracked):
    own = tracked[observation_key(0)]
    strip = Strip(0, SHAPE, 0, SHAPE[0], RULES.half)
    side = 2 * RULES.half + 1
    patches = strip_patches(photos[0], photos[0][::2, ::2], own, strip).rows(side * side).reshape(-1, side, side)
    assert len(patches) == len(own)
    window = Window(0, 0, *SHAPE)
    for number in (0, len(own) // 2, len(own) - 1):
        col, row = int(np.rint(own.col[number])), int(np.rint(own.row[number]))
        assert patches[number, RULES.half, RULES.half] == max(photos[0][row, col, 0], 1)
        outside = (RULES.half - row > 0) * (RULES.half - row)
        assert not patches[number, : max(outside, 0)].any()
    assert window.shape == SHAPE
