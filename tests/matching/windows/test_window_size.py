"""Window sizes: measures against plain NumPy, rules against printed series, behaviour that was published, and bad input."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy import ndimage

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window, tiles_of
from orthomill.tasks.matching.windows.calibration import calibrated, last_limits
from orthomill.tasks.matching.windows.measures import WindowGrowth, border_rooms, data_rooms, entropy, gradient_weights, statistics
from orthomill.tasks.matching.windows.size_map import halo, published_levels, size_map
from orthomill.tasks.matching.windows.sizes import (
    chosen_size,
    entropy_choice,
    foerstner_choice,
    grey_levels,
    growth_of,
    statistical_choice,
    window_sizes,
)
from orthomill.tasks.matching.windows.window_settings import (
    CombinedWindow,
    EntropyWindow,
    FixedWindow,
    FoerstnerWindow,
    StatisticalWindow,
    WindowSizing,
)

METHODS = (FixedWindow(window=11), StatisticalWindow(), EntropyWindow(), FoerstnerWindow(), CombinedWindow())
GROWING = METHODS[1:]


def _series(*lines: str) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(number) for number in line.split()) for line in lines)


# Mean, standard deviation, range and entropy of five published samples, windows of 5 x 5 to 35 x 35 (sources/matching.md#samples)
SAMPLES = {
    1: _series(
        "174.92 167.35 156.99 149.13 143.72 139.53 135.67 132.47 130.61 128.84 126.37 125.04 125.11 125.04 124.66 124.37",
        "21.01 27.11 34.41 37.41 38.13 37.55 36.58 35.53 34.34 34.15 35.47 35.26 34.04 32.78 31.64 30.44",
        "97 127 143 149 150 150 158 159 173 198 205 213 213 213 213 213",
        "2.9416 3.6655 4.0906 4.3159 4.4284 4.4344 4.4556 4.4675 4.5214 4.6206 4.7033 4.7553 4.7559 4.7386 4.7219 4.6916",
    ),
    2: _series(
        "99.44 87.86 79.69 73.69 68.74 65.81 64.59 63.7 62.41 60.59 59.34 59.02 59.28 59.98 60.81 61.26",
        "21.62 27.73 30.34 30.13 29.12 28.52 28.84 28.95 28.75 28.16 27.72 27.77 28.17 28.89 29.11 28.52",
        "68 88 92 93 100 112 112 112 112 115 115 115 115 115 115 115",
        "2.9207 3.5593 3.8316 4.0439 4.1522 4.234 4.2753 4.2872 4.2859 4.2923 4.3044 4.3218 4.339 4.3614 4.3831 4.4103",
    ),
    3: _series(
        "111.04 112.27 112.68 111.84 110.8 109.58 108.86 108.27 107.31 106.24 105.38 104.58 103.8 103.15 102.7 102.27",
        "9.49 9.63 10.3 11 11.04 10.78 10.55 10.28 10.18 10.37 10.5 10.38 10.5 10.67 10.75 10.89",
        "31 33 44 53 65 65 65 65 65 65 67 67 68 68 68 68",
        "2.6197 3.1687 3.4006 3.5489 3.6239 3.641 3.6581 3.6548 3.6704 3.7019 3.7278 3.7221 3.7342 3.7576 3.7664 3.7818",
    ),
    4: _series(
        "144.52 133.98 126.33 121.74 118.25 114.83 111.75 108.71 105.86 103.56 101.51 99.89 98.5 97.21 96.03 95.03",
        "25.09 30.81 32.22 31.57 30.54 30.15 30.36 30.88 31.29 31.55 31.6 31.47 31.41 31.42 31.41 31.19",
        "92 94 94 95 97 104 130 134 136 136 138 142 145 145 145 145",
        "2.8652 3.3612 3.7965 4.0422 4.256 4.3245 4.3391 4.3782 4.4479 4.486 4.4928 4.5076 4.5491 4.5676 4.5619 4.5696",
    ),
    5: _series(
        "175.8 174.69 172.53 170.4 169.43 168 167 166.3 165.4 164.36 163.26 161.96 160.74 159.25 157.21 154.92",
        "5.69 6.08 9.42 14.63 16.82 18.78 19.79 19.99 20.33 21.1 22.3 23.5 24.39 25.2 26.87 29.26",
        "22 30 63 108 122 122 122 122 126 133 133 137 137 140 143 156",
        "2.6434 2.8393 3.1317 3.3634 3.4812 3.6608 3.7318 3.7625 3.8106 3.8695 3.9276 3.991 4.0475 4.1152 4.1849 4.2501",
    ),
}


def side(column: int) -> int:
    """Side of the window in a column of the samples; 0 for none."""
    return 5 + 2 * column if column else 0


def scene(seed: int = 0, shape: tuple[int, int] = (90, 110)) -> np.ndarray:
    """Blobs, an edge and a flat quarter, uint8."""
    rng = np.random.default_rng(seed)
    image = 120 + 260 * ndimage.gaussian_filter(rng.normal(size=shape), 1.5)
    image[:, shape[1] // 2 :] += 40
    image[: shape[0] // 2, : shape[1] // 2] = 90
    return np.clip(image, 0, 255).astype(np.uint8)


def growth(levels: np.ndarray, pixels: np.ndarray, first: int, last: int, margin: int = 0) -> WindowGrowth:
    rooms = data_rooms(levels, pixels, border_rooms(levels.shape, pixels, last + margin))
    return WindowGrowth(pixels, np.maximum(rooms - margin, -1), first, last)


def window_of(levels: np.ndarray, pixel: np.ndarray, half: int) -> np.ndarray | None:
    col, row = pixel
    if min(col, row) < half or row + half >= levels.shape[0] or col + half >= levels.shape[1]:
        return None
    window = levels[row - half : row + half + 1, col - half : col + half + 1].astype(float)
    return None if (window < 0).any() else window


def plain_measures(levels: np.ndarray, pixel: np.ndarray, half: int) -> tuple[float, ...]:
    """Entropy, mean, deviation and range, the textbook way."""
    window = window_of(levels, pixel, half)
    if window is None:
        return (np.nan,) * 4
    share = np.unique(window, return_counts=True)[1] / window.size
    return -(share * np.log(share)).sum(), window.mean(), window.std(), np.ptp(window)


def plain_weights(levels: np.ndarray, pixel: np.ndarray, half: int) -> tuple[float, float]:
    """Weight from the inverse of N, roundness from its eigenvalues."""
    window = window_of(levels, pixel, half + 1)
    if window is None:
        return np.nan, np.nan
    gx, gy = (window[1:-1, 2:] - window[1:-1, :-2]) / 2, (window[2:, 1:-1] - window[:-2, 1:-1]) / 2
    normal = np.array([[(gx * gx).sum(), (gx * gy).sum()], [(gx * gy).sum(), (gy * gy).sum()]])
    small, large = np.linalg.eigvalsh(normal)
    if small < 1e-9:
        return 0.0, 0.0
    return 1 / np.trace(np.linalg.inv(normal)), 1 - ((large - small) / (large + small)) ** 2


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=12, deadline=None)
def test_measures_agree_with_plain_numpy(seed):
    rng = np.random.default_rng(seed)
    levels = scene(seed % 7, (40, 50)).astype(np.int16)
    levels[rng.random(levels.shape) < 0.002] = -1
    pixels = np.column_stack([rng.integers(-1, 50, 40), rng.integers(-1, 40, 40)])
    pixels[(pixels < 0).any(axis=1)] = -1
    plain = np.array([[plain_measures(levels, pixel, half) for half in range(2, 9)] for pixel in pixels])
    grown = growth(levels, pixels, 3, 8)
    measured = np.stack([entropy(levels, grown), *statistics(levels, grown)], axis=-1)
    np.testing.assert_allclose(measured, plain, atol=1e-8)
    plain = np.array([[plain_weights(levels, pixel, half) for half in range(2, 9)] for pixel in pixels])
    measured = np.stack(gradient_weights(levels, growth(levels, pixels, 3, 8, margin=1)), axis=-1)
    np.testing.assert_allclose(measured, plain, rtol=1e-6, atol=1e-6)


def test_entropy_is_in_nats():
    """25 pixels with 15 single levels and 5 pairs: printed as 2.9416; two equal halves: ln 2; all different: ln 25."""
    pairs = np.array([*range(15), *range(100, 105), *range(100, 105)], dtype=np.int16).reshape(5, 5)
    centre, five = np.array([[2, 2]]), {"first": 2, "last": 2}
    assert entropy(pairs, growth(pairs, centre, **five))[0, 1] == pytest.approx(2.9416, abs=5e-5)
    different = np.arange(25, dtype=np.int16).reshape(5, 5)
    assert entropy(different, growth(different, centre, **five))[0, 1] == pytest.approx(np.log(25))
    halves = np.resize(np.array([0, 255], np.int16), (121,)).reshape(11, 11)
    assert entropy(halves, growth(halves, np.array([[5, 5]]), 5, 5))[0, 1] == pytest.approx(np.log(2), abs=1e-4)


def test_entropy_does_not_see_the_order_of_pixels():
    rng = np.random.default_rng(3)
    levels = rng.integers(0, 256, (35, 35)).astype(np.int16)
    shuffled = rng.permutation(levels.ravel()).reshape(35, 35)
    centre = np.array([[17, 17]])
    assert entropy(levels, growth(levels, centre, 17, 17))[0, 1] == entropy(shuffled, growth(shuffled, centre, 17, 17))[0, 1]


@pytest.mark.parametrize("sample, expected", [(1, 13), (2, 7), (3, 0), (4, 17), (5, 35)])
def test_the_statistical_rules_on_the_printed_samples(sample, expected):
    """The crossing goes first although samples 1 and 4 have enough scatter at 7 x 7; Table 4.5's eight settings all agree here."""
    rows = [np.array([series], dtype=float) for series in SAMPLES[sample][:3]]
    for deviation in (30.0, 25.0, 20.0, 15.0):
        for excess in (40.0, 30.0):
            sizing = StatisticalWindow(min_deviation=deviation, min_excess=excess)
            crossing_or_scatter = expected or side(int(np.argmax(rows[1][0] > deviation)))
            assert side(statistical_choice(*rows, sizing)[0]) == crossing_or_scatter


