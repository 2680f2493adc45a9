"""A rectified pair alone: its start, its surface, what the codes and standard errors say."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.dense.dense_settings import DenseMatching
from orthomill.tasks.matching.dense.pair_start import AT_EDGES, PAIR_VOLUME, PLAIN, jump_factors, pair_start
from orthomill.tasks.matching.dense.pair_surface import PairSurface, ParallaxCode, break_variance, hidden, match_pair

ROWS, COLS, ISLAND = 110, 150, (slice(36, 76), slice(60, 104))


def pattern(shape: tuple[int, int], seed: int) -> np.ndarray:
    layers = [gaussian_filter(np.random.default_rng(seed).standard_normal(shape), s) * s for s in (1.0, 2.5)]
    return 128.0 + 32.0 * sum(layers) / np.std(sum(layers))


@pytest.fixture(scope="module")
def scene() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Left and right image (uint8) and the parallaxes of the left one: sloping ground, and an island 9 px above it."""
    row, col = np.mgrid[0:ROWS, 0:COLS].astype(float)
    ground = 8.0 + 0.02 * row
    right, roof = pattern((ROWS, COLS + 20), 3), pattern((ROWS, COLS + 20), 4)
    island = ground + 9.0
    truth, left = ground.copy(), map_coordinates(right, [row, col - ground], order=3, mode="nearest")
    truth[ISLAND] = island[ISLAND]
    left[ISLAND] = map_coordinates(roof, [row, col - island], order=3, mode="nearest")[ISLAND]
    # In the right image the island hides the ground that lies behind it.
    beyond = np.zeros(right.shape, bool)
    for r in range(36, 76):
        first = 60 - island[r, 0]
        cols = np.arange(right.shape[1])
        beyond[r] = (cols >= first) & (cols <= first + 43)
    right = np.where(beyond, roof, right)[:, :COLS]
    noise = np.random.default_rng(5)
    images = (np.clip(np.rint(image + noise.normal(0, 1.0, image.shape)), 1, 255).astype(np.uint8) for image in (left, right))
    return *images, truth


@pytest.fixture(scope="module")
def surface(scene) -> PairSurface:
    return match_pair(*scene[:2], 0.0, 30.0)


def visible(truth: np.ndarray) -> np.ndarray:
    """Nodes 2 px apart that the right image shows."""
    return ~hidden(truth.astype(np.float32), COLS)[::2, ::2]


def test_every_node_that_both_images_show_has_a_parallax_and_most_are_measured(scene, surface):
    both = visible(scene[2])
    assert np.isfinite(surface.parallax[both]).all() and np.isfinite(surface.sigma[both]).all()
    assert (surface.code[both] == ParallaxCode.MEASURED).mean() > 0.8
    error = np.abs(surface.parallax - scene[2][::2, ::2])
    assert np.median(error[both]) < 0.05 and (error[both] < 1.0).mean() > 0.97


def test_the_standard_errors_hold_for_every_code(scene, surface):
    both, error = visible(scene[2]), np.abs(surface.parallax - scene[2][::2, ::2])
    for code in (ParallaxCode.MEASURED, ParallaxCode.VOLUME):
        chosen = both & (surface.code == code)
        assert (error[chosen] < 3.0 * surface.sigma[chosen]).mean() > 0.95


def test_least_squares_that_strays_beside_a_break_gives_way_to_the_volume(scene, surface):
    start = pair_start(scene[0].astype(np.float32), scene[1].astype(np.float32), 0.0, 30.0).parallax[::2, ::2]
    strayed = (surface.outcome == Outcome.MOVED_TOO_FAR) & np.isfinite(start)
    assert (surface.code[strayed] != ParallaxCode.MEASURED).all()
    np.testing.assert_array_equal(surface.parallax[strayed], start[strayed])


def test_what_the_island_hides_is_estimated(scene, surface):
    covered = hidden(scene[2].astype(np.float32), COLS)[::2, ::2] & (np.arange(0, COLS, 2) > 30)
    assert covered.any() and (surface.code[covered] != ParallaxCode.MEASURED).mean() > 0.8


