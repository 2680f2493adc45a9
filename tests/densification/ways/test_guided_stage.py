"""Guided densification through the stage: a rendered pair to points, models and a surface, level by level."""

import numpy as np
import pytest
from memory_runner import MemoryProject
from pydantic import ValidationError
from scipy import ndimage
from village_pair import CELL, block_of, height_errors, normal_case, photos_of, render, village

from orthomill.schemas.epipolar import PAIRS, EpipolarPairs, epipolar_raster
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.observations import GROUND_POINTS, GroundPoints
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.photo import PHOTOS
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import HEIGHT, MEASURED, PRECISION, PROVENANCE, SURFACE
from orthomill.tasks.densification.plan.guided_jobs import guide_raster
from orthomill.tasks.densification.plan.pair_jobs import nodes_raster, outcome_raster
from orthomill.tasks.densification.settings.guide_settings import GuideFile
from orthomill.tasks.densification.settings.guided_matching import Guided, LevelsGuide, PixelPass
from orthomill.tasks.densification.stage import DensificationStage
from orthomill.tasks.matching.guided.guided_settings import BandCorrelation, ColumnInterval, OutlierDetector

GUIDED = Guided(
    kind="guided", thresholds=(2000.0, 1000.0, 400.0, 150.0), reduction=1, pixels=PixelPass(step=2, min_entropy=3.0), rows="auto"
)
_LAX = BandCorrelation(template=9, min_correlation=0.3)


@pytest.fixture(scope="module")
def seen():
    scene, pair = village(420, 5, seed=4), normal_case(420)
    return scene, render(scene, pair)


def tie_points(height: np.ndarray) -> GroundPoints:
    row, col = (values.ravel() for values in np.meshgrid(*(np.arange(10, size, 62) for size in height.shape), indexing="ij"))
    none, rays = np.zeros(len(row), np.float32), np.full(len(row), 2, np.int16)
    return GroundPoints(np.arange(len(row)), CELL * col, -CELL * row, height[row, col], none, none, none, rays, none)


def run(seen, matching=GUIDED, tile=128, files=None):
    engine, pair = MemoryProject(tile, files=files or {}), seen[1].pair
    engine.tables[BLOCK.path], engine.tables[PHOTOS.path] = block_of(pair), photos_of(pair)
    engine.tables[GROUND_POINTS.path] = tie_points(seen[0].height)
    engine.tables[PAIRS.path] = EpipolarPairs(pairs=(pair,))
    for side, image in (("left", seen[1].left), ("right", seen[1].right)):
        engine.put(epipolar_raster(pair.name, side), image)
    engine.run(DensificationStage(matching=matching))
    return engine


@pytest.fixture(scope="module")
def engine(seen):
    return run(seen)


@pytest.fixture(scope="module")
def blind(seen):
    """Nothing but the range of heights of the pair guides any level."""
    return run(seen, GUIDED.model_copy(update={"guide": LevelsGuide(kind="levels"), "interval": ColumnInterval(square=400.0)}))


def true_height(scene, x, y):
    return ndimage.map_coordinates(scene.height, [-y / CELL, x / CELL], order=1, mode="nearest")


def cloud_of(engine, level: int) -> np.ndarray:
    """(N, 3) m of the points of a level without spikes."""
    prefix = f"densification/guided/{level}/cloud/"
    tables = [table for path, table in engine.tables.items() if path.startswith(prefix) and path.endswith("parquet")]
    return np.concatenate([np.column_stack([table.x, table.y, table.z]) for table in tables])


def counts(engine) -> list[tuple]:
    """Rows (level, threshold, factor, interest points, matched, kept, places) of the report."""
    return list(engine.tables[report_table("densification").path].grids[0].rows)


