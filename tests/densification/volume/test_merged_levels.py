"""One height per cell from the levels of a volume whose heights and qualities are written down."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.raster import Window
from orthomill.tasks.densification.volume.merged_levels import UNSURE, LevelsUnderTile, Sureness, merge_levels

SHAPES = [(16, 24), (8, 12), (4, 6)]
WHOLE = Window(0, 0, *SHAPES[0])
RULES = Sureness()
INNER = slice(4, -4), slice(4, -4)
"""cells that the border does not touch"""


def quality(shape, coherence: int, margin: int = 100) -> np.ndarray:
    out = np.zeros((*shape, 4), np.uint8)
    out[..., 1], out[..., 2], out[..., 3] = margin, coherence, 3
    return out


def merged(heights, qualities, window=WHOLE, rules=RULES):
    under = LevelsUnderTile.of(window, SHAPES)
    cut = [[array[at.slices] for array, at in zip(arrays, under.levels, strict=True)] for arrays in (heights, qualities)]
    return merge_levels(under, rules, tuple(cut[0]), tuple(cut[1]))


def level_heights() -> list[np.ndarray]:
    """The level's number as its height, everywhere."""
    return [np.full(shape, float(k), np.float32) for k, shape in enumerate(SHAPES)]


@pytest.mark.parametrize(
    ("coherences", "height", "level"),
    [
        ((90, 95, 99), 0, 0),
        ((40, 90, 99), 1, UNSURE + 1),
        ((30, 40, 90), 2, UNSURE + 2),
        ((40, 60, 50), 1, UNSURE + 1),
        ((50, 50, 50), 0, UNSURE),
    ],
)
def test_the_finest_level_that_is_sure_gives_the_height(coherences, height, level):
    found = merged(level_heights(), [quality(shape, c) for shape, c in zip(SHAPES, coherences, strict=True)])
    assert (found.height == height).all() and (found.level[INNER] == level).all()
    assert (found.quality[..., 2] == coherences[height]).all()


@pytest.mark.parametrize(
    ("rules", "level"), [(Sureness(coherence=0.6), 0), (Sureness(coherence=0.9), UNSURE + 1), (Sureness(margin=1.2), UNSURE)]
)
def test_coherence_and_margin_decide_what_is_sure(rules, level):
    found = merged(level_heights(), [quality(SHAPES[0], 70), quality(SHAPES[1], 95), quality(SHAPES[2], 80)], rules=rules)
    assert (found.level[INNER] == level).all()


def test_a_few_cells_that_stand_alone_do_not_ask_a_coarser_level():
    qualities = [quality(shape, 95) for shape in SHAPES]
    qualities[0][4:6, 10:12, 2] = 10
    found = merged(level_heights(), qualities)
    assert (found.height == 0).all() and (found.level[4:6, 10:12] == UNSURE).all() and (found.level[INNER] == UNSURE).sum() == 4


def test_nothing_is_sure_next_to_the_border():
    heights = level_heights()
    heights[0][8, 12] = np.nan
    sure = merged(heights, [quality(shape, 95) for shape in SHAPES]).level < UNSURE
    row, col = np.indices(SHAPES[0])
    near = (np.abs(row - 8) <= 4) & (np.abs(col - 12) <= 4)
    edge = (row < 4) | (col < 4) | (row >= SHAPES[0][0] - 4) | (col >= SHAPES[0][1] - 4)
    assert (sure == ~(near | edge)).all()


def test_a_height_that_others_nearly_equal_is_an_estimate():
    found = merged(level_heights(), [quality(shape, 95, 10) for shape in SHAPES])
    assert (found.height == 0).all() and (found.level == UNSURE).all()


def test_heights_at_the_border_are_those_farther_inside():
    heights = level_heights()
    heights[0][:] = np.arange(24.0, dtype=np.float32)
    heights[0][:, 0] = 900.0
    found = merged(heights, [quality(shape, 95) for shape in SHAPES])
    assert (found.height[:, :4] == 4.0).all() and (found.height[INNER] == heights[0][INNER]).all()


def test_coarse_heights_are_interpolated():
    heights = level_heights()
    heights[1] = np.broadcast_to(10.0 + 2.0 * np.arange(12, dtype=np.float32), SHAPES[1]).copy()
    found = merged(heights, [quality(SHAPES[0], 0), quality(SHAPES[1], 100), quality(SHAPES[2], 0)])
    assert found.height[:, 1:-1] == pytest.approx(np.broadcast_to(9.5 + np.arange(24.0), SHAPES[0])[:, 1:-1])


def test_cells_that_the_finest_level_does_not_see_stay_empty():
    heights = level_heights()
    heights[0][3:5, 7:9] = np.nan
    found = merged(heights, [quality(SHAPES[0], 0), quality(SHAPES[1], 100), quality(SHAPES[2], 0)])
    assert (np.isnan(found.height) == np.isnan(heights[0])).all()


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), row=st.integers(0, 10), col=st.integers(0, 18), size=st.integers(1, 12))
def test_a_window_is_a_window_of_the_whole(seed, row, col, size):
    rng = np.random.default_rng(seed)
    heights = [rng.normal(50, 5, shape).astype(np.float32) for shape in SHAPES]
    heights[1][rng.random(SHAPES[1]) < 0.1] = np.nan
    qualities = [rng.integers(0, 120, (*shape, 4)).astype(np.uint8) for shape in SHAPES]
    window = Window(row, col, size, size).clipped(SHAPES[0])
    part, whole = merged(heights, qualities, window), merged(heights, qualities)
    for one, other in zip(part, whole, strict=True):
        assert np.array_equal(one, other[window.slices], equal_nan=one.dtype.kind == "f")
