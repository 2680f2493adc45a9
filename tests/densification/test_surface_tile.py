"""One tile of the surface from pairs whose heights can be written down."""

import numpy as np
import pytest
from village_pair import LEVEL_GRID, level_nodes, level_pair, surface_tile

from orthomill.schemas.raster import Window
from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.height_differences import EVEN_REACH
from orthomill.tasks.densification.height_stack import REACH as STACK_REACH
from orthomill.tasks.densification.precision.estimate_errors import GUESS_REACH
from orthomill.tasks.densification.precision.pair_differences import NO_DIFFERENCES, factors
from orthomill.tasks.densification.precision.standard_errors import REACH
from orthomill.tasks.densification.settings.surface_settings import (
    Completion,
    EstimateGaps,
    Fusion,
    Gridding,
    MeasuredOnly,
    PointThinning,
    SpikeFilter,
)
from orthomill.tasks.densification.surface_grid import ground_pixel
from orthomill.tasks.densification.surface_tile import (
    CLASSES,
    SurfaceRules,
    SurfaceStatistics,
    make_surface,
    sum_surface,
    surface_scratch,
)
from orthomill.tasks.densification.volume.quality import Judgement

MEASURED_ONLY = MeasuredOnly(kind="none")


def rules_of(spikes=None, fill=MEASURED_ONLY) -> SurfaceRules:
    return SurfaceRules(Gridding(), Fusion(), Completion(), spikes or SpikeFilter(), fill, PointThinning())


RULES = rules_of()
SHARE, COMMON = float(factors(NO_DIFFERENCES)[0, 0]), 0.4
"""of the standard error that matching states of one pair, on even ground: what it is worth, and what all pairs have in common"""


def surface_of_tile(tile, rules, nodes=(), volume=None):
    """The tile over a volume, by default one that knows no heights and no rivals of any."""
    if volume is None:
        volume = VolumeWindow.unknown(tile.work.shape)
        volume.judgement[..., Judgement.DISTINCTIVENESS] = 250
    return make_surface(tile, rules, *volume, iter(nodes))


def made(*heights, rules=RULES, sigma=0.1, **changes):
    """The tile of level pairs, one for each height."""
    pairs = [level_pair(f"p{k}", **changes) for k in range(len(heights))]
    tile = surface_tile(*pairs)
    nodes = tuple(level_nodes(piece.pair, z, piece.nodes, sigma) for piece, z in zip(tile.pieces, heights, strict=True))
    return surface_of_tile(tile, rules, nodes)


def test_level_ground_is_level_everywhere():
    cells = made(12.5)
    assert np.allclose(cells.height, 12.5, atol=1e-3)
    assert (cells.provenance == Provenance.ONE_PAIR).all() and (cells.pairs == 1).all()
    assert cells.height.dtype == cells.precision.dtype == np.float32 and cells.pairs.dtype == np.uint8


def test_the_precision_is_height_over_base_times_ground_pixel_times_parallax_error():
    """sigma_Z = (H / B) (H / c) sigma_p, with H the height above the ground (Karfis 2009, 1.21); a share of it between nodes."""
    pair = level_pair()
    depth = pair.left_centre[2] - 12.5
    expected = np.hypot(1, COMMON) * SHARE * depth / pair.base * depth / pair.c * 0.2
    assert made(12.5, sigma=0.2).precision == pytest.approx(expected, rel=1e-3)


def test_two_pairs_that_agree_halve_the_variance_but_for_what_they_have_in_common():
    one, two = made(12.5), made(12.5, 12.5)
    left = (1 / 2 + COMMON**2) / (1 + COMMON**2)
    assert two.precision == pytest.approx(one.precision * np.sqrt(left), rel=1e-3)
    assert (two.provenance == Provenance.AGREED).all() and (two.pairs == 2).all()


def test_what_the_orientation_does_to_all_pairs_is_not_averaged_out():
    sigma = 0.5
    cells = made(12.5, 12.5, height_sigmas=(sigma,) * 9)
    alone = made(12.5, 12.5)
    assert cells.precision == pytest.approx(np.hypot(alone.precision, sigma), rel=1e-3)
    assert np.array_equal(cells.height, alone.height)


def test_pairs_that_contradict_each_other_are_disputed():
    cells = made(12.5, 30.0)
    assert (cells.provenance == Provenance.DISPUTED).all() and (cells.pairs == 1).all()


def test_without_pairs_the_tile_is_empty():
    cells = surface_of_tile(surface_tile(), RULES)
    assert np.isnan(cells.height).all() and np.isnan(cells.precision).all()
    assert (
        cells.statistics.provenance == (LEVEL_GRID.rows * LEVEL_GRID.cols, *[0] * (len(Provenance) - 1))
        and cells.statistics.lowest is None
    )


def test_heights_beyond_the_bounds_of_the_surface_are_not_believed():
    assert np.isnan(made(80.0).height).all()


