"""The whole stage on a rendered pair: surface against truth, tiles against the whole, the report."""

import numpy as np
import pytest
from memory_runner import MemoryProject
from scipy import ndimage
from village_pair import CELL, normal_case, render, village

from orthomill.schemas.epipolar import PAIRS, EpipolarPairs, epipolar_raster
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.raster import Window
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import COUNT, HEIGHT, PRECISION, PROVENANCE, SURFACE
from orthomill.tasks.densification.filling import Interpolate
from orthomill.tasks.densification.stage import DensificationStage, nodes_raster, outcome_raster
from orthomill.tasks.matching.dense.blocks import DenseMatching

STAGE = DensificationStage(matching=DenseMatching(step=4))


@pytest.fixture(scope="module")
def seen():
    scene, pair = village(620, 8, seed=4), normal_case(620)
    return scene, render(scene, pair)


def run(seen, stage=STAGE, tile=192, blank=False):
    engine, pair = MemoryProject(tile), seen[1].pair
    engine.tables[BLOCK.path] = Block(
        crs="EPSG:2100",
        cameras={},
        of_photo={},
        photos=(),
        datum="free",
        sigma0_px=0.3,
        redundancy=9,
        iterations=1,
        ground_low=-10.0,
        ground_high=15.0,
    )
    engine.tables[PAIRS.path] = EpipolarPairs(pairs=(pair,))
    for side, image in (("left", seen[1].left), ("right", seen[1].right)):
        engine.put(epipolar_raster(pair.name, side), np.zeros_like(image) if blank else image)
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
    ratio = (error / engine.rasters[PRECISION])[ground & known]
    assert 0.7 < 1.4826 * np.median(np.abs(ratio)) < 1.3


def test_rasters_agree_with_one_another(engine):
    known = np.isfinite(engine.rasters[HEIGHT])
    assert (np.isfinite(engine.rasters[PRECISION]) == known).all()
    assert ((engine.rasters[COUNT] > 0) == known).all() and ((engine.rasters[PROVENANCE] > 0) == known).all()
    assert (engine.rasters[nodes_raster("a-b")].shape[:2]) == engine.rasters[outcome_raster("a-b")].shape


def test_any_tile_size_gives_the_same_bits(seen, engine):
    whole = run(seen, tile=1024)
    for name in (HEIGHT, PRECISION, COUNT, PROVENANCE):
        assert np.array_equal(engine.rasters[name], whole.rasters[name], equal_nan=True)


def test_filled_gaps_do_not_depend_on_tiles_either(seen):
    stage = STAGE.model_copy(update={"fill": Interpolate(kind="interpolate", max_gap=12.0)})
    parts, whole = run(seen, stage), run(seen, stage, tile=1024)
    assert (parts.rasters[PROVENANCE] == 4).any()
    assert np.array_equal(parts.rasters[HEIGHT], whole.rasters[HEIGHT], equal_nan=True)


def test_the_report_counts_what_the_rasters_hold(engine):
    report = engine.tables[report_table("densification").path]
    figures = {figure.name: figure.value for figure in report.figures}
    assert figures["cells_with_height"] == np.isfinite(engine.rasters[HEIGHT]).sum()
    assert figures["nodes_matched"] == np.isfinite(engine.rasters[nodes_raster("a-b")][..., 0]).sum()
    assert figures["share_one_pair"] == 1.0
    assert figures["precision_median"] == pytest.approx(np.nanmedian(engine.rasters[PRECISION]), abs=0.02)
    exported = [set(export.rasters.values()) for export in engine.exports.values()]
    assert {HEIGHT, PRECISION} in exported and {COUNT, PROVENANCE} in exported


def test_images_without_data_give_an_empty_surface_and_say_so(seen):
    empty = run(seen, blank=True)
    assert np.isnan(empty.rasters[HEIGHT]).all()
    assert any("empty" in warning for warning in empty.tables[report_table("densification").path].warnings)