def test_codes_agree_with_parallaxes(surface):
    assert np.array_equal(surface.code == ParallaxCode.EMPTY, np.isnan(surface.parallax))
    assert np.array_equal(np.isnan(surface.sigma), np.isnan(surface.parallax))
    assert all(code.sentence for code in ParallaxCode)


def test_a_wide_range_is_searched_from_coarse_to_fine(scene):
    left, right, truth = scene
    narrow = PAIR_VOLUME.model_copy(update={"widest": 32})
    found = pair_start(left.astype(np.float32), right.astype(np.float32), -30.0, 60.0, narrow)
    both = ~hidden(truth.astype(np.float32), COLS)
    assert (np.abs(found.parallax - truth)[both] < 1.0).mean() > 0.9


def test_the_volume_of_a_pair_is_as_it_is_set(scene):
    left, right, _ = scene
    rough = PAIR_VOLUME.model_copy(update={"small_penalty": 0.0, "large_penalty": 0.0})
    usual, loose = (pair_start(left.astype(np.float32), right.astype(np.float32), 0, 30, volume) for volume in (PAIR_VOLUME, rough))
    assert usual.coherence.mean() > loose.coherence.mean()


def test_a_jump_costs_most_in_plain_ground_and_least_at_an_edge():
    image = np.random.default_rng(3).normal(120, 4, (60, 80)).astype(np.float32)
    image[:, 40:] += 100.0
    image[:, :20] = 120.0
    factors = jump_factors(image)
    assert (factors[:, :16] == PLAIN).all() and (factors[:, 39:41] == AT_EDGES).all()
    assert 1.5 < np.median(factors[:, 46:]) < 2.5
    assert jump_factors(np.zeros((8, 8), np.float32)).max() == PLAIN, "an image without contrast is plain"


def test_nodes_are_as_far_apart_as_set(scene):
    assert match_pair(*scene[:2], 0.0, 30.0, DenseMatching(step=4)).parallax.shape == (-(-ROWS // 4), -(-COLS // 4))


def test_a_break_makes_what_is_near_it_uncertain_by_the_jump():
    parallax = np.where(np.arange(40) < 20, 5.0, 15.0) * np.ones((30, 1))
    variance = break_variance(parallax.astype(np.float32), 2)[15]
    assert variance[[19, 20]] == pytest.approx(30.0) and variance[[18, 21]] == pytest.approx(5.0)
    assert (variance[[17, 22]] == 0.0).all()


def test_a_slope_is_no_break():
    assert (break_variance((0.2 * np.arange(40) * np.ones((30, 1))).astype(np.float32), 1) == 0.0).all()


def test_what_lies_behind_something_or_outside_is_hidden():
    parallax = np.full((3, 40), np.float32(2.0))
    parallax[1, 20:30] = 8.0
    covered = hidden(parallax, 40)
    assert covered[:, :2].all() and not covered[0, 2:].any()
    assert covered[1, 14:20].all() and not covered[1, 20:30].any() and not covered[1, 30:].any()


def test_nothing_is_found_in_images_without_data():
    empty = np.zeros((64, 64), np.uint8)
    found = match_pair(empty, empty, 0.0, 16.0)
    assert (found.code == ParallaxCode.EMPTY).all() and np.isnan(found.parallax).all()


@pytest.mark.parametrize(
    ("shapes", "bounds", "sentence"),
    [
        (((30, 40), (31, 40)), (0.0, 8.0), "two images of the same rows"),
        (((30, 40), (30, 40, 3)), (0.0, 8.0), "two images of the same rows"),
        (((30, 40), (30, 40)), (8.0, 8.0), "are no range"),
    ],
)
def test_a_pair_that_is_none_is_refused(shapes, bounds, sentence):
    with pytest.raises(ValueError, match=sentence):
        match_pair(*(np.ones(shape) for shape in shapes), *bounds)