def test_a_dark_window_needs_excess_of_its_range():
    """Without crossing and scatter, the third rule: the range is above the mean at every size, and first above mean + 40 at 11."""
    mean, spread = np.full((1, 6), 20.0), np.array([[30.0, 40.0, 50.0, 61.0, 70.0, 70.0]])
    assert side(statistical_choice(mean, np.full((1, 6), 10.0), spread, StatisticalWindow())[0]) == 11
    assert side(statistical_choice(mean, np.full((1, 6), 26.0), spread, StatisticalWindow())[0]) == 7


@pytest.mark.parametrize(
    "limit, gain, expected",
    [
        (3.5, 0.0, (7, 7, 11, 9, 15)),
        (4.0, 0.0, (9, 11, 0, 11, 29)),
        (4.5, 0.0, (21, 0, 0, 27, 0)),
        (4.0, 0.005, (9, 11, 19, 11, 29)),
        (4.5, 0.025, (15, 19, 15, 17, 0)),
    ],
)
def test_the_entropy_rule_on_the_printed_samples(limit, gain, expected):
    sizing = EntropyWindow(min_entropy=limit, min_gain=gain)
    found = [side(entropy_choice(np.array([SAMPLES[sample][3]]), sizing)[0]) for sample in SAMPLES]
    assert tuple(found) == expected


