"""The simulation of clusters: cases whose outcome is known without it."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.scale.job_counts import IN_SHEETS, OF_LEVELS, GoesBy, Spread, spread_of
from benchmarks.scale.recorded_layout import (
    BY_PHOTOGRAPH,
    GROWING,
    JOINING,
    LISTED,
    MORE_EACH,
    Layout,
    RasterFile,
    enlarged,
    with_parts,
)
from benchmarks.scale.simulated_cluster import Cluster, Jobs, simulated
from orthomill.pipeline.export.file_parts import in_parts
from orthomill.schemas.job import Export, Job, Raster
from orthomill.schemas.raster import RasterSpec, tiles_of
from orthomill.tasks.accuracy.promises import disjoint_photographs
from orthomill.tasks.colouring.balance.balancing import balanced_block
from orthomill.tasks.densification.precision.tie_points import tie_counts
from orthomill.tasks.densification.volume.volume_square import solve_square
from orthomill.tasks.epipolar.measured_pairs import measured_pairs
from orthomill.tasks.orientation.exterior.adjusted_block import orient_block
from orthomill.tasks.orientation.relative.pairs import relate_pairs
from orthomill.tasks.photos.index import index_photos
from orthomill.tasks.terrain.contours.joined_contours import join_contours

IDEAL = Cluster(1, dispatch=0.0, engine=0.0, latency=0.0)


def jobs_of(seconds: list[float], *before: tuple[int, ...]) -> Jobs:
    """Jobs that read and write nothing; `before`: those that each one waits for."""
    waits = [*before, *[()] * (len(seconds) - len(before))]
    count = np.zeros(len(seconds), int)
    first = np.concatenate(([0], np.cumsum([len(one) for one in waits])))
    after = np.array([one for found in waits for one in found], int)
    return Jobs(np.array(seconds), count, count, count * 1.0, first, after, count > 0)


def layout_of(jobs: Jobs, once: list[bool]) -> Layout:
    """A block of 10 Mpx in two photographs; what is not made once goes by squares of the map that are whole tiles."""
    goes = np.where(once, int(GoesBy.ONCE), int(GoesBy.TILE_OF_MAP))
    spread = Spread(goes, *np.ones((4, len(once))))
    return Layout(10.0, 2, 512, jobs, spread, 0.0, np.ones(len(once)), np.zeros(len(once), bool))


def test_independent_jobs_share_the_workers():
    outcome = simulated(jobs_of([2.0] * 12), IDEAL._replace(workers=4))
    assert outcome.clock == 6.0 and outcome.efficiency(4) == 1.0


def test_a_chain_takes_the_sum_whatever_the_workers():
    assert simulated(jobs_of([1.0, 2.0, 3.0], (), (0,), (1,)), IDEAL._replace(workers=9)).clock == 6.0


def test_many_short_jobs_take_as_long_as_the_scheduler_needs():
    outcome = simulated(jobs_of([0.01] * 100), IDEAL._replace(workers=100, dispatch=0.1))
    assert outcome.clock == pytest.approx(100 * 0.1 + 0.01) and outcome.busy == pytest.approx(1.0, abs=0.01)


def test_short_jobs_that_go_together_share_what_the_scheduler_does():
    cluster = IDEAL._replace(workers=100, dispatch=0.1, together=0.05)
    assert simulated(jobs_of([0.01] * 100), cluster).clock == pytest.approx(100 * 0.1 / 5 + 0.01)
    assert simulated(jobs_of([1.0] * 100), cluster).clock == pytest.approx(100 * 0.1 + 1.0)


def test_what_the_scheduler_does_not_hold_cannot_begin():
    # The first holds up the others; with two places only one of those that could run is known to the scheduler.
    jobs = jobs_of([10.0, 1.0, 1.0, 1.0], (), (0,), (0,), ())
    assert simulated(jobs, IDEAL._replace(workers=2, held=4)).clock == 11.0
    assert simulated(jobs, IDEAL._replace(workers=2, held=2)).clock == 12.0


def test_requests_take_their_time_and_refused_ones_more():
    jobs = jobs_of([1.0])._replace(reads=np.array([3]), writes=np.array([1]), bytes=np.array([50.0]))
    cluster = IDEAL._replace(latency=0.5, bandwidth=100.0, at_once=1)
    assert simulated(jobs, cluster).clock == 1.0 + 4 * 0.5 + 0.5
    assert simulated(jobs, cluster._replace(refused=1.0, pause=2.0)).clock == 3.5 + 4 * 2.0
    assert simulated(jobs, cluster._replace(at_once=8)).clock == 1.0 + 2 * 0.5 + 0.5
    assert simulated(jobs._replace(streamed=np.array([True])), cluster._replace(at_once=8)).clock == 3.5


def test_workers_that_are_taken_away_do_their_jobs_anew():
    jobs, calm = jobs_of([10.0] * 400), IDEAL._replace(workers=10)
    stormy = simulated(jobs, calm._replace(life=100.0, absence=5.0))
    # One job in ten is cut off (1 - exp(-0.1)), in its middle on average: half of its time and the absence are lost.
    assert stormy.clock / simulated(jobs, calm).clock == pytest.approx(1 + 0.095 * (0.5 + 0.5), abs=0.04)
    assert stormy == simulated(jobs, calm._replace(life=100.0, absence=5.0)) and stormy.lost > 0


def test_a_job_longer_than_its_workers_live_begins_anew_again_and_again_until_it_is_given_up():
    stormy = IDEAL._replace(workers=10, life=10.0, absence=0.0)
    # A job as long as a worker lives on average takes (e - 1) of its time until one lives long enough.
    assert simulated(jobs_of([10.0] * 4000), stormy._replace(workers=1)).clock / 40e3 == pytest.approx(np.e - 1, rel=0.1)
    assert simulated(jobs_of([10.0] * 4000), stormy).given_up == 0
    assert simulated(jobs_of([1000.0]), stormy).given_up == 1


def test_what_has_an_end_does_not_grow_with_the_project():
    layout = layout_of(jobs_of([1.0, 10.0], (), (0,)), [False, True])
    bounded, partly = (replace(layout, growing=np.array([1.0, share])) for share in (0.0, 0.5))
    clocks = [simulated(enlarged(one, 40.0, 8, 512), IDEAL._replace(workers=4)).clock for one in (layout, bounded, partly)]
    assert clocks == [41.0, 11.0, 26.0]


def test_what_sees_no_pixels_grows_with_the_photographs():
    layout = layout_of(jobs_of([1.0, 10.0], (), (0,)), [False, True])
    adjusted = replace(layout, by_photograph=np.array([False, True]))
    for photographs, seconds in ((2, 10.0), (3, 10.0 * 1.5 * 1.5), (8, 10.0 * 4 * MORE_EACH)):
        assert enlarged(adjusted, 4000.0, photographs, 512).seconds.max() == seconds
    assert enlarged(layout, 4000.0, 8, 512).seconds.max() == 4000.0


def test_functions_that_are_known_not_to_grow_are_functions():
    assert hasattr(disjoint_photographs, next(iter(GROWING))) and {join_contours.__name__, tie_counts.__name__} == IN_SHEETS
    by_photograph = {orient_block, relate_pairs, index_photos, measured_pairs, balanced_block}
    assert {one.__name__ for one in by_photograph} == BY_PHOTOGRAPH and set(GROWING) & BY_PHOTOGRAPH == {balanced_block.__name__}


def test_a_project_of_four_blocks_waits_for_what_is_made_once():
    """Two tiles, one adjustment of both, two tiles that wait for it."""
    jobs = jobs_of([1.0, 1.0, 4.0, 1.0, 1.0], (), (), (0, 1), (2, 0), (2, 1))
    layout = layout_of(jobs, [False, False, True, False, False])
    whole = enlarged(layout, 40.0, 8, 512)
    assert len(whole.seconds) == 4 * 4 + 1 and whole.seconds.sum() == 4 * jobs.seconds.sum()
    assert simulated(whole, IDEAL._replace(workers=8)).clock == 1.0 + 16.0 + 1.0
    larger = enlarged(layout, 40.0, 8, 1024)
    assert len(larger.seconds) == 5 and larger.seconds.sum() == whole.seconds.sum()


def test_a_large_file_is_a_part_for_each_block_and_a_job_that_joins_them():
    """A tile, a file of it, and a job that reads the file."""
    jobs = jobs_of([1.0, 10.0, 1.0], (), (0,), (1,))
    layout = layout_of(jobs, [False, True, True])
    assert simulated(enlarged(layout, 40.0, 8, 512), IDEAL._replace(workers=8)).clock == 1.0 + 40.0 + 4.0
    parted = enlarged(with_parts(layout, np.array([False, True, False])), 40.0, 8, 512)
    assert simulated(parted, IDEAL._replace(workers=8)).clock == pytest.approx(1.0 + 10.0 + 40.0 * JOINING + 4.0)


def test_a_very_large_file_is_sheets_that_nobody_joins_and_as_many_as_the_planner_counts():
    """A tile, a file of it that goes in parts, and a job that reads the file; 100 times the ground."""
    spec = RasterSpec(name="d/z", shape=(5000, 7000), dtype="float32", chunk=500)
    export = Export("d", "file", "products/z.tif", "cog", {"z": spec.name})
    parted = np.array([False, True, False])
    layout = with_parts(layout_of(jobs_of([1.0, 10.0, 1.0], (), (0,), (1,)), [False, True, True]), parted)
    file = RasterFile(1, 3, *spec.shape, spec.bytes_of(spec.full))
    layout = replace(layout, growing=np.array([1.0, 1.0, 0.0, 1.0]), files=(file,))
    large = spec.model_copy(update={"shape": (50_000, 70_000)})
    assert len(list(in_parts(export, {spec.name: large}, 13e9))) == 4 * 5 + 1
    for above, files, clock in ((13e9, 20, 1.0 + 1000.0 / 20 + LISTED + 1.0), (15e9, 100, 1.0 + 10.0 + JOINING * 1000.0 + 1.0)):
        found = enlarged(replace(layout, sheets_above=above), 1000.0, 200, 512)
        assert len(found.seconds) == 100 + files + 2
        assert simulated(found, IDEAL._replace(workers=100)).clock == pytest.approx(clock)


def test_what_does_not_go_by_the_tile_is_counted_by_photographs_and_squares():
    goes = np.array([GoesBy.ONCE, GoesBy.PHOTOGRAPH, GoesBy.SQUARE, GoesBy.TILE_OF_PHOTOGRAPH, GoesBy.TILE_OF_MAP])
    spread = Spread(goes, np.array([1, 6, 30, 20, 30]), np.array([1, 1, 1, 4.5, 4.2]), np.array([1, 1, 1, 3.5, 5.9]), np.ones(5))
    np.testing.assert_allclose(spread.numbers(1.0, 1.0, 1.0), [1, 1, 1, 1, 1])
    # Tiles of four times the side: 2 x 1 instead of 20 for a photograph, 2 x 2 instead of 30 for the map.
    np.testing.assert_allclose(spread.numbers(1.0, 1.0, 4.0), [1, 1, 1, 2 / 20, 4 / 30])
    # 16 times the pixels in four times the photographs, each of which is twice as long and wide.
    np.testing.assert_allclose(spread.numbers(16.0, 4.0, 1.0), [1, 4, 16, 4 * 9 * 7 / 20, 17 * 24 / 30])


def test_a_large_tile_waits_for_all_squares_below_it():
    """A square, a tile that reads it, and what is made once of all tiles; 16 times the ground, tiles of twice the side."""
    layout = layout_of(jobs_of([1.0, 2.0, 3.0], (), (0,), (1,)), [False, False, True])
    spread = replace(layout.spread, goes=np.array([GoesBy.SQUARE, GoesBy.TILE_OF_MAP, GoesBy.ONCE]))
    found = enlarged(replace(layout, spread=spread), 160.0, 2, 1024)
    assert len(found.seconds) == 16 + 4 + 1 and found.seconds.sum() == pytest.approx(16 * 6.0)
    waiting = [found.before[found.first[n] : found.first[n + 1]].tolist() for n in range(21)]
    assert waiting[16:] == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10, 11], [12, 13, 14, 15], [16, 17, 18, 19]]


def planned(function: Callable[..., object], item: str, row: int = 0) -> SimpleNamespace:
    return SimpleNamespace(job=Job("tiles", item, function, {}, {}, row=row))


def test_the_plan_with_larger_tiles_tells_what_the_number_of_jobs_goes_by():
    def square() -> None: ...
    def tile() -> None: ...
    def level() -> None: ...
    def photograph() -> None: ...
    def adjust() -> None: ...

    def plan(tiles: int) -> list[SimpleNamespace]:
        by_tile = [planned(tile, "map", row) for row in range(tiles)]
        levels = [planned(level, name, row) for name in "ab" for row in range(tiles)]
        squares = [planned(square, "square", row) for row in range(6)]
        return [*by_tile, *levels, *squares, *(planned(photograph, name) for name in "ab"), planned(adjust, "block")]

    small, large = plan(4), plan(1)
    spread = spread_of(small, large)
    expected = (
        [GoesBy.TILE_OF_MAP] * 4 + [GoesBy.TILE_OF_PHOTOGRAPH] * 8 + [GoesBy.SQUARE] * 6 + [GoesBy.PHOTOGRAPH] * 2 + [GoesBy.ONCE]
    )
    assert spread.goes.tolist() == expected
    assert spread.numbers(1.0, 1.0, 4.0).sum() == pytest.approx(len(large))


def test_levels_that_cover_the_map_go_by_its_tiles():
    assert {solve_square.__name__} == OF_LEVELS
    small = [planned(solve_square, f"volume {level}", row) for level, squares in ((1, 2), (0, 8)) for row in range(squares)]
    large = [planned(solve_square, f"volume {level}", row) for level, squares in ((1, 1), (0, 2)) for row in range(squares)]
    spread = spread_of(small, large)
    assert set(spread.goes.tolist()) == {GoesBy.TILE_OF_MAP}


def test_levels_have_tiles_of_their_own_which_have_a_least_side():
    def level(number: int, extent: int, side: int) -> list[SimpleNamespace]:
        spec = RasterSpec(name=f"volume/{number}", shape=(extent, extent), dtype="float32", chunk=side)
        jobs = []
        for tile in tiles_of(spec.shape, side):
            writes = {"height": Raster(spec.name, tile.window)}
            jobs.append(Job("tiles", spec.name, solve_square, {}, writes, row=tile.row, col=tile.col))
        return [SimpleNamespace(job=job) for job in jobs]

    def plan(side: int) -> list[SimpleNamespace]:
        return [one for number, extent in enumerate((2300, 1150, 575)) for one in level(number, extent, max(side >> number, 256))]

    spread = spread_of(plan(512), plan(2048))
    assert [len(plan(side)) for side in (512, 1024, 2048)] == [25 + 25 + 9, 9 + 9 + 9, 4 + 4 + 4]
    assert [round(spread.numbers(1.0, 1.0, side / 512).sum()) for side in (512, 1024, 2048)] == [59, 27, 12]