def test_a_window_of_the_tile_is_a_window_of_the_whole():
    pair, part = level_pair(), Window(8, 12, 10, 9)
    tile = surface_tile(pair, window=part, work=part.grown(RULES.halo).clipped(LEVEL_GRID.shape))
    rng = np.random.default_rng(3)
    whole = surface_tile(pair)
    bumpy = level_nodes(pair, 10.0, whole.pieces[0].nodes)
    bumpy[..., 0] += rng.normal(0, 0.4, bumpy.shape[:2]).astype(np.float32)
    first, inner = whole.pieces[0].nodes, tile.pieces[0].nodes
    shifted = Window(inner.row - first.row, inner.col - first.col, *inner.shape)
    one, all_ = surface_of_tile(tile, RULES, (bumpy[shifted.slices],)), surface_of_tile(whole, RULES, (bumpy,))
    assert np.array_equal(one.height, all_.height[part.slices], equal_nan=True)
    assert np.array_equal(one.precision, all_.precision[part.slices], equal_nan=True)


def spiky(rules):
    """Level ground with a patch of two by two wrong nodes 44 m above it, and a gap of four nodes a side."""
    tile = surface_tile(level_pair())
    nodes = level_nodes(level_pair(), 10.0, tile.pieces[0].nodes)
    rows, cols = nodes.shape[:2]
    nodes[rows // 2 - 6 : rows // 2 - 4, cols // 2 : cols // 2 + 2, 0] += 40.0
    nodes[rows // 2 + 2 : rows // 2 + 6, cols // 2 : cols // 2 + 4] = np.nan
    return surface_of_tile(tile, rules, (nodes,))


def test_spikes_are_counted_and_emptied():
    cells = spiky(RULES)
    kept = spiky(rules_of(SpikeFilter(rounds=0, far_radius=0.0)))
    assert np.nanmax(cells.height) < 11 < 45 < np.nanmax(kept.height)
    assert cells.statistics.spikes == np.isnan(cells.height).sum() - np.isnan(kept.height).sum() > 0


def test_gaps_are_filled_on_request_with_their_own_code():
    gap = np.isnan(spiky(RULES).height)
    filled = spiky(rules_of(fill=EstimateGaps(max_gap=30)))
    assert gap.any() and (filled.provenance[gap] == Provenance.INTERPOLATED).all()
    assert filled.height[gap] == pytest.approx(10.0, abs=0.05) and (filled.pairs[gap] == 0).all()


def test_the_statistics_count_the_cells():
    cells = made(12.5, 12.5)
    known = LEVEL_GRID.rows * LEVEL_GRID.cols
    assert cells.statistics.provenance == (0, 0, known, *[0] * (len(Provenance) - 3))
    assert sum(cells.statistics.precision) == known and len(cells.statistics.precision) == CLASSES
    index = int(cells.precision[0, 0] / (0.1 * LEVEL_GRID.cell))
    assert cells.statistics.precision[index] == known
    assert cells.statistics.lowest == pytest.approx(12.5, abs=1e-3) == cells.statistics.highest


def test_statistics_of_tiles_add_up():
    parts = (
        SurfaceStatistics(provenance=(1, 2, 3, 4, 5), precision=(7, *[0] * (CLASSES - 1)), spikes=2, lowest=3.0, highest=9.0),
        SurfaceStatistics(provenance=(10, 0, 0, 0, 1), precision=(1, *[0] * (CLASSES - 1)), spikes=1),
        SurfaceStatistics(provenance=(0, 1, 0, 0, 0), precision=(0, *[1] * (CLASSES - 1)), lowest=-2.0, highest=4.0),
    )
    total = sum_surface(parts)
    assert total.provenance == (11, 3, 3, 4, 6) and total.precision == (8, *[1] * (CLASSES - 1))
    assert (total.spikes, total.lowest, total.highest) == (3, -2.0, 9.0)
    assert sum_surface((SurfaceStatistics(),)).lowest is None


def test_the_halo_covers_every_filter():
    rules = rules_of(SpikeFilter(radius=3.0, rounds=2, far_radius=5.0))
    assert rules.halo == STACK_REACH + 3 * 2 + 5 + EVEN_REACH + GUESS_REACH + 1
    wide = rules_of(fill=EstimateGaps(max_gap=2 * GUESS_REACH))
    assert wide.halo - RULES.halo == REACH + GUESS_REACH


def test_memory_does_not_grow_with_the_pairs():
    one, two = surface_tile(level_pair()), surface_tile(level_pair(), level_pair("c-d"))
    assert 0 < surface_scratch((), one.work) < surface_scratch(one.pieces, one.work) == surface_scratch(two.pieces, two.work)


def test_nodes_are_a_ground_pixel_times_their_step_apart():
    pair = level_pair()
    assert ground_pixel(pair) == pytest.approx(pair.base / np.mean([pair.parallax_low, pair.parallax_high]))
    assert ground_pixel(pair) == pytest.approx(1040 / pair.c, rel=0.05)
