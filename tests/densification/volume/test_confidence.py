"""Which heights of the volume count as measured: coherence, rivals and the border decide. What stands alone is calmed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from village_pair import normal_case

from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.canopy.canopy_heights import CanopyTile, DepthPiece
from orthomill.tasks.densification.settings.guide_settings import ConfidenceLimits
from orthomill.tasks.densification.volume import confidence
from orthomill.tasks.densification.volume.coherent_levels import standard_errors
from orthomill.tasks.densification.volume.confidence import Confidence, JudgedSquare, JudgedTile, judged, judged_square
from orthomill.tasks.densification.volume.quality import LEVEL_UNIT, SPREAD_UNIT, Band, Judgement, judgement, quality_bands
from orthomill.tasks.densification.volume.terrain import terrain_grid

SHAPE = (80, 104)
TERRAIN_SHAPE = terrain_grid(MapGrid(west=0.0, north=0.0, cell=1.0, rows=SHAPE[0], cols=SHAPE[1])).shape
WHOLE = Window(0, 0, *SHAPE)
INNER = slice(4, -4), slice(4, -4)
"""cells that the border does not touch"""


def quality(coherence: float, spread: float = 0.0, shape=SHAPE) -> np.ndarray:
    def full(value: float) -> np.ndarray:
        return np.full(shape, value)

    return quality_bands(full(0.5), full(coherence), full(3), full(spread), full(1.0))


SHAPES = [SHAPE, (40, 52), (20, 26)]
STEP = 0.5


def judge(height, bands, window=WHOLE, rules=None, terrain=0.0, coarser=None):
    """coarser: heights and qualities of the levels beyond the finest; by default none of them is coherent."""
    tile = JudgedTile.of(window, SHAPES, TERRAIN_SHAPE)
    ground = np.full(tile.places.shape, terrain, np.float32)
    levels = coarser or [(np.zeros(shape, np.float32), quality(0.1, shape=shape)) for shape in SHAPES[1:]]
    cut = [tuple(values[read.slices] for values in level) for level, read in zip(levels, tile.levels.read[1:], strict=True)]
    heights, qualities = zip(*cut, strict=True)
    own = height[tile.around.slices], bands[tile.around.slices]
    return judged(tile, rules or ConfidenceLimits(), *own, ground, STEP, heights, qualities)


def level(height: float = 50.0) -> np.ndarray:
    return np.full(SHAPE, height, np.float32)


@pytest.mark.parametrize(
    ("coherence", "spread", "rules", "confidence"),
    [
        (0.9, 0.5, ConfidenceLimits(), Confidence.HIGH),
        (0.6, 0.5, ConfidenceLimits(), Confidence.LOW),
        (0.6, 0.5, ConfidenceLimits(coherence=0.5), Confidence.HIGH),
        (0.9, 2.5, ConfidenceLimits(), Confidence.BLURRED),
        (0.6, 2.5, ConfidenceLimits(), Confidence.LOW),
        (0.9, 2.5, ConfidenceLimits(rival_spread=3.0), Confidence.HIGH),
        (0.9, 0.5, ConfidenceLimits(distinctiveness=1.2), Confidence.FAINT),
        (0.9, 0.5, ConfidenceLimits(distinctiveness=1.2, with_pair=1.2), Confidence.LOW),
        (0.3, 0.0, ConfidenceLimits(), Confidence.CALMED),
    ],
)
def test_coherence_and_rivals_decide(coherence, spread, rules, confidence):
    found = judge(level(), quality(coherence, spread), rules=rules, terrain=50.0)
    assert (found.confidence[INNER] == confidence).all() and (found.height == 50).all()


def test_nothing_is_sure_next_to_the_border():
    height = level()
    height[40, 50] = np.nan
    found = judge(height, quality(0.95))
    row, col = np.indices(SHAPE)
    near = (np.abs(row - 40) <= 4) & (np.abs(col - 50) <= 4)
    edge = (row < 4) | (col < 4) | (row >= SHAPE[0] - 4) | (col >= SHAPE[1] - 4)
    assert ((found.confidence == Confidence.HIGH) == ~(near | edge)).all()
    assert ((found.confidence == Confidence.FAINT) == (near | edge) & np.isfinite(height)).all(), "a pair may decide there"


def test_heights_at_the_border_are_those_farther_inside():
    height = np.broadcast_to(np.arange(SHAPE[1], dtype=np.float32), SHAPE).copy()
    height[:, 0] = 900.0
    found = judge(height, quality(0.95))
    assert (found.height[:, :4] == 4.0).all() and (found.height[INNER] == height[INNER]).all()


def test_the_surface_reaches_a_little_beyond_its_border():
    height = level()
    height[:, :20] = np.nan
    found = judge(height, quality(0.95))
    assert (found.height[4:-4, 16:] == 50).all() and np.isnan(found.height[:, :16]).all()
    assert (found.confidence[:, 16:20] != Confidence.HIGH).all()


def test_a_few_cells_that_stand_alone_are_not_calmed():
    bands, height = quality(0.95), level()
    bands[30:34, 40:44, Band.COHERENCE] = 10
    height[30:34, 40:44] += np.arange(4)
    found = judge(height, bands)
    assert (found.confidence[30:34, 40:44] == Confidence.LOW).all() and (found.confidence[INNER] == Confidence.LOW).sum() == 16
    assert (found.height == height).all()


def crowns(shape, cell):
    row, col = ((np.arange(size) + 0.5) * cell for size in shape)
    return (20 + 3 * np.sin(row / 15)[:, None] + 0.05 * col).astype(np.float32)


def test_where_leaves_stand_alone_the_surface_is_that_of_the_level_that_shows_the_crowns():
    rng = np.random.default_rng(0)
    leaves = (crowns(SHAPE, 1) + rng.normal(0, 3, SHAPE)).astype(np.float32)
    levels = [
        (crowns(shape, cell), quality(share, shape=shape)) for shape, cell, share in ((SHAPES[1], 2, 0.9), (SHAPES[2], 4, 0.9))
    ]
    found = judge(leaves, quality(0.2), coarser=levels)
    assert (found.confidence == Confidence.COARSE).all()
    assert np.abs(found.height - crowns(SHAPE, 1))[8:-8, 8:-8].max() < 0.15
    assert (found.judgement[..., Judgement.LEVEL] == LEVEL_UNIT).all()


def test_levels_pass_into_one_another_without_a_step():
    """The finer one shows the left half, a metre higher than the coarser one; coherence falls over the nine cells it looks at."""
    share = np.clip(1.1 - (np.arange(52) - 22) / 9, 0.1, 0.9)
    fine = quality(0.9, shape=SHAPES[1])
    fine[..., Band.COHERENCE] = np.rint(100 * share)
    levels = [(np.full(SHAPES[1], 21.0, np.float32), fine), (np.full(SHAPES[2], 20.0, np.float32), quality(0.95, shape=SHAPES[2]))]
    found = judge(level(300.0), quality(0.2), coarser=levels)
    assert found.height[40, :40] == pytest.approx(21) and found.height[40, 70:] == pytest.approx(20)
    assert (np.diff(found.height[40]) <= 1e-5).all() and -np.diff(found.height[40]).min() < 0.3
    sizes = found.judgement[40, :, Judgement.LEVEL] / LEVEL_UNIT
    assert sizes[0] == 1 and sizes[-1] == 2 and (np.diff(sizes) >= 0).all()


def test_chance_on_water_gives_way_to_the_tie_points_and_says_how_it_scatters():
    rng = np.random.default_rng(1)
    chance = [rng.uniform(-40, 60, shape).astype(np.float32) for shape in SHAPES]
    found = judge(
        chance[0], quality(0.2), terrain=3.0, coarser=[(values, quality(0.2, shape=values.shape)) for values in chance[1:]]
    )
    assert (found.confidence == Confidence.CALMED).all() and found.height == pytest.approx(3)
    stated = standard_errors(found.judgement[..., Judgement.LEVEL] / LEVEL_UNIT, STEP)
    assert stated[20:-20, 20:-20] == pytest.approx(100 / np.sqrt(12), rel=0.25)


def test_tie_points_far_below_a_crown_say_how_far_it_is_from_them():
    levels = [(np.full(shape, 14.0, np.float32), quality(0.2, shape=shape)) for shape in SHAPES[1:]]
    found = judge(level(300.0), quality(0.2), terrain=4.0, coarser=levels)
    assert found.height == pytest.approx(4)
    assert standard_errors(found.judgement[..., Judgement.LEVEL] / LEVEL_UNIT, STEP) == pytest.approx(10.0, rel=0.03)


def test_what_no_level_shows_is_never_better_than_a_crown_is_deep():
    levels = [(np.full(shape, 50.0, np.float32), quality(0.2, shape=shape)) for shape in SHAPES[1:]]
    still = judge(level(), quality(0.2), terrain=50.0, coarser=levels)
    assert standard_errors(still.judgement[..., Judgement.LEVEL] / LEVEL_UNIT, STEP) == pytest.approx(2.0, rel=0.03)


def test_a_volume_of_one_level_gives_way_to_the_tie_points_within_any_window():
    window, chance = Window(20, 30, 30, 40), np.random.default_rng(2).uniform(-40, 60, SHAPE).astype(np.float32)
    tile = JudgedTile.of(window, [SHAPE], TERRAIN_SHAPE)
    found = judged(
        tile,
        ConfidenceLimits(),
        chance[tile.around.slices],
        quality(0.2)[tile.around.slices],
        np.full(tile.places.shape, 3.0),
        STEP,
    )
    assert found.height.shape == window.shape and found.height == pytest.approx(3)


def test_a_gap_is_closed_from_what_is_shown_around_it():
    bands = [quality(0.9, shape=shape) for shape in SHAPES[1:]]
    bands[0][..., Band.COHERENCE] = 10
    bands[1][8:12, 10:14, Band.COHERENCE] = 10
    levels = [(np.full(shape, 30.0, np.float32), quality_of) for shape, quality_of in zip(SHAPES[1:], bands, strict=True)]
    found = judge(level(300.0), quality(0.2), coarser=levels, terrain=0.0)
    assert (found.confidence[36:44, 44:52] == Confidence.CALMED).all()
    assert 24 < found.height[40, 48] <= 30


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), row=st.integers(0, 70), col=st.integers(0, 90), size=st.integers(1, 40))
def test_a_window_is_a_window_of_the_whole(seed, row, col, size):
    rng = np.random.default_rng(seed)
    height = rng.normal(50, 5, SHAPE).astype(np.float32)
    height[rng.random(SHAPE) < 0.02] = np.nan
    bands = rng.integers(0, 100, (*SHAPE, len(Band))).astype(np.uint8)
    bands[..., Band.SPREAD] //= 16
    window = Window(row, col, size, size).clipped(SHAPE)
    levels = [
        (rng.normal(50, 5, shape).astype(np.float32), rng.integers(0, 100, (*shape, len(Band))).astype(np.uint8))
        for shape in SHAPES[1:]
    ]
    part, whole = judge(height, bands, window, coarser=levels), judge(height, bands, coarser=levels)
    for one, other in zip(part, whole, strict=True):
        assert np.array_equal(one, other[window.slices], equal_nan=one.dtype.kind == "f")


def test_tiles_of_one_job_are_judged_as_each_is_alone():
    rng, window = np.random.default_rng(5), Window(32, 0, 48, 104)
    height, bands = rng.normal(50, 5, SHAPE).astype(np.float32), rng.integers(0, 100, (*SHAPE, len(Band))).astype(np.uint8)
    levels = [(rng.normal(50, 5, shape).astype(np.float32), quality(0.7, shape=shape)) for shape in SHAPES[1:]]
    square = JudgedSquare.of(window, 32, SHAPES, TERRAIN_SHAPE)
    assert [tile.window.shape for tile in square.tiles] == [(32, 32)] * 3 + [(32, 8)] + [(16, 32)] * 3 + [(16, 8)]
    assert square.window == window and square.levels[0].overlap(window) == window
    cut = [tuple(values[read.slices] for values in level) for level, read in zip(levels, square.levels[1:], strict=True)]
    own, ground = (height[square.around.slices], bands[square.around.slices]), np.zeros(square.places.shape, np.float32)
    found = judged_square(square, ConfidenceLimits(), *own, ground, STEP, *zip(*cut, strict=True))
    assert len(np.unique(found.confidence)) > 1
    for tile in square.tiles:
        alone = judge(height, bands, tile.window, coarser=levels)
        for one, whole in zip(alone, found, strict=True):
            assert one.dtype == whole.dtype
            assert np.array_equal(one, whole[tile.window.within(window).slices], equal_nan=one.dtype.kind == "f")


def test_depth_maps_are_asked_where_few_go_along(monkeypatch):
    bands = quality(0.9)
    bands[:, 52:, Band.COHERENCE] = 60
    square = JudgedSquare.of(WHOLE, 32, SHAPES, TERRAIN_SHAPE)
    coarser = [(np.zeros(shape, np.float32), quality(0.1, shape=shape)) for shape in SHAPES[1:]]
    ground, canopy = np.zeros(square.places.shape, np.float32), np.full(SHAPE, 62.0, np.float32)
    canopy[:, 90:] = np.nan
    asked = []
    monkeypatch.setattr(confidence, "canopy_heights", lambda tile, maps: asked.append(tile) or canopy)
    surface = Surface(grid=MapGrid(west=0.0, north=0.0, cell=1.0, rows=SHAPE[0], cols=SHAPE[1]), height_low=0.0, height_high=90.0)
    tile = CanopyTile(surface, WHOLE, WHOLE, 1, (DepthPiece(normal_case(1400), Window(0, 0, 1, 1)),))

    levels = tuple(zip(*coarser, strict=True))

    def judged_with(bands, *canopy):
        return judged_square(square, ConfidenceLimits(), level(), bands, ground, STEP, *levels, *canopy)

    plain, found = judged_with(bands), judged_with(bands, tile, iter(()))
    crown = (slice(4, -4), slice(75, 86))
    assert (found.height[crown] == 62).all() and (found.confidence[crown] == Confidence.COARSE).all()
    assert standard_errors(found.judgement[..., Judgement.LEVEL] / LEVEL_UNIT, STEP)[crown] == pytest.approx(1.15 * STEP * 4)
    for one, other in zip(plain, found, strict=True):
        assert np.array_equal(one[:, :50], other[:, :50]) and np.array_equal(one[:, 90:], other[:, 90:])
    assert len(asked) == 1
    judged_with(quality(0.9), tile, iter(()))
    assert len(asked) == 1, "maps are read only where they are needed"


def test_a_judgement_is_about_a_cell_and_its_neighbours():
    bands = quality(1.0, 0.0, (80, 90))
    bands[40, 40, Band.SPREAD], bands[41, 41, Band.SPREAD] = 4 * SPREAD_UNIT, 2 * SPREAD_UNIT
    bands[42, 42, Band.SEEN], bands[42, 42, Band.SPREAD], bands[42, 42, Band.MARGIN] = 0, 255, 255
    bands[10:13, 10:13, Band.MARGIN] = 20
    found = judgement(bands)
    assert found[41, 41, Judgement.SPREAD] == round(SPREAD_UNIT * np.sqrt((16 + 4) / 8))
    # Half of the bits everywhere else, a fifth here.
    distinctiveness = found[..., Judgement.DISTINCTIVENESS]
    assert distinctiveness[11, 11] == pytest.approx(40, abs=1) and distinctiveness[60, 60] in (100, 101)
    assert (found[..., Judgement.COHERENCE] == 100).all()


def test_a_margin_without_rivals_counts_as_a_clear_one():
    bands = quality(1.0, 0.0, (9, 9))
    bands[4, 4, Band.MARGIN] = 255
    assert judgement(bands)[4, 4, Judgement.DISTINCTIVENESS] <= 111


def test_bands_that_are_too_large_are_cut_off():
    found = quality_bands(*(np.full((1, 1), value) for value in (np.inf, 0.5, 2, 40.0, 2.5)))
    assert found[0, 0].tolist() == [255, 50, 2, 255, 40]