def test_foerstner_needs_weight_and_roundness_at_the_same_size():
    weight, roundness = np.array([[9.0, 1.0, 9.0, 9.0]]), np.array([[0.9, 0.9, 0.1, 0.9]])
    assert side(foerstner_choice(weight, roundness, FoerstnerWindow(min_weight=5.0))[0]) == 11


def test_an_edge_has_neither_weight_nor_roundness_and_a_ramp_of_both_has_them():
    edge = np.where(np.arange(41) < 20, 50, 150).astype(np.int16) * np.ones((41, 1), np.int16)
    weight, roundness = gradient_weights(edge, growth(edge, np.array([[20, 20]]), 3, 17, margin=1))
    assert (weight == 0).all() and (roundness == 0).all()
    checks = (100 * ((np.arange(41)[:, None] // 2 + np.arange(41) // 2) % 2)).astype(np.int16)
    weight, roundness = gradient_weights(checks, growth(checks, np.array([[20, 20]]), 3, 17, margin=1))
    assert (weight > 1000).all() and roundness[0, -1] > 0.99


@pytest.mark.parametrize("sizing", GROWING, ids=lambda sizing: sizing.kind)
def test_sizes_are_the_smallest_accepted_or_a_reason(sizing):
    image = scene()
    points = np.argwhere(np.ones(image.shape, bool))[:, ::-1]
    found = window_sizes(grey_levels(image), points, sizing)
    assert set(np.unique(found.half)) <= {0, *sizing.halves}
    assert ((found.outcome == Outcome.NOT_TRIED) == found.assigned).all()
    assert set(np.unique(found.outcome[~found.assigned])) == {Outcome.LOW_TEXTURE, Outcome.OUTSIDE}
    room = border_rooms(image.shape, points, 99)
    assert (found.half <= room).all() and (room[found.outcome == Outcome.LOW_TEXTURE] >= sizing.halves[-1]).all()
    assert 0.1 < found.assigned.mean() < 0.95


def test_a_combined_window_is_the_larger_of_two():
    image, points = grey_levels(scene()), np.argwhere(np.ones((90, 110), bool))[:, ::-1]
    sizing = CombinedWindow()
    one, other = (window_sizes(image, points, part).half for part in (sizing.foerstner, sizing.entropy))
    both = window_sizes(image, points, sizing).half
    assert (both == np.where((one > 0) & (other > 0), np.maximum(one, other), 0)).all()


@pytest.mark.parametrize("sizing", METHODS, ids=lambda sizing: sizing.kind)
@pytest.mark.parametrize("value", [0, 130, 255])
def test_a_constant_image_has_too_little_texture(sizing, value):
    found = window_sizes(grey_levels(np.full((60, 60), value, np.uint8)), np.array([[30.0, 30.0]]), sizing)
    assert found.assigned[0] == (sizing.kind == "fixed")
    assert found.assigned[0] or found.outcome[0] == Outcome.LOW_TEXTURE


def test_a_stalled_entropy_of_a_constant_image_is_no_window():
    """The gain of a constant image is nothing at every size: it must not count as success."""
    sizing = EntropyWindow(min_gain=0.025)
    assert not window_sizes(grey_levels(np.full((60, 60), 9, np.uint8)), np.array([[30.0, 30.0]]), sizing).assigned[0]


@pytest.mark.parametrize("sizing", METHODS, ids=lambda sizing: sizing.kind)
def test_borders_gaps_and_impossible_points(sizing):
    image = scene(1).astype(np.float32)
    image[40:44, 70:74] = np.nan
    image[10, 90] = np.inf
    points = np.array([[0, 0], [71, 42], [90, 10], [np.nan, 5], [5, np.inf], [-1e30, 1e30], [-0.6, 30], [109.4, 89.4], [64, 42]])
    found = window_sizes(grey_levels(image), points, sizing)
    assert (found.outcome[:-1] == Outcome.OUTSIDE).all() and not found.half[:-1].any()
    assert found.half[-1] in (0, 3, 4, 5)
    masked = window_sizes(grey_levels(scene(1), np.zeros(image.shape, bool)), np.array([[50.0, 50.0]]), sizing)
    assert masked.outcome[0] == Outcome.OUTSIDE
    assert len(window_sizes(grey_levels(image), np.empty((0, 2)), sizing).half) == 0
    assert not window_sizes(grey_levels(np.empty((0, 0), np.uint8)), np.array([[0.0, 0.0]]), sizing).half.any()


def test_a_window_keeps_off_pixels_without_data():
    image = scene(2)
    gap = np.ones(image.shape, bool)
    gap[45, 80] = False
    points = np.column_stack([np.full(10, 80 - 3), np.arange(40, 50)]).astype(float)
    for sizing in METHODS:
        half = window_sizes(grey_levels(image, gap), points, sizing).half
        reach = np.maximum(3, np.abs(points[:, 1] - 45))
        assert (half < reach).all()


def test_halves_of_a_pixel_go_up():
    image = grey_levels(scene())
    found = window_sizes(image, np.array([[80.5, 60.5], [81.0, 61.0], [80.49, 60.49], [80.0, 60.0]]), FoerstnerWindow())
    assert found.half[0] == found.half[1] and found.half[2] == found.half[3]


def test_16_bits_with_limits_are_8_bits():
    image = scene()
    points = np.argwhere(np.ones(image.shape, bool))[::7, ::-1]
    wide = grey_levels(image.astype(np.uint16) * 200 + 1000, limits=(1000.0, 52000.0))
    assert (wide.levels == grey_levels(image).levels).all()
    found = [window_sizes(version, points, EntropyWindow()).half for version in (wide, grey_levels(image))]
    assert (found[0] == found[1]).all()


def median_side(image: np.ndarray, sizing: WindowSizing) -> float:
    """Median over inner points, a missing window counting as one beyond the largest."""
    rows, cols = np.mgrid[20 : image.shape[0] - 20 : 3, 20 : image.shape[1] - 20 : 3]
    half = window_sizes(grey_levels(image), np.column_stack([cols.ravel(), rows.ravel()]), sizing).half.astype(float)
    return float(np.where(half > 0, half, sizing.largest // 2 + 1).mean())


@pytest.mark.parametrize(
    "sizing", [StatisticalWindow(), EntropyWindow(), FoerstnerWindow(min_weight=20000.0)], ids=lambda sizing: sizing.kind
)
def test_windows_answer_to_smoothing_sharpening_and_contrast(sizing):
    """Published behaviour of all three: larger windows when smoothed, smaller when sharpened or of more contrast."""
    rng = np.random.default_rng(8)
    plain = 110 + 110 * ndimage.gaussian_filter(rng.normal(size=(160, 160)), 2.0) * 2.0
    smooth = ndimage.gaussian_filter(plain, 2.0)
    sharp, stretched = plain + 1.5 * (plain - smooth), 110 + 2 * (plain - 110)
    versions = {"smoothed": smooth, "plain": plain, "sharpened": sharp, "stretched": stretched}
    sides = {name: median_side(np.clip(image, 0, 255).astype(np.uint8), sizing) for name, image in versions.items()}
    assert sides["smoothed"] > sides["plain"] > sides["sharpened"]
    assert sides["plain"] > sides["stretched"]


def rotated_checkerboard() -> np.ndarray:
    """Squares of 10 px turned by 45 degrees, each with a dot of the opposite grey value, as in the published test."""
    row, col = np.mgrid[0:240, 0:240].astype(float)
    u, v = (col + row) / np.sqrt(2.0), (col - row) / np.sqrt(2.0)
    dark = (np.floor(u / 10) + np.floor(v / 10)) % 2 == 0
    dot = np.hypot(u % 10 - 5, v % 10 - 5) < 1.5
    return np.where(dark ^ dot, 40, 210).astype(np.uint8)


def test_the_checkerboard_has_the_smallest_windows_by_the_statistical_rule_and_no_entropy():
    """Published for the statistical method: mostly 7 x 7, some 9 x 9. Two grey levels have at most ln 2 nats of entropy, so the
    published entropy windows of this picture cannot come from the printed limits."""
    image = grey_levels(rotated_checkerboard())
    points = np.argwhere(np.ones((200, 200), bool))[:, ::-1] + 20
    half = window_sizes(image, points, StatisticalWindow()).half
    assert (half == 3).mean() > 0.5 and (half <= 4).mean() > 0.9
    assert not window_sizes(image, points, EntropyWindow()).assigned.any()


@pytest.mark.parametrize("roundness", [0.0, 0.75, 0.9])
def test_no_limit_spreads_the_foerstner_windows_of_a_checkerboard(roundness):
    """Published is a wide spread of sizes in nearly equal numbers; a regular pattern has two or three, at any limit."""
    image = grey_levels(rotated_checkerboard())
    points = np.argwhere(np.ones((200, 200), bool))[::23, ::-1] + 20
    for weight in (500.0, 2e4, 5e4, 1e5, 1.5e5, 2e5, 3e5, 5e5):
        half = window_sizes(image, points, FoerstnerWindow(min_weight=weight, min_roundness=roundness)).half
        assert (np.bincount(half) > 0.01 * len(half)).sum() <= 3


def test_one_outlying_pixel_shrinks_the_statistical_window_only():
    rng = np.random.default_rng(4)
    image = rng.integers(100, 108, (61, 61)).astype(np.uint8)
    spoiled = image.copy()
    spoiled[30, 34] = 255
    centre = np.array([[30.0, 30.0]])
    for version, expected in ((image, 0), (spoiled, 4)):
        assert window_sizes(grey_levels(version), centre, StatisticalWindow()).half[0] == expected
        assert window_sizes(grey_levels(version), centre, EntropyWindow()).half[0] == 0


@pytest.mark.parametrize("sizing", GROWING, ids=lambda sizing: sizing.kind)
@pytest.mark.parametrize("share", [0.5, 0.65])
def test_calibration_gives_windows_to_the_share_that_was_asked_for(sizing, share):
    image, rng = grey_levels(scene(6, (150, 150))), np.random.default_rng(0)
    points = rng.uniform(0, 149, (2000, 2))
    last = last_limits(image, points, sizing)
    result = calibrated(sizing, last, share)
    assigned = window_sizes(image, points, result.sizing).assigned.mean()
    assert assigned == pytest.approx(result.share, abs=1e-12)
    anyway = np.isposinf(last).all(axis=1).mean()
    assert max(share, anyway) <= assigned <= max(share, anyway) + 0.002


def test_calibration_says_what_it_could_not_reach():
    image, points = grey_levels(scene(6)), np.random.default_rng(0).uniform(0, 89, (1000, 2))
    result = calibrated(FoerstnerWindow(), last_limits(image, points, FoerstnerWindow()), 1.0)
    assert result.share < 1.0 and result.sizing.min_weight == 0.0
    flat = grey_levels(np.zeros((90, 90), np.uint8))
    assert calibrated(EntropyWindow(), last_limits(flat, points, EntropyWindow()), 0.9).share == 0.0


def test_calibration_refuses_what_makes_no_sense():
    image = grey_levels(scene())
    with pytest.raises(WorkflowError, match="fixed window has no limit"):
        last_limits(image, np.array([[5.0, 5.0]]), FixedWindow())
    with pytest.raises(WorkflowError, match="per cent"):
        calibrated(EntropyWindow(), np.ones((3, 1)), 1.2)
    with pytest.raises(WorkflowError, match="no points"):
        calibrated(EntropyWindow(), last_limits(image, np.empty((0, 2)), EntropyWindow()), 0.5)


@given(st.integers(0, 5), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
@settings(max_examples=15, deadline=None)
def test_a_higher_limit_never_makes_a_window_smaller(seed, one, other):
    image, points = grey_levels(scene(seed)), np.random.default_rng(seed).uniform(0, 89, (200, 2))
    low, high = sorted((one, other))
    for kind, name, scale in ((EntropyWindow, "min_entropy", 5.0), (FoerstnerWindow, "min_weight", 1e5)):
        small, large = (window_sizes(image, points, kind(**{name: limit * scale})) for limit in (low, high))
        assert not (large.assigned & ~small.assigned).any()
        assert (large.half[large.assigned] >= small.half[large.assigned]).all()


def test_levels_are_the_published_ones():
    half = np.array([3, 4, 5, 6, 0])
    assert published_levels(half, EntropyWindow(largest=13)).tolist() == [0, 63, 127, 191, 255]
    assert published_levels(np.arange(3, 18), EntropyWindow()).tolist() == list(range(0, 239, 17))


@pytest.mark.parametrize("sizing", (*METHODS[:4], EntropyWindow(min_gain=0.01, min_entropy=4.5)), ids=lambda sizing: sizing.kind)
def test_a_choice_in_two_goes_is_the_choice_among_all_sizes(sizing):
    image = grey_levels(scene(9))
    pixels = np.argwhere(np.ones((90, 110), bool))[:, ::-1]
    growth_to_last = growth_of(image, pixels, sizing)
    chosen = chosen_size(image.levels, growth_to_last, sizing)
    half = np.where(chosen > 0, growth_to_last.first - 1 + chosen, 0)
    assert (window_sizes(image, pixels, sizing).half == half).all()


@pytest.mark.parametrize("sizing", METHODS, ids=lambda sizing: sizing.kind)
def test_a_map_of_tiles_is_the_map_of_the_image(sizing):
    image = scene(7)
    whole = size_map(grey_levels(image), Window(0, 0, *image.shape), sizing)
    points = np.argwhere(np.ones(image.shape, bool))[:, ::-1]
    assert (whole.ravel() == window_sizes(grey_levels(image), points, sizing).half).all()
    for tile in tiles_of(image.shape, 37):
        read = tile.window.grown(halo(sizing)).clipped(image.shape)
        core = Window(tile.window.row - read.row, tile.window.col - read.col, *tile.window.shape)
        assert (size_map(grey_levels(image[read.slices]), core, sizing) == whole[tile.window.slices]).all()


def test_settings_are_one_tagged_union():
    adapter = TypeAdapter(WindowSizing)
    assert adapter.validate_python({"kind": "foerstner", "min_weight": 1957.6}).halves == tuple(range(3, 18))
    assert adapter.validate_python({"kind": "fixed", "window": 20}).halves == (10,)
    with pytest.raises(ValidationError, match="smallest must not be the larger one"):
        adapter.validate_python({"kind": "entropy", "smallest": 21, "largest": 9})
    with pytest.raises(ValidationError):
        adapter.validate_python({"kind": "entropy", "threshold": 9})
