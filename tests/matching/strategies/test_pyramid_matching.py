"""Coarse-to-fine matching: a surface without seeds, outcomes where it fails, and results that do not depend on the tiling."""

import numpy as np
import pytest

from benchmarks.matching.dissertation_pair import NOISY, PairCrop, ground_texture, pair_crop
from benchmarks.matching.dissertation_surface import true_matches
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window
from orthomill.tasks.matching.strategies.coarse_to_fine import SearchRange, halo, halved_part, match_pyramid
from orthomill.tasks.matching.strategies.node_grid import ImagePart, NodeGrid
from orthomill.tasks.matching.strategies.pyramid_settings import PyramidMatching

SETTINGS = PyramidMatching(levels=3)
NARROW = PyramidMatching(levels=2, wide_window=21)
MARGIN = 24


@pytest.fixture(scope="module")
def crop() -> PairCrop:
    return pair_crop(ground_texture(), Window(5200, 6000, 1040, 1000), MARGIN, NOISY)


def part(pixels: np.ndarray, origin: tuple[int, int], unit: int = 8) -> ImagePart:
    """The image in the pixels of the crop; what lies before the first multiple of the levels' unit is cut off."""
    col, row = (-value % unit for value in origin)
    return ImagePart(pixels[row:, col:], origin[0] + col, origin[1] + row)


@pytest.fixture(scope="module")
def parts(crop) -> tuple[ImagePart, ImagePart]:
    return part(crop.left, crop.left_origin), part(crop.right, crop.right_origin)


def search_range(grid: NodeGrid) -> SearchRange:
    offsets = true_matches(grid.points()) - grid.points()
    (col_low, row_low), (col_high, row_high) = offsets.min(axis=0) - 15, offsets.max(axis=0) + 15
    return SearchRange(col_low, col_high, row_low, row_high)


def test_the_surface_is_found_without_seeds(parts):
    grid = NodeGrid.within(parts[0], 8, margin=10)
    found = match_pyramid(*parts, grid, search_range(grid), SETTINGS)
    errors = np.abs(found.position - true_matches(grid.points()))[found.converged]
    assert found.converged.mean() > 0.97
    assert np.median(errors[:, 0]) < 0.06
    assert (errors[:, 0] > 0.5).mean() < 0.002


def test_a_part_with_its_halo_gives_what_the_whole_gives(parts):
    left, right = parts
    whole_grid = NodeGrid.within(left, 8, margin=10)
    search = search_range(whole_grid)
    core = NodeGrid(whole_grid.row + 48, whole_grid.col + 50, 22, 19, 8)
    reach = halo(NARROW, 8)
    first_row, first_col = (max(8 * node - reach, start) // 8 * 8 for node, start in ((core.row, left.row), (core.col, left.col)))
    last_row, last_col = 8 * (core.row + core.rows) + reach, 8 * (core.col + core.cols) + reach
    cut = ImagePart(
        left.pixels[first_row - left.row : last_row - left.row, first_col - left.col : last_col - left.col], first_col, first_row
    )
    assert cut.pixels.size < 0.8 * left.pixels.size
    moved_right = ImagePart(right.pixels[16:, 8:], right.col + 8, right.row + 16)
    whole, alone = (
        match_pyramid(*pair, grid, search, NARROW) for pair, grid in (((left, right), whole_grid), ((cut, moved_right), core))
    )
    rows, cols = (slice(at, at + n) for at, n in ((48, 22), (50, 19)))
    for name in ("col", "row", "covariance", "affine", "outcome"):
        table = getattr(whole, name)
        expected = table.reshape(*whole_grid.shape, *table.shape[1:])[rows, cols].reshape(-1, *table.shape[1:])
        assert np.array_equal(getattr(alone, name), expected, equal_nan=True), name


def test_what_cannot_be_matched_has_an_outcome_and_no_position(parts):
    left, right = parts
    blank = left.pixels.copy()
    blank[400:700, 300:600] = 90
    blank[:200, :200] = 0
    grid = NodeGrid.within(left, 8, margin=10)
    found = match_pyramid(ImagePart(blank, left.col, left.row), right, grid, search_range(grid), SETTINGS)
    inside = ((grid.points() - left.origin >= [320, 420]) & (grid.points() - left.origin < [580, 680])).all(axis=1)
    without = (grid.points() - left.origin < 182).all(axis=1)
    assert not found.converged[inside | without].any()
    assert set(found.outcome[inside]) <= {Outcome.LOW_TEXTURE, Outcome.NOT_TRIED, Outcome.INCONSISTENT}
    assert np.isnan(found.position[~found.converged]).all()
    assert found.converged[~(inside | without)].mean() > 0.85


@pytest.mark.parametrize(
    "image",
    [
        np.full((300, 300), 80, np.uint8),
        np.zeros((300, 300), np.uint8),
        np.full((300, 300), np.nan, np.float32),
        np.full((40, 16), 7, np.uint8),
    ],
)
def test_empty_images_end_with_outcomes(image):
    grid = NodeGrid(0, 0, 12, 12, 8)
    found = match_pyramid(ImagePart(image), ImagePart(image), grid, SearchRange(-10, 10), SETTINGS)
    assert not found.converged.any() and np.isnan(found.position).all()


def test_origins_off_the_lattice_of_the_levels_are_refused():
    image = ImagePart(np.zeros((64, 64), np.uint8), 4, 0)
    with pytest.raises(ValueError, match="multiples of 8"):
        match_pyramid(image, image, NodeGrid(0, 1, 2, 2, 8), SearchRange(0, 0), SETTINGS)


def test_levels_keep_to_the_lattice_of_the_photograph():
    image = np.arange(1, 65, dtype=np.uint8).reshape(8, 8)
    cut = halved_part(ImagePart(image[2:, 4:], 4, 2))
    whole = halved_part(ImagePart(image))
    assert (cut.col, cut.row) == (2, 1)
    assert np.array_equal(cut.pixels, whole.pixels[1:, 2:])


def test_search_range_is_covered():
    offsets = SearchRange(-10, 20, -4, 4).offsets(6.0)
    assert len(offsets) == 5 * 2
    for point in ([-10, -4], [20, 4], [3, 0]):
        assert np.abs(offsets - point).max(axis=1).min() <= 3.0
