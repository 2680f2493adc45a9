"""The whole stage on a rendered pair: surface against truth, tiles against the whole, the report."""

from dataclasses import replace

import numpy as np
import pytest
from memory_runner import MemoryProject
from scipy import ndimage
from village_pair import CELL, block_of, height_errors, normal_case, photos_of, render, village

from orthomill.schemas.epipolar import PAIRS, EpipolarPairs, epipolar_raster
from orthomill.schemas.observations import GROUND_POINTS, GroundPoints
from orthomill.schemas.orientation import BLOCK as BLOCK_TABLE
from orthomill.schemas.photo import PHOTOS, photo_raster
from orthomill.schemas.raster import MapGrid, Window, tiles_of
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import (
    COUNT,
    DATUM_PRECISION,
    HEIGHT,
    MEASURED,
    PRECISION,
    PROVENANCE,
    RELATIVE_PRECISION,
    SURFACE,
    Provenance,
)
from orthomill.tasks.densification.matching_block import PairTile, match_pair_block, match_pair_tile, sum_matching
from orthomill.tasks.densification.plan import surface_jobs
from orthomill.tasks.densification.plan.densification_jobs import surface_rules
from orthomill.tasks.densification.plan.pair_jobs import nodes_raster, outcome_raster, pair_plan
from orthomill.tasks.densification.plan.surface_jobs import TIES, SurfacePlan
from orthomill.tasks.densification.plan.volume_jobs import JUDGED_HEIGHT
from orthomill.tasks.densification.settings.guide_settings import ConfidenceLimits, GuideFile
from orthomill.tasks.densification.settings.surface_settings import MeasuredOnly
from orthomill.tasks.densification.stage import DensificationStage, ObjectSpace
from orthomill.tasks.densification.surface_grid import GridWish, surface_of
from orthomill.tasks.densification.volume import volume_tile
from orthomill.tasks.densification.volume.terrain import terrain_grid
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.imagery.pyramid import halved
from orthomill.tasks.matching.dense.blocks import BLOCK
from orthomill.tasks.matching.dense.dense_settings import DenseMatching
from orthomill.tasks.matching.volume.height_volume import optimised

STAGE = DensificationStage(matching=ObjectSpace(pairs=DenseMatching(step=4)))


@pytest.fixture(scope="module")
def seen():
    scene, pair = village(620, 8, seed=4), normal_case(620)
    return scene, render(scene, pair)


def tie_points(height: np.ndarray) -> GroundPoints:
    """Every 31st place of the scene as a tie point."""
    row, col = (values.ravel() for values in np.meshgrid(*(np.arange(10, size, 31) for size in height.shape), indexing="ij"))
    none, rays = np.zeros(len(row), np.float32), np.full(len(row), 2, np.int16)
    return GroundPoints(np.arange(len(row)), CELL * col, -CELL * row, height[row, col], none, none, none, rays, none)


def run(seen, stage=STAGE, tile=192, blank=False, files=None):
    engine, pair = MemoryProject(tile, files=files or {}), seen[1].pair
    engine.tables[BLOCK_TABLE.path], engine.tables[PHOTOS.path] = block_of(pair), photos_of(pair)
    engine.tables[GROUND_POINTS.path] = tie_points(seen[0].height)
    engine.tables[PAIRS.path] = EpipolarPairs(pairs=(pair,))
    for name, side, image in ((pair.left, "left", seen[1].left), (pair.right, "right", seen[1].right)):
        pixels = np.zeros_like(image) if blank else image
        engine.put(epipolar_raster(pair.name, side), pixels)
        engine.put(photo_raster(name), pixels[..., None])
        engine.put(photo_raster(name, 1), halved(pixels[..., None]))
    engine.run(stage)
    return engine


@pytest.fixture(scope="module")
def engine(seen):
    return run(seen)


def test_the_surface_is_the_true_one(seen, engine):
    scene, grid, height = seen[0], engine.tables[SURFACE.path].grid, engine.rasters[HEIGHT]
    x, y = np.meshgrid(*grid.centres(Window(0, 0, *grid.shape)))
    row, col = -y / CELL, x / CELL
    inside = (col > 40) & (col < 580) & (row > 40) & (row < 580)
    truth = ndimage.map_coordinates(scene.height, [row, col], order=1, mode="nearest")
    marked = ndimage.map_coordinates((scene.roof | scene.blank).astype(float), [row, col], order=0, mode="nearest") > 0
    near = ndimage.binary_dilation(marked, iterations=12)
    error, known = height - truth, np.isfinite(height)
    ground = inside & ~near
    assert known[ground].mean() > 0.92
    assert 1.4826 * np.median(np.abs(error[ground & known])) < 0.35
    assert abs(np.median(error[ground & known])) < 0.1
    paired = np.isin(engine.rasters[PROVENANCE], (Provenance.ONE_PAIR, Provenance.AGREED))
    ratio = (error / engine.rasters[PRECISION])[ground & paired]
    assert 0.5 < 1.4826 * np.median(np.abs(ratio)) < 1.2


