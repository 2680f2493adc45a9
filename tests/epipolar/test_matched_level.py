"""The pyramid level on which pairs are matched: chosen by the rows of their tie points, and what its images show."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tiny_block import block, camera, photograph, photos, tie_points

from orthomill.schemas.project import MapSurface
from orthomill.schemas.raster import Window
from orthomill.tasks.epipolar.epipolar_image import TileOfPair, resample_tile
from orthomill.tasks.epipolar.measured_pairs import measured_pairs
from orthomill.tasks.epipolar.pair_choice import PairChoice
from orthomill.tasks.epipolar.parallax import ROWS_AGREE, matched_level, with_measured_ties
from orthomill.tasks.epipolar.report.epipolar_report import report
from orthomill.tasks.epipolar.selection import choose_pairs
from orthomill.tasks.epipolar.stage import EpipolarStage
from orthomill.tasks.geometry.normal_case import epipolar_shape
from orthomill.tasks.imagery.pyramid import halved_window, level_shape, level_to_full, source_window

LEVELS = 4
ANYWHERE = SimpleNamespace(project=SimpleNamespace(grid=MapSurface()))


def deep():
    return photos().model_copy(update={"photos": tuple(p.model_copy(update={"levels": LEVELS}) for p in photos().photos)})


def pairs_of(noise, level=None):
    return measured_pairs(block(), tie_points(noise), deep(), PairChoice(), 0.08, 0.0, level)


def lowered(pixels, level):
    """A photograph (rows, cols, bands) on a pyramid level."""
    for _ in range(level):
        whole = Window(0, 0, *level_shape(pixels.shape, 1)[:2])
        pixels = halved_window(pixels[source_window(whole, pixels.shape[:2]).slices], whole)
    return pixels


@settings(max_examples=8, deadline=None)
@given(noise=st.floats(0.02, 2.5))
def test_rows_agree_on_the_level_that_is_matched_and_not_on_the_one_below(noise):
    found = pairs_of(noise)
    level, median = found.pairs[0].level, float(np.median([pair.row_sigma for pair in found.pairs]))
    assert {pair.level for pair in found.pairs} == {level}
    assert median <= ROWS_AGREE or level == LEVELS - 1
    assert level == 0 or 2 * median > ROWS_AGREE


def test_without_tie_points_photographs_are_matched_as_they_are():
    """The predictions of a weak block say nothing about its rows."""
    none = tie_points(2.0).take(np.zeros(0, int))
    pairs = choose_pairs(block(), PairChoice(), 0.08)
    assert matched_level(with_measured_ties(pairs, block(), none, photos().names)) == 0


def test_rows_that_agree_exactly_are_matched_as_they_are():
    pairs = choose_pairs(block(), PairChoice(), 0.08)
    exact = pairs.model_copy(update={"pairs": tuple(p.model_copy(update={"row_sigma": 0.0}) for p in pairs.pairs)})
    assert matched_level(exact) == 0


@pytest.mark.parametrize(("wanted", "level"), [(0, 0), (2, 2), (8, LEVELS - 1)])
def test_a_stated_level_is_taken_as_far_as_photographs_have_it(wanted, level):
    assert {pair.level for pair in pairs_of(0.02, wanted).pairs} == {level}
    job = next(iter(EpipolarStage(level=wanted).plan(ANYWHERE)))
    assert job.params["level"] == wanted
    assert next(iter(EpipolarStage().plan(ANYWHERE))).params["level"] is None


@pytest.mark.parametrize("level", [0, 1, 2])
def test_a_level_shows_the_same_ground_with_larger_pixels(level):
    """Of a photograph whose grey values rise evenly, every level has the value of the place that it shows."""
    fine, pair = (
        next(p for p in choose_pairs(block(), PairChoice(), 0.08, level=n).pairs if p.name == "a1-a2") for n in (0, level)
    )
    assert pair.c == fine.c / 2**level and pair.base_height == pytest.approx(fine.base_height, abs=1e-9)
    assert abs(pair.rows * 2**level - fine.rows) <= 2 * 2**level
    tile = TileOfPair(pair, "left", block().of("a1"), camera(), Window(0, 0, *epipolar_shape(pair, "left")))
    shape = level_shape((camera().height, camera().width), level)
    at = level_to_full(np.stack(np.meshgrid(np.arange(shape[1]), np.arange(shape[0])), axis=-1), level)
    even = (0.2 * at[..., 0] + 0.25 * at[..., 1] + 20)[..., None].astype(np.float32)
    out = resample_tile(tile, tile.source, True, even[tile.source.slices])
    cols, rows = np.meshgrid(np.arange(8, out.shape[1] - 8), np.arange(8, out.shape[0] - 8))
    place = tile.view.to_photo(np.column_stack([cols.ravel(), rows.ravel()]).astype(float))
    deep_inside = ((place > 16) & (place < (camera().width - 17, camera().height - 17))).all(axis=1)
    expected = 0.2 * place[:, 0] + 0.25 * place[:, 1] + 20
    apart = (out[rows.ravel(), cols.ravel()] - expected)[deep_inside]
    assert len(apart) > 1000 and np.abs(apart).max() <= 0.51, "rounded to whole grey values, and nothing else"
    assert abs(apart.mean()) < 0.01


@pytest.mark.parametrize("size", [64, 100])
def test_tiles_of_a_level_make_up_the_whole(size):
    pair = next(p for p in choose_pairs(block(), PairChoice(), 0.08, level=1).pairs if p.name == "a1-a2")
    rows, cols = epipolar_shape(pair, "right")
    pixels = lowered(photograph("a2"), 1)

    def made(window):
        tile = TileOfPair(pair, "right", block().of("a2"), camera(), window)
        return resample_tile(tile, tile.source, True, None if tile.source.empty else pixels[tile.source.slices])

    whole = made(Window(0, 0, rows, cols))
    for row in range(0, rows, size):
        for col in range(0, cols, size):
            window = Window(row, col, min(size, rows - row), min(size, cols - col))
            np.testing.assert_array_equal(made(window), whole[window.slices])


def test_the_report_says_why_the_surface_is_coarser():
    found, ties = pairs_of(1.0), tie_points(1.0)
    said = report(block(), found, ties, deep())
    rows = float(np.median([pair.row_sigma for pair in found.pairs])) * 2 ** found.pairs[0].level
    assert found.pairs[0].level == 2
    assert any(f"homologous points lie {rows:.1f} px off their row" in text and "1/4 of their size" in text for text in said.losses)
    assert next(figure.value for figure in said.figures if figure.name == "level") == 2
    plain = report(block(), pairs_of(0.02), tie_points(0.02), deep())
    assert not any("do not fit together" in text for text in plain.warnings)
