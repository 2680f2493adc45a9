"""The strategies of pairs through the stage: a rendered pair to a surface, without any volume."""

import numpy as np
import pytest
from memory_runner import MemoryProject
from scipy import ndimage
from village_pair import CELL, block_of, height_errors, normal_case, photos_of, render, village

from orthomill.schemas.epipolar import PAIRS, EpipolarPairs, epipolar_raster
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.observations import GROUND_POINTS, GroundPoints
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.raster import Window
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import HEIGHT, MEASURED, PRECISION, PROVENANCE, SURFACE
from orthomill.tasks.densification.plan.near_model_jobs import MODEL
from orthomill.tasks.densification.plan.pair_jobs import nodes_raster, outcome_raster
from orthomill.tasks.densification.settings.guide_settings import GuideFile
from orthomill.tasks.densification.settings.pair_strategy_settings import Cascade, CoarseToFine, Growing
from orthomill.tasks.densification.stage import DensificationStage
from orthomill.tasks.densification.strategies.assigned_windows import assigned_windows, strips_of, windows_table
from orthomill.tasks.densification.strategies.near_model import NearModel, model_area
from orthomill.tasks.densification.strategies.pair_strategies import fitted
from orthomill.tasks.matching.guided.column_interval import GuidePosts
from orthomill.tasks.matching.least_squares.least_squares_settings import Ellipse, LeastSquaresMatching, Square
from orthomill.tasks.matching.strategies.growing_settings import RegionGrowing
from orthomill.tasks.matching.strategies.pyramid_settings import PyramidMatching
from orthomill.tasks.matching.windows.window_settings import CombinedWindow, EntropyWindow, FoerstnerWindow, StatisticalWindow

LEVELS = PyramidMatching(levels=3)
WAYS = {
    "pyramid": CoarseToFine(kind="pyramid", pyramid=LEVELS),
    "cascade": Cascade(kind="cascade", pyramid=LEVELS),
    "region_growing": Growing(kind="region_growing", pyramid=LEVELS, growing=RegionGrowing(region=16)),
    "one_region": Growing(kind="region_growing", pyramid=LEVELS, growing=RegionGrowing(region=0, seeds=6)),
}
WINDOWS = (
    StatisticalWindow(kind="statistical", largest=25, min_deviation=8.0),
    EntropyWindow(kind="entropy", min_entropy=3.5),
    FoerstnerWindow(kind="foerstner", largest=25),
    CombinedWindow(kind="combined"),
)


def tie_points(height: np.ndarray) -> GroundPoints:
    row, col = (values.ravel() for values in np.meshgrid(*(np.arange(10, size, 31) for size in height.shape), indexing="ij"))
    none, rays = np.zeros(len(row), np.float32), np.full(len(row), 2, np.int16)
    return GroundPoints(np.arange(len(row)), CELL * col, -CELL * row, height[row, col], none, none, none, rays, none)


@pytest.fixture(scope="module")
def seen():
    scene, pair = village(420, 5, seed=4), normal_case(420)
    return scene, render(scene, pair)


def run(seen, matching, tile=128, files=None):
    engine, pair = MemoryProject(tile, files=files or {}), seen[1].pair
    engine.tables[GROUND_POINTS.path] = tie_points(seen[0].height)
    engine.tables[BLOCK.path], engine.tables[PHOTOS.path] = block_of(pair), photos_of(pair)
    engine.tables[PAIRS.path] = EpipolarPairs(pairs=(pair,))
    for side, image in (("left", seen[1].left), ("right", seen[1].right)):
        engine.put(epipolar_raster(pair.name, side), image)
    engine.run(DensificationStage(matching=matching))
    return engine


def errors(seen, engine):
    """Height minus truth (rows, cols), and the cells of open ground."""
    return height_errors(seen[0], engine.tables[SURFACE.path].grid, engine.rasters[HEIGHT], 16)


@pytest.mark.parametrize("way", WAYS)
def test_open_ground_is_measured_and_its_standard_errors_hold(seen, way):
    engine = run(seen, WAYS[way])
    error, ground = errors(seen, engine)
    measured = ground & np.isin(engine.rasters[PROVENANCE], MEASURED)
    assert measured.sum() > 0.85 * ground.sum()
    assert 1.4826 * np.median(np.abs(error[measured])) < 0.2
    assert (np.abs(error)[measured] < 3 * engine.rasters[PRECISION][measured]).mean() > 0.9
    figures = {figure.name: figure.value for figure in engine.tables[report_table("densification").path].figures}
    assert figures["nodes_matched"] == np.isfinite(engine.rasters[nodes_raster("a-b")][..., 0]).sum()