def test_rasters_agree_with_one_another(engine):
    known = np.isfinite(engine.rasters[HEIGHT])
    for name in (PRECISION, RELATIVE_PRECISION, DATUM_PRECISION):
        assert (np.isfinite(engine.rasters[name]) == known).all()
    code = engine.rasters[PROVENANCE]
    assert ((code > 0) == known).all()
    assert (engine.rasters[COUNT][np.isin(code, (Provenance.ONE_PAIR, Provenance.AGREED))] > 0).all()
    assert (engine.rasters[COUNT][np.isin(code, (Provenance.VOLUME, Provenance.EMPTY))] == 0).all()
    assert (engine.rasters[nodes_raster("a-b")].shape[:2]) == engine.rasters[outcome_raster("a-b")].shape


def test_every_cell_that_both_photographs_see_has_a_height(engine):
    grid, block = engine.tables[SURFACE.path].grid, engine.tables[BLOCK_TABLE.path]
    x, y = np.meshgrid(*grid.centres(Window(0, 0, *grid.shape)))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    views = [block_view(block, name) for name in block.names]
    seen = np.logical_and.reduce([view.contains(view.project(points), 12.0) for view in views]).reshape(grid.shape)
    assert seen.mean() > 0.5 and np.isfinite(engine.rasters[HEIGHT][seen]).all()


def test_the_standard_error_is_that_among_neighbours_and_that_of_the_datum(engine):
    total, among, datum = (engine.rasters[name] for name in (PRECISION, RELATIVE_PRECISION, DATUM_PRECISION))
    assert np.allclose(total, np.hypot(among, datum), equal_nan=True)


def test_any_tile_size_gives_the_same_bits(seen, engine):
    whole = run(seen, tile=1024)
    assert {Provenance.ONE_PAIR, Provenance.VOLUME, Provenance.INCOHERENT} <= set(np.unique(whole.rasters[PROVENANCE]))
    for name in (HEIGHT, PRECISION, RELATIVE_PRECISION, DATUM_PRECISION, COUNT, PROVENANCE):
        assert np.array_equal(engine.rasters[name], whole.rasters[name], equal_nan=True)


def test_tie_points_of_a_large_surface_are_looked_at_part_by_part_with_the_same_result(seen, engine, monkeypatch):
    whole = engine.tables[TIES.path]
    assert whole.points > 200 and sum(whole.distances) == whole.points
    assert sum(key[1] == "tie-points-of" for key in engine.keys) == 1, "most surfaces are one part"
    monkeypatch.setattr(surface_jobs, "SHEET", 200)
    plan = SurfacePlan("densification", "EPSG:2100", 96, surface_rules(STAGE))
    *parts, joined = plan._ties(engine.tables[SURFACE.path], (seen[1].pair,))
    assert len(parts) == 4 and all(len(job.params["windows"]) > 1 for job in parts)
    again = replace(
        engine, tables={path: one for path, one in engine.tables.items() if "tie_points/" not in path and path != TIES.path}
    )
    for job in (*parts, joined):
        again._execute(job)
    shares = [again.tables[f"densification/tie_points/{row}-{col}.json"].points for row in (0, 1) for col in (0, 1)]
    assert min(shares) > 0 and max(shares) < whole.points
    assert again.tables[TIES.path] == whole


def test_blocks_of_one_job_find_what_each_finds_alone(seen, engine):
    images, surface, settings = seen[1], engine.tables[SURFACE.path], STAGE.matching.pairs
    tile = PairTile.over(images.pair, Window(0, 0, 128, 100), settings.step, surface)
    assert [block.nodes.shape for block in tile.blocks] == [(64, 64), (64, 36)] * 2

    def found(part, match):
        read = (images.left[part.left.slices], images.right[part.right.slices], engine.rasters[JUDGED_HEIGHT][part.cells.slices])
        return match(part, settings, *read)

    together, alone = found(tile, match_pair_tile), [found(block, match_pair_block) for block in tile.blocks]
    for block, one in zip(tile.blocks, alone, strict=True):
        own = block.nodes.within(tile.nodes).slices
        assert np.array_equal(together.nodes[own], one.nodes, equal_nan=True) and np.isfinite(one.nodes).any()
        assert np.array_equal(together.outcome[own], one.outcome)
    assert together.statistics == sum_matching(tuple(one.statistics for one in alone))
    assert tile.scratch(settings) > max(block.scratch(settings) for block in tile.blocks)


