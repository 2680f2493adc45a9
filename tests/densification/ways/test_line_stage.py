"""Vertical line locus through the stage: a rendered pair to a surface with codes and standard errors."""

import numpy as np
import pytest
from memory_runner import MemoryProject
from scipy import ndimage
from village_pair import CELL, block_of, height_errors, normal_case, photos_of, render, village

from orthomill.schemas.epipolar import PAIRS, EpipolarPairs
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.observations import GROUND_POINTS, GroundPoints
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.photo import PHOTOS, photo_raster
from orthomill.schemas.raster import Window
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import COUNT, HEIGHT, MEASURED, PRECISION, PROVENANCE, SURFACE, Provenance
from orthomill.tasks.densification.line_locus.node_markers import BLACK, MARKERS, WHITE
from orthomill.tasks.densification.plan.line_jobs import LINE_NODES, LINE_OUTCOME
from orthomill.tasks.densification.plan.volume_jobs import TERRAIN
from orthomill.tasks.densification.settings.guide_settings import GuideFile
from orthomill.tasks.densification.stage import DensificationStage, VerticalLineLocus
from orthomill.tasks.densification.volume.terrain import terrain_grid
from orthomill.tasks.imagery.pyramid import halved
from orthomill.tasks.matching.line_locus.height_search_settings import FixedThreshold

STAGE = DensificationStage(matching=VerticalLineLocus(kind="vertical_line_locus", window=15, block=48))


@pytest.fixture(scope="module")
def seen():
    scene, pair = village(420, 5, seed=4), normal_case(420)
    return scene, render(scene, pair)


def tie_points(height: np.ndarray) -> GroundPoints:
    row, col = (values.ravel() for values in np.meshgrid(*(np.arange(10, size, 31) for size in height.shape), indexing="ij"))
    none, rays = np.zeros(len(row), np.float32), np.full(len(row), 2, np.int16)
    return GroundPoints(np.arange(len(row)), CELL * col, -CELL * row, height[row, col], none, none, none, rays, none)


def run(seen, matching=STAGE.matching, tile=128, files=None):
    engine, pair = MemoryProject(tile, files=files or {}), seen[1].pair
    engine.tables[BLOCK.path], engine.tables[PHOTOS.path] = block_of(pair), photos_of(pair)
    engine.tables[GROUND_POINTS.path] = tie_points(seen[0].height)
    engine.tables[PAIRS.path] = EpipolarPairs(pairs=(pair,))
    for name, image in ((pair.left, seen[1].left), (pair.right, seen[1].right)):
        engine.put(photo_raster(name), image[..., None])
        engine.put(photo_raster(name, 1), halved(image[..., None]))
    engine.run(STAGE.model_copy(update={"matching": matching}))
    return engine


@pytest.fixture(scope="module")
def engine(seen):
    return run(seen)


def errors(seen, engine):
    """Height minus truth (rows, cols), and the cells of open ground."""
    return height_errors(seen[0], engine.tables[SURFACE.path].grid, engine.rasters[HEIGHT], 14)


def robust(values: np.ndarray) -> float:
    return float(1.4826 * np.median(np.abs(values)))


def test_the_surface_is_the_true_one_and_its_standard_errors_hold(seen, engine):
    error, ground = errors(seen, engine)
    measured = ground & np.isin(engine.rasters[PROVENANCE], MEASURED)
    assert measured.sum() > 0.9 * ground.sum()
    assert robust(error[measured]) < 0.2 and abs(np.median(error[measured])) < 0.05
    ratio = np.abs(error / engine.rasters[PRECISION])[measured]
    assert (ratio < 2).mean() > 0.9 and (ratio > 4).mean() < 0.01


def test_two_photographs_are_one_pair_and_what_was_rejected_is_an_estimate(engine):
    codes = engine.rasters[PROVENANCE]
    assert {Provenance.ONE_PAIR, Provenance.INTERPOLATED} <= set(np.unique(codes))
    assert not np.isin(codes, (Provenance.AGREED, Provenance.VOLUME)).any()
    assert (engine.rasters[COUNT] == (codes == Provenance.ONE_PAIR)).all()