def grown_with(window, shape=None) -> Growing:
    matching = LeastSquaresMatching(window=window, smoothing=0.6, max_shift=2.0, shape=shape or Square())
    return WAYS["region_growing"].model_copy(update={"growing": RegionGrowing(region=16, matching=matching)})


@pytest.mark.parametrize("axis", ["along", "across"])
def test_an_ellipse_of_a_chosen_size_finds_the_same_ground(seen, axis):
    square, ellipse = (run(seen, grown_with(WINDOWS[2], shape)) for shape in (None, Ellipse(major_axis=axis)))
    error, ground = errors(seen, ellipse)
    measured = ground & np.isin(ellipse.rasters[PROVENANCE], MEASURED)
    assert measured.sum() > 0.3 * ground.sum() and 1.4826 * np.median(np.abs(error[measured])) < 0.3
    assert not np.array_equal(*(engine.rasters[nodes_raster("a-b")] for engine in (square, ellipse)), equal_nan=True)


@pytest.mark.parametrize("way", ["pyramid", "cascade"])
def test_the_other_strategies_choose_windows_as_well(seen, way):
    changes = {"pyramid": ("pyramid", "fine"), "cascade": ("cascade", "sharpen")}[way]
    part = getattr(WAYS[way], changes[0])
    matching = getattr(part, changes[1]).model_copy(update={"window": WINDOWS[2]})
    sized = run(seen, WAYS[way].model_copy(update={changes[0]: part.model_copy(update={changes[1]: matching})}))
    error, ground = errors(seen, sized)
    measured = ground & np.isin(sized.rasters[PROVENANCE], MEASURED)
    assert measured.sum() > 0.3 * ground.sum() and 1.4826 * np.median(np.abs(error[measured])) < 0.3


@pytest.mark.parametrize("window", WINDOWS, ids=lambda window: window.kind)
def test_every_way_to_size_a_window_gives_other_nodes_and_true_heights(seen, window):
    grown, sized = (run(seen, grown_with(w)) for w in (21, window))
    error, ground = errors(seen, sized)
    measured = ground & np.isin(sized.rasters[PROVENANCE], MEASURED)
    assert measured.sum() > 0.3 * ground.sum() and 1.4826 * np.median(np.abs(error[measured])) < 0.3
    assert not np.array_equal(*(engine.rasters[nodes_raster("a-b")] for engine in (grown, sized)), equal_nan=True)


@pytest.mark.parametrize("window", WINDOWS, ids=lambda window: window.kind)
def test_a_share_of_the_points_is_assigned_a_window(seen, window):
    pair, left = seen[1].pair, seen[1].left
    asked = grown_with(window).model_copy(update={"assigned": 70.0})
    parts = [left[strip.slices] for strip in strips_of(pair, asked)]
    (found,) = assigned_windows(pair, asked, iter(parts)).windows
    assert found.share >= 70.0 and found.window != window
    if window.kind != "statistical":
        assert found.share < 75.0


def test_assigned_windows_are_used_and_refused_where_no_window_is_chosen(seen):
    assert Growing(kind="region_growing", growing={"matching": {"window": {"kind": "entropy"}}}, assigned=60).assigned == 60
    with pytest.raises(ValueError, match=r"growing\.matching\.window: \{kind: statistical\}"):
        Growing(kind="region_growing", assigned=60)
    few, many = (run(seen, grown_with(WINDOWS[1]).model_copy(update={"assigned": share})) for share in (30.0, 90.0))
    matched = [np.isfinite(engine.rasters[nodes_raster("a-b")][..., 0]).mean() for engine in (few, many)]
    assert matched[1] > matched[0] + 0.1 and few.tables[windows_table("a-b").path].windows[0].share >= 30.0
    (grid,) = [g for g in few.tables[report_table("densification").path].grids if g.title.startswith("Limits that give")]
    assert grid.rows[0][:2] == ("a-b", "growing.matching") and str(grid.rows[0][2]).startswith("min_entropy")


@pytest.mark.parametrize(("columns", "levels"), [(420, 4), (222, 3), (60, 1)])
def test_a_pyramid_ends_where_its_coarsest_images_hold_no_windows(seen, columns, levels):
    """A pair with a wide base, of which 14 columns were left on the fourth level: not one seed was found."""
    narrow = seen[1].pair.model_copy(update={"rows": 600, "left_cols": columns, "right_cols": 600})
    assert fitted(Growing(kind="region_growing", pyramid=PyramidMatching(levels=4)), narrow).pyramid.levels == levels