def test_a_job_of_a_pair_takes_as_many_blocks_as_the_tile_of_the_project(seen, engine):
    pair, surface, settings = seen[1].pair, engine.tables[SURFACE.path], STAGE.matching.pairs
    for side, blocks in ((100, 1), (256, 1), (700, 2), (2048, 8)):
        spec, _, *jobs = pair_plan(pair, surface, settings, side, "densification")
        assert spec.chunk == blocks * BLOCK // settings.step
        assert len(jobs) == 1 + len(list(tiles_of(spec.shape, spec.chunk)))


def test_estimates_are_left_out_on_request_and_nothing_else_changes(seen, engine):
    only = run(seen, STAGE.model_copy(update={"fill": MeasuredOnly(kind="none")}))
    measured = np.isin(engine.rasters[PROVENANCE], MEASURED)
    assert (np.isfinite(only.rasters[HEIGHT]) == measured).all() and not measured.all()
    assert np.array_equal(only.rasters[HEIGHT][measured], engine.rasters[HEIGHT][measured])


def test_a_stricter_volume_measures_fewer_cells(seen, engine):
    strict = ObjectSpace(pairs=STAGE.matching.pairs, confidence=ConfidenceLimits(coherence=1.0, rival_spread=0.0))
    codes = run(seen, STAGE.model_copy(update={"matching": strict})).rasters[PROVENANCE]
    assert (codes == Provenance.VOLUME).sum() < (engine.rasters[PROVENANCE] == Provenance.VOLUME).sum()


def test_the_report_counts_what_the_rasters_hold(engine):
    report = engine.tables[report_table("densification").path]
    figures = {figure.name: figure.value for figure in report.figures}
    assert figures["cells_with_height"] == np.isfinite(engine.rasters[HEIGHT]).sum()
    assert figures["nodes_matched"] == np.isfinite(engine.rasters[nodes_raster("a-b")][..., 0]).sum()
    measured = np.isin(engine.rasters[PROVENANCE], MEASURED)
    assert figures["cells_measured"] == measured.sum() < figures["cells_with_height"]
    # The median comes from a histogram whose classes are a tenth of a cell wide.
    half_class = 0.05 * engine.tables[SURFACE.path].grid.cell
    assert figures["precision_median"] == pytest.approx(np.median(engine.rasters[RELATIVE_PRECISION][measured]), abs=half_class)
    exported = [set(export.rasters.values()) for export in engine.exports.values()]
    assert {HEIGHT, PRECISION, RELATIVE_PRECISION, DATUM_PRECISION} in exported and {COUNT, PROVENANCE} in exported


def test_blank_photographs_give_estimates_and_the_report_says_so(seen):
    empty = run(seen, blank=True)
    # Along the border of a photograph some heights leave it, which sets the others apart.
    assert np.isin(empty.rasters[PROVENANCE], MEASURED).mean() < 0.01
    assert any("estimates" in warning for warning in empty.tables[report_table("densification").path].warnings)


def coarse_model(seen) -> tuple[MapGrid, np.ndarray]:
    """Posts 32 cells apart with 1 m of noise."""
    grid = terrain_grid(
        surface_of(block_of(seen[1].pair), EpipolarPairs(pairs=(seen[1].pair,)), tie_points(seen[0].height), GridWish()).grid
    )
    x, y = np.meshgrid(*grid.centres(Window(0, 0, *grid.shape)))
    truth = ndimage.map_coordinates(seen[0].height, [-y / CELL, x / CELL], order=1, mode="nearest")
    return grid, (truth + np.random.default_rng(3).normal(0, 1.0, truth.shape)).astype(np.float32)


@pytest.mark.parametrize("reach", ["auto", 8.0])
def test_an_existing_model_bounds_the_heights_that_are_looked_for(seen, engine, reach, monkeypatch):
    """8 m are less than some towers rise: their roofs are lost, the ground is not."""
    counts: list[np.ndarray] = []

    def counted(images, pixels, choice, candidates, settings):
        counts.append(candidates.count)
        return optimised(images, pixels, choice, candidates, settings)

    monkeypatch.setattr(volume_tile, "optimised", counted)
    guide = {"guide": GuideFile(kind="file", path="dem.tif"), "reach": reach}
    stage = DensificationStage(matching=STAGE.matching.model_copy(update=guide))
    guided = run(seen, stage, files={"dem.tif": coarse_model(seen)})
    bounded = counts[0][counts[0] > 0].mean()
    counts.clear()
    run(seen)
    assert bounded < (0.8 if reach == "auto" else 0.5) * counts[0][counts[0] > 0].mean()
    measured = []
    for each in (engine, guided):
        error, ground = height_errors(seen[0], each.tables[SURFACE.path].grid, each.rasters[HEIGHT], 16)
        good = ground & np.isin(each.rasters[PROVENANCE], MEASURED)
        measured.append(good.sum())
        assert 1.4826 * np.median(np.abs(error[good])) < 0.1
    assert measured[1] > 0.97 * measured[0]