def node_errors(seen, engine) -> np.ndarray:
    """Parallaxes (rows, cols) of the nodes minus the truth, px."""
    nodes = engine.rasters[nodes_raster("a-b")]
    step = -(-seen[1].left.shape[0] // nodes.shape[0])
    return nodes[..., 0] - seen[1].parallax[::step, ::step]


def test_the_surface_is_the_true_one_and_its_standard_errors_hold(seen, engine):
    error, ground = height_errors(seen[0], engine.tables[SURFACE.path].grid, engine.rasters[HEIGHT], 16)
    measured = ground & np.isin(engine.rasters[PROVENANCE], MEASURED)
    assert measured.sum() > 0.65 * ground.sum()
    assert 1.4826 * np.median(np.abs(error[measured])) < 0.2
    ratio = np.abs(error / engine.rasters[PRECISION])[measured]
    assert (ratio < 2).mean() > 0.9 and (ratio > 4).mean() < 0.02


def test_points_grow_in_number_as_thresholds_fall(engine):
    """Check 20 of sources/epipolar.md: published 1007 to 14325 points over seven levels."""
    rows = counts(engine)
    assert [row[1] for row in rows] == [2000.0, 1000.0, 400.0, 150.0, 150.0] and [row[2] for row in rows] == [2, 2, 2, 2, 1]
    kept = [row[5] for row in rows]
    assert kept == sorted(kept) and kept[-1] > 5 * kept[0]
    assert all(found >= matched >= left for *_, found, matched, left, _ in rows)


def test_the_same_points_on_a_denser_guide_gain_little(seen, engine):
    """Check 20: levels 4 and 5 of the publication have the same 4414 points."""
    again = run(seen, GUIDED.model_copy(update={"thresholds": (2000.0, 1000.0, 400.0, 150.0, 149.99)}))
    before, after = counts(engine)[3], counts(again)[4]
    assert after[3] == pytest.approx(before[3], rel=0.01) and after[5] == pytest.approx(before[5], rel=0.06)


def test_nothing_is_matched_on_a_blank_place(seen):
    """Check 21, limit 4 by default: the pond has no texture but noise; with the mask nothing is matched there."""
    assert PixelPass().min_entropy == 4.0 and PixelPass().correlation.template == 9
    outcome = run(seen, GUIDED.model_copy(update={"pixels": PixelPass(correlation=_LAX)})).rasters[outcome_raster("a-b")]
    blank = ndimage.binary_erosion(seen[1].blank, iterations=6)[::2, ::2]
    assert (outcome[blank] == Outcome.LOW_TEXTURE).all()
    bare = run(seen, GUIDED.model_copy(update={"pixels": PixelPass(min_entropy=0.0, correlation=_LAX)})).rasters[
        outcome_raster("a-b")
    ]
    assert (bare[blank] == Outcome.CONVERGED).mean() > 0.03, "a mask that excludes nothing lets chance in"


def test_end_to_end_heights_are_within_the_published_bands(seen, engine):
    """Check 23: 80 % within 3 sigma_dZ, 2 % beyond 10, RMS / sigma_dZ of 3.4 at most; sigma of one pixel of parallax."""
    pair = seen[1].pair
    metres = pair.left_centre[2] ** 2 / (pair.base * pair.c)
    rough, dense = cloud_of(engine, 4), np.argwhere(np.isfinite(node_errors(seen, engine)))
    rough_error = rough[:, 2] - true_height(seen[0], rough[:, 0], rough[:, 1])
    dense_error = node_errors(seen, engine)[tuple(dense.T)] * metres
    for error, sigma in ((rough_error, 2 * metres), (dense_error, metres)):
        ratio = np.abs(error) / sigma
        assert (ratio < 3).mean() >= 0.8 and (ratio > 10).mean() <= 0.02
        assert np.sqrt(np.mean(ratio**2)) <= 3.4


def test_a_guide_saves_candidates_and_false_matches(seen, engine, blind):
    """Check 24: the same pair searched along the whole epipolar line."""
    guided, along = (np.array([(row[3], row[4], row[6]) for row in counts(each)]) for each in (engine, blind))
    assert np.array_equal(guided[:, 0], along[:, 0])
    assert (guided[:, 2] < 0.6 * along[:, 2]).all()
    gross = [np.nanmean(np.abs(node_errors(seen, each)[np.isfinite(node_errors(seen, each))]) > 3) for each in (engine, blind)]
    assert gross[0] < 0.7 * gross[1]


def test_any_tile_and_any_block_give_the_same_bits(seen, engine, monkeypatch):
    from orthomill.tasks.densification.plan import guided_jobs as guided_plan

    monkeypatch.setattr(guided_plan, "SIDE", 128)
    small = run(seen, tile=64)
    for name in (nodes_raster("a-b"), guide_raster(5), HEIGHT, PRECISION):
        assert np.array_equal(small.rasters[name], engine.rasters[name], equal_nan=True), name


def test_an_existing_model_guides_the_first_level(seen, engine):
    posts = engine.specs[guide_raster(0)]
    cell, _, west, _, _, north = posts.transform
    place = MapGrid(west=west, north=north, cell=cell, rows=posts.shape[0], cols=posts.shape[1])
    x, y = np.meshgrid(*place.centres(Window(0, 0, *place.shape)))
    noise = np.random.default_rng(5).normal(0, 1.0, x.shape)
    model = (true_height(seen[0], x, y) + noise).astype(np.float32)
    guide = GuideFile(kind="file", path="dem.tif")
    guided = run(seen, GUIDED.model_copy(update={"guide": guide}), files={"dem.tif": (place, model)})
    assert np.allclose(guided.rasters[guide_raster(0)][..., 0], model)
    assert counts(guided)[0][5] >= counts(engine)[0][5]
    with pytest.raises(GeometryError, match="m above the tie points throughout; it is in another vertical datum"):
        run(seen, GUIDED.model_copy(update={"guide": guide}), files={"dem.tif": (place, model + 40.0)})


def test_patches_bound_the_last_step(seen, engine):
    grid = engine.tables[SURFACE.path].grid
    west, north = grid.west + 40 * grid.cell, grid.north - 40 * grid.cell
    patch = (west, north - 50.0, west + 60.0, north)
    patched = run(seen, GUIDED.model_copy(update={"pixels": PixelPass(min_entropy=3.0, patches=(patch,))}))
    outcome = patched.rasters[outcome_raster("a-b")]
    assert 0 < (outcome == Outcome.CONVERGED).sum() < 0.4 * (engine.rasters[outcome_raster("a-b")] == Outcome.CONVERGED).sum()
    measured = np.isin(patched.rasters[PROVENANCE], MEASURED)
    x, y = np.meshgrid(*grid.centres(Window(0, 0, *grid.shape)))
    outside = (x < patch[0] - 5) | (x > patch[2] + 5) | (y < patch[1] - 5) | (y > patch[3] + 5)
    assert measured.any() and not (measured & outside).any()


@pytest.mark.parametrize(
    "changes",
    [
        {"reduction": 0},
        {"sigma": 1.0},
        {"radius": 5},
        {"rows": 7},
        {"interval": ColumnInterval(extremes="symmetric", square=60.0)},
        {"interval": ColumnInterval(margin=8.0)},
        {"points": BandCorrelation(template=15, min_correlation=0.7, sub_pixel=False)},
        {"outliers": OutlierDetector(radius=12.0, sigmas=2.0, includes_point=True)},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_every_choice_of_the_levels_finds_the_same_ground_in_another_way(seen, engine, changes):
    other = run(seen, GUIDED.model_copy(update=changes))
    level = len(counts(other))
    points = cloud_of(other, level)
    error = points[:, 2] - true_height(seen[0], points[:, 0], points[:, 1])
    assert len(points) > 150 and 1.4826 * np.median(np.abs(error)) < 0.7
    assert counts(other) != counts(engine)


def test_a_given_standard_error_of_parallax_goes_into_the_precision(seen, engine):
    published = run(seen, GUIDED.model_copy(update={"parallax_sigma": 1.0}))
    nodes = published.rasters[nodes_raster("a-b")]
    known = np.isfinite(nodes[..., 0])
    assert (nodes[known, 1] == 1.0).all()
    assert np.array_equal(nodes[..., 0], engine.rasters[nodes_raster("a-b")][..., 0], equal_nan=True)


def test_rows_narrower_than_the_orientation_are_named(seen):
    worse = seen[0], seen[1]
    pair = worse[1].pair.model_copy(update={"row_sigma": 3.0})
    engine = run((seen[0], type(seen[1])(pair, *list(vars(seen[1]).values())[1:])), GUIDED.model_copy(update={"rows": 3}))
    assert any("a-b may lie beside the 3 rows" in loss for loss in engine.tables[report_table("densification").path].losses)
    assert GUIDED.beside(pair, 0) == 3 and GUIDED.beside(pair, 1) == 2


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({"thresholds": (1000.0, 2000.0)}, "thresholds must fall"),
        ({"thresholds": ()}, "at least 1"),
        ({"pixels": {"patches": [(0.0, 0.0, 0.0, 5.0)]}}, "has no area"),
    ],
)
def test_settings_that_mean_nothing_are_refused(asked, says):
    with pytest.raises(ValidationError, match=says):
        Guided(kind="guided", **asked)
