"""Points of the cloud: which nodes are kept, that no order or tiling changes them, and what is said about them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.raster import MapGrid, Window, tiles_of
from orthomill.schemas.surface import Provenance, points_table
from orthomill.tasks.densification.ground_intersection import NodesOnGround
from orthomill.tasks.densification.points import PointCollector, points_bytes
from orthomill.tasks.densification.settings.surface_settings import PointThinning

GRID = MapGrid(west=100.0, north=500.0, cell=2.0, rows=12, cols=15)
WHOLE = Window(0, 0, 12, 15)
PAIR = EpipolarPair(
    name="a-b",
    left="a",
    right="b",
    rotation=((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    left_centre=(0, 0, 100),
    right_centre=(10, 0, 100),
    base=10,
    c=100,
    row0=0,
    left_col0=0,
    right_col0=0,
    rows=4,
    left_cols=4,
    right_cols=4,
    parallax_low=1,
    parallax_high=9,
    base_height=0.1,
    row_sigma=0.1,
)
PHOTOS = ("a", "b", "c", "d")


def pair(left: str, right: str) -> EpipolarPair:
    return PAIR.model_copy(update={"name": f"{left}-{right}", "left": left, "right": right})


PAIRS = (pair("a", "b"), pair("b", "c"), pair("c", "d"))


def nodes(seed: int, shape: tuple[int, int] = (20, 22)) -> NodesOnGround:
    """Nodes all over the grid and a little beyond, a tenth of them without a match."""
    rng = np.random.default_rng(seed)
    x, y = 98 + 34 * rng.random(shape), 502 - 28 * rng.random(shape)
    z = np.where(rng.random(shape) < 0.1, np.nan, rng.normal(50, 3, shape))
    # Coarse steps: equal standard errors occur, and their order must not matter to the result.
    return NodesOnGround(x, y, z, np.round(rng.random(shape), 1).astype(np.float32), np.ones(shape, np.float32))


def one(*places: tuple[float, float, float, float]) -> NodesOnGround:
    """Nodes at given x, y, z and sigma, in one row."""
    x, y, z, sigma = (np.array([column]) for column in zip(*places, strict=True))
    return NodesOnGround(x, y, z, sigma.astype(np.float32), np.ones(x.shape, np.float32))


def collected(clouds, window: Window = WHOLE, most: int = 2, provenance: np.ndarray | None = None, accepted=None):
    collector = PointCollector(GRID, window, PHOTOS, PointThinning(most_per_cell=most))
    for number, cloud in enumerate(clouds):
        collector.add(number, PAIRS[number], cloud, np.ones(cloud.z.shape, bool) if accepted is None else accepted[number])
    codes = np.full(GRID.shape, Provenance.AGREED, np.uint8) if provenance is None else provenance
    return collector.points(codes[window.slices])


def plainly(clouds, most: int) -> list[tuple]:
    """The same by sorting: (row, col, sigma, pair, node) in ascending order, the first of every cell."""
    rows = []
    for number, cloud in enumerate(clouds):
        for node, (x, y, z, sigma) in enumerate(
            zip(cloud.x.ravel(), cloud.y.ravel(), cloud.z.ravel(), cloud.sigma.ravel(), strict=True)
        ):
            r, c = int(np.floor((500 - y) / 2)), int(np.floor((x - 100) / 2))
            if np.isfinite(z) and 0 <= r < 12 and 0 <= c < 15:
                rows.append((r, c, sigma, number, node, x, y, z))
    kept, count = [], {}
    for row in sorted(rows):
        count[row[:2]] = count.get(row[:2], 0) + 1
        if count[row[:2]] <= most:
            kept.append(row)
    return kept


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.integers(1, 4))
def test_the_best_nodes_of_every_cell_are_kept_as_sorting_would(seed, most):
    clouds = [nodes(seed + k) for k in range(3)]
    made, expected = collected(clouds, most=most), plainly(clouds, most)
    assert [(x, y, z) for x, y, z in zip(made.x, made.y, made.z, strict=True)] == [row[5:] for row in expected]
    assert made.source.tolist() == [row[3] + 1 for row in expected]
    assert made.sigma.tolist() == [row[2] for row in expected]


@pytest.mark.parametrize("size", [(5, 4), (12, 7)])
def test_tiles_together_give_the_points_of_one_piece(size):
    clouds = [nodes(k) for k in range(3)]
    whole = collected(clouds)
    parts = [collected(clouds, tile.window) for tile in tiles_of(GRID.shape, size)]
    together = sorted(
        (x, y, z, s, r, p) for t in parts for x, y, z, s, r, p in zip(t.x, t.y, t.z, t.sigma, t.rays, t.source, strict=True)
    )
    alone = sorted(zip(whole.x, whole.y, whole.z, whole.sigma, whole.rays, whole.source, strict=True))
    assert together == alone


def test_only_accepted_nodes_become_points():
    cloud = one((101, 499, 1, 0.1), (103, 499, 2, 0.1), (105, 499, 3, 0.1))
    made = collected([cloud], accepted=[np.array([[True, False, True]])])
    assert made.z.tolist() == [1, 3]


def test_rays_are_the_photographs_that_measured_in_the_cell():
    """Three pairs of four photographs in one cell, of which one point is kept; a lone pair in another."""
    here = [one((101, 499, 1, 0.2)), one((101.5, 499.5, 1, 0.1), (111, 499, 1, 0.1)), one((100.5, 498.5, 1, 0.3))]
    made = collected(here, most=1)
    assert made.rays.tolist() == [4, 2] and made.source.tolist() == [2, 2]


def test_more_photographs_than_a_word_has_bits():
    names = tuple(f"p{k}" for k in range(130))
    collector = PointCollector(GRID, WHOLE, names, PointThinning())
    for number in range(129):
        collector.add(number, pair(names[number], names[number + 1]), one((101, 499, 1, 0.1)), np.ones((1, 1), bool))
    made = collector.points(np.zeros(GRID.shape, np.uint8))
    assert made.rays.tolist() == [130, 130] and made.source.tolist() == [1, 2]


def test_the_code_is_that_of_the_cell_unless_the_cell_is_not_measured():
    codes = np.full(GRID.shape, Provenance.VOLUME, np.uint8)
    codes[0, 1], codes[0, 2] = Provenance.INCOHERENT, Provenance.EMPTY
    made = collected([one((101, 499, 1, 0.1), (103, 499, 1, 0.1), (105, 499, 1, 0.1))], provenance=codes)
    assert made.code.tolist() == [Provenance.VOLUME, Provenance.ONE_PAIR, Provenance.ONE_PAIR]


def test_a_tile_without_nodes_has_no_points():
    made = collected([replace(nodes(1), z=np.full((20, 22), np.nan))])
    assert len(made) == 0 and made.x.dtype == np.float64 and made.sigma.dtype == np.float32 and made.source.dtype == np.uint16


def test_memory_grows_with_cells_and_kept_nodes_only():
    few, many = points_bytes(WHOLE, 4, PointThinning(most_per_cell=1)), points_bytes(WHOLE, 4, PointThinning(most_per_cell=8))
    assert few < many < 9 * few and points_bytes(WHOLE, 64, PointThinning()) == points_bytes(WHOLE, 4, PointThinning())


def test_the_table_of_a_tile_is_named_after_it():
    assert points_table(3, 4).path == "densification/points/3-4.parquet"