def test_a_wider_step_makes_fewer_nodes(seen):
    wide = run(seen, WAYS["pyramid"].model_copy(update={"step": 8})).rasters[outcome_raster("a-b")]
    assert wide.shape[0] == -(-seen[1].pair.rows // 8) and (wide == Outcome.CONVERGED).mean() > 0.5


def test_blocks_give_what_the_whole_pair_gives(seen, monkeypatch):
    from orthomill.tasks.densification.plan import strategy_jobs as strategy_plan

    whole = run(seen, WAYS["region_growing"]).rasters[nodes_raster("a-b")]
    monkeypatch.setattr(strategy_plan, "SIDE", 128)
    blocks = run(seen, WAYS["region_growing"]).rasters[nodes_raster("a-b")]
    assert np.array_equal(whole, blocks, equal_nan=True)


@pytest.fixture(scope="module")
def guided(seen):
    """The pyramid with a single coarse level near posts 16 cells apart with 2 m of noise, with the model that it was given."""
    scene, pair = seen[0], seen[1].pair
    surface = run(seen, WAYS["pyramid"]).tables[SURFACE.path]
    area = model_area(pair, Window(0, 0, pair.rows, pair.left_cols), surface)
    grid = area.grid
    x, y = np.meshgrid(*grid.centres(Window(0, 0, *grid.shape)))
    heights = ndimage.map_coordinates(scene.height, [-y / CELL, x / CELL], order=1, mode="nearest")
    noisy = (heights + np.random.default_rng(5).normal(0, 2.0, heights.shape)).astype(np.float32)
    way = CoarseToFine(kind="pyramid", pyramid=PyramidMatching(levels=1), guide=GuideFile(kind="file", path="dem.tif"))
    engine = run(seen, way, files={"dem.tif": (grid, noisy)})
    return engine, area


def test_an_existing_model_bounds_the_search_of_a_pair(seen, guided):
    error, ground = errors(seen, guided[0])
    measured = ground & np.isin(guided[0].rasters[PROVENANCE], MEASURED)
    assert measured.sum() > 0.9 * ground.sum() and 1.4826 * np.median(np.abs(error[measured])) < 0.2


def test_near_a_model_starts_are_fewer_and_lie_about_the_true_place(seen, guided):
    engine, area = guided
    pair, parallax = seen[1].pair, seen[1].parallax
    col, row = (values.ravel() for values in np.meshgrid(np.arange(40, 300, 20), np.arange(40, 300, 20)))
    points = np.column_stack([col, row]).astype(float)
    offset = pair.left_col0 - pair.right_col0
    whole = -(pair.parallax_high + offset), -(pair.parallax_low + offset)
    near = NearModel(*whole, -2.0, 2.0, pair, GuidePosts.of(area.grid, area.window, engine.rasters[MODEL][area.window.slices]))
    low, high = near.columns(points)
    truth = -(parallax[row, col] + offset)
    known = np.isfinite(low) & np.isfinite(truth)
    assert known.mean() > 0.9 and ((low <= truth + 1) & (truth <= high + 1))[known].mean() > 0.95
    starts = list(near.starts(points, 3.0))
    count = sum(np.isfinite(start[:, 0]) for start in starts)[known]
    assert count.mean() < 0.7 * len(near.offsets(3.0))
    nearest = np.nanmin([np.abs(start[:, 0] - np.clip(truth, low, high)) for start in starts], axis=0)
    assert nearest[known].max() <= 1.5 + 1e-6


def test_a_model_that_cannot_belong_to_the_block_is_refused(seen, guided):
    grid = guided[1].grid
    way = CoarseToFine(kind="pyramid", pyramid=LEVELS, guide=GuideFile(kind="file", path="dem.tif"))
    with pytest.raises(GeometryError, match="does not cover the block"):
        run(seen, way, files={"dem.tif": (grid, np.full(grid.shape, np.nan, np.float32))})


@pytest.mark.parametrize("way", ["region_growing", "guided"])
def test_windows_that_the_images_cannot_hold_are_refused_in_words(way):
    scene, pair = village(24, 0, seed=4), normal_case(24)
    asked = {"region_growing": {"growing": {"matching": {"window": 31}}}, "guided": {"pixels": {"correlation": {"template": 31}}}}[
        way
    ]
    matching = DensificationStage.model_validate({"kind": "densification", "matching": {"kind": way, **asked}}).matching
    with pytest.raises(GeometryError, match=r"Windows of \d+ px do not fit into the epipolar images, whose shorter side is \d+ px"):
        run((scene, render(scene, pair)), matching)