def test_accepted_and_rejected_nodes_make_the_whole_grid_in_file_map_and_report(engine):
    """B-10 of sources/line_locus.md: accepted nodes are written and black, rejected ones white, and together they are all nodes."""
    outcome, nodes, markers = (engine.rasters[name] for name in (LINE_OUTCOME, LINE_NODES, MARKERS))
    factor = markers.shape[0] // outcome.shape[0]
    middle = markers[factor // 2 :: factor, factor // 2 :: factor]
    assert ((middle == BLACK) == (outcome == Outcome.CONVERGED)).all()
    assert (middle == BLACK).sum() + (middle == WHITE).sum() == outcome.size
    assert (np.isfinite(nodes[..., 0]) == (outcome == Outcome.CONVERGED)).all()
    assert len(np.unique(markers)) > 50, "the photograph is shown beneath the markers"
    figures = {figure.name: figure.value for figure in engine.tables[report_table("densification").path].figures}
    assert figures["nodes_matched"] == (outcome == Outcome.CONVERGED).sum()
    written = {export.format: export.rasters for export in engine.exports.values() if export.item in ("nodes", "markers")}
    assert written == {"xyz": {"nodes": LINE_NODES}, "cog": {"nodes": MARKERS}}


def test_measured_cells_are_points(engine):
    tables = [table for path, table in engine.tables.items() if path.startswith("densification/points/")]
    assert sum(map(len, tables)) == np.isin(engine.rasters[PROVENANCE], MEASURED).sum()
    assert all((table.rays == 2).all() for table in tables)


def test_any_tile_size_gives_the_same_heights(seen, engine):
    whole = run(seen, tile=1024)
    for name in (HEIGHT, PRECISION, PROVENANCE):
        assert np.array_equal(engine.rasters[name], whole.rasters[name], equal_nan=True)


@pytest.mark.parametrize(
    "changes",
    [
        {"alignment": "image"},
        {"start": "terrain"},
        {"block": 1024, "order": "serpentine"},
        {"level": 1, "window": 9},
        {"threshold": FixedThreshold(value=0.8), "passed_on": "found"},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_every_way_to_search_finds_open_ground(seen, engine, changes):
    other = run(seen, STAGE.matching.model_copy(update=changes))
    error, ground = errors(seen, other)
    measured = ground & np.isin(other.rasters[PROVENANCE], MEASURED)
    assert measured.sum() > 0.8 * ground.sum() and robust(error[measured]) < 0.35
    assert not np.array_equal(other.rasters[HEIGHT], engine.rasters[HEIGHT], equal_nan=True)


def test_lines_may_be_entered_on_an_existing_height_model(seen, engine):
    """Posts 32 cells apart with 2 m of noise, and a narrow search."""
    guide = GuideFile(kind="file", path="dem.tif")
    changes = {"start": "terrain", "guide": guide, "side_points": 4}
    grid = terrain_grid(engine.tables[SURFACE.path].grid)
    x, y = np.meshgrid(*grid.centres(Window(0, 0, *grid.shape)))
    heights = ndimage.map_coordinates(seen[0].height, [-y / CELL, x / CELL], order=1, mode="nearest")
    noisy = (heights + np.random.default_rng(5).normal(0, 2.0, heights.shape)).astype(np.float32)
    guided = run(seen, STAGE.matching.model_copy(update=changes), files={"dem.tif": (grid, noisy)})
    assert np.array_equal(guided.rasters[TERRAIN], noisy)
    error, ground = errors(seen, guided)
    measured = ground & np.isin(guided.rasters[PROVENANCE], MEASURED)
    assert measured.sum() > 0.9 * ground.sum() and robust(error[measured]) < 0.2


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"step": 500.0}, r"first step of vertical line locus is 500.00 m, but the heights of the surface span only"),
        (
            {"window": 201, "level": 1},
            r"Windows of 201 px do not fit into the photographs, whose shorter side is 166 px on pyramid",
        ),
        ({"level": 5}, r"No photograph has pyramid level 5, the coarsest is \d; set a finer level"),
    ],
    ids=["step", "window", "level"],
)
def test_a_search_that_cannot_find_anything_is_refused_in_words(seen, changes, says):
    with pytest.raises(GeometryError, match=says):
        run(seen, STAGE.matching.model_copy(update=changes))
