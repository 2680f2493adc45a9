"""The whole check on a tiny block: planted errors come back, a good surface stays, every tiling agrees."""

import importlib.util
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from checked_ground import ESTIMATED, GRID, error, ground, project
from tiny_block import EAST, NORTH, block, photograph, surface

from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.job import Export
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import CORRECTED, HEIGHT, SURFACE, Surface
from orthomill.tasks.dsm_check.coverage import best_cover, choose_checked_pairs
from orthomill.tasks.dsm_check.nodes import NodeTile, check_nodes
from orthomill.tasks.dsm_check.plan.round_plan import node_raster, ortho_raster
from orthomill.tasks.dsm_check.stage import DsmCheckStage
from orthomill.tasks.dsm_check.surfaces.checked_surface import SurfaceFile
from orthomill.tasks.epipolar.pair_choice import PairChoice
from orthomill.tasks.epipolar.selection import choose_pairs


@lru_cache
def checked(tile=128, good=False):
    made = project(tile, (lambda x, y: 0 * x) if good else error)
    made.run(DsmCheckStage(pairs=3))
    return made


def test_planted_errors_come_back():
    made = checked()
    x, y = ground()
    dh, sigma = made.rasters["dsm_check/dh"], made.rasters["dsm_check/precision"]
    known = np.isfinite(dh)
    assert known.mean() > 0.7
    wrong = (dh + error(x, y))[known]
    assert np.sqrt((wrong**2).mean()) < 0.1 and np.abs(np.median(wrong)) < 0.02
    assert (np.abs(wrong) < 3 * sigma[known]).mean() > 0.98
    for u, v, sign in ((50, 25, -1), (-50, -25, 1)):
        row, col = np.unravel_index(np.argmin(np.hypot(x - EAST - u, y - NORTH - v)), x.shape)
        assert sign * dh[row, col] > 0 and abs(dh[row, col]) > 0.8 * abs(error(x, y)[row, col])


def test_the_corrected_surface_is_better():
    made, (x, y) = checked(), ground()
    heights, after, dh = made.rasters[HEIGHT], made.rasters[CORRECTED], made.rasters["dsm_check/dh"]
    known = np.isfinite(dh) & np.isfinite(heights)
    before, now = ((h - surface(x, y))[known] for h in (heights, after))
    assert np.sqrt((now**2).mean()) < 0.25 * np.sqrt((before**2).mean())
    np.testing.assert_array_equal(np.isfinite(after), np.isfinite(heights))
    np.testing.assert_array_equal(after[~np.isfinite(dh)], heights[~np.isfinite(dh)])


def test_estimated_cells_are_neither_corrected_nor_counted_as_measured():
    made = checked()
    dh, figures = made.rasters["dsm_check/dh"], made.tables[report_table("dsm_check").path].figures
    values = {figure.name: figure.value for figure in figures}
    assert np.isnan(dh[ESTIMATED]).all() and np.isfinite(dh[130:160, 240:280]).mean() > 0.9
    np.testing.assert_array_equal(made.rasters[CORRECTED][ESTIMATED], made.rasters[HEIGHT][ESTIMATED])
    cells = np.isfinite(made.rasters[HEIGHT]).sum()
    assert values["estimates"] == pytest.approx(100 * 30 * 40 / cells, abs=0.01) and values["estimates_compared"] > 90
    assert values["checked"] == pytest.approx(
        100 * np.isfinite(dh[np.isfinite(made.rasters[HEIGHT])]).sum() / (cells - 1200), abs=0.01
    )


def test_a_good_surface_stays_as_it_is():
    made = checked(good=True)
    dh = made.rasters["dsm_check/dh"]
    assert np.isfinite(dh).mean() > 0.7 and np.nanmax(np.abs(dh)) < 0.3
    np.testing.assert_array_equal(made.rasters[CORRECTED], made.rasters[HEIGHT])
    assert not made.tables[report_table("dsm_check").path].warnings


@pytest.mark.parametrize("tile", [256, 512])
def test_every_tiling_agrees(tile):
    one, other = checked(128), checked(tile)
    for name in ("dsm_check/dh", "dsm_check/precision", CORRECTED, "dsm_check/coarse"):
        np.testing.assert_array_equal(one.rasters[name], other.rasters[name], err_msg=name)
    # pairs have windows of whole tiles, so the number of nodes outside the photographs differs, and nothing else
    a, b = (made.tables[report_table("dsm_check").path] for made in (one, other))
    assert a.warnings == b.warnings and a.grids[2:] == b.grids[2:]


def test_the_report_says_it_in_words():
    report = checked().tables[report_table("dsm_check").path]
    figures = {figure.name: figure.value for figure in report.figures}
    assert figures["suspicious_areas"] == 2 and figures["pairs"] == 3
    assert figures["tilt_east"] == pytest.approx(-16.7, abs=1.0)
    assert any("tilted" in sentence for sentence in report.warnings)
    near = [s for s in report.warnings if f"X {EAST + 50:.0f}"[:7] in s and "too high" in s]
    assert near or any("too high" in s for s in report.warnings)
    assert (
        figures["detectable_width"] == pytest.approx((11 + 2 * 6) * GRID.cell)
        and "m, 14 m wide or more, would" in report.verdict.sentence
    )
    (evidence,) = report.evidence
    assert evidence.products == ("products/dsm.tif",) and evidence.of == "height" and 0.5 < evidence.rmse < 1.5
    assert not evidence.independent and "vertical_class" not in figures
    assert {"dh_mean", "dh_nmad", "dh_within_3_sigma", "checked", "changed"} <= set(figures)


def test_rasters_of_a_pair():
    made = checked()
    pair = next(iter(made.tables["dsm_check/pairs.json"].pairs))
    left, right = (made.rasters[ortho_raster(pair.name, side)] for side in ("left", "right"))
    assert left.shape == right.shape and left.dtype == np.uint8
    codes = made.rasters[node_raster(pair.name)][..., 5]
    assert (codes == Outcome.CONVERGED).mean() > 0.3
    hole = made.rasters[HEIGHT][pair.window.slices]
    grown = np.isnan(hole).repeat(left.shape[0] // hole.shape[0], 0).repeat(left.shape[1] // hole.shape[1], 1)
    assert not left[grown].any()


def test_apply_none_and_plan():
    made = project(512)
    settings = {"kind": "dsm_check", "pairs": 1, "apply": "none", "correction": {"kind": "plan"}, "step": 8}
    made.run(DsmCheckStage.model_validate(settings))
    np.testing.assert_array_equal(made.rasters[CORRECTED], made.rasters[HEIGHT])
    x, y = ground()
    dh = made.rasters["dsm_check/dh"]
    wrong = (dh + error(x, y))[np.isfinite(dh)]
    assert np.abs(np.median(wrong)) < 0.05 and 1.4826 * np.median(np.abs(wrong)) < 0.15


def test_two_pixels_per_cell():
    made = project(512, hole=False)
    made.run(DsmCheckStage(pairs=1, pixels_per_cell=2, step=8))
    dh, (x, y) = made.rasters["dsm_check/dh"], ground()
    wrong = (dh + error(x, y))[np.isfinite(dh)]
    assert len(wrong) > 10000 and np.sqrt((wrong**2).mean()) < 0.3


def test_the_product():
    made = checked()
    exports = [thing for thing in DsmCheckStage(pairs=3).plan(made) if isinstance(thing, Export)]
    assert [e.path for e in exports] == ["products/dsm_check.tif", "products/dsm_check_areas.geojson"]
    bands = {"dh": "dsm_check/dh", "height": CORRECTED, "sigma": "dsm_check/precision", "detectable": "dsm_check/detectable"}
    assert exports[0].rasters == bands | {"test": "dsm_check/test", "code": "dsm_check/code"}


def test_a_wall_hides_what_is_behind():
    """Ground in the shadow of a wall is not tried; the same ground without it is."""
    made = checked(good=True)
    pair = made.tables["dsm_check/pairs.json"].pairs[0]
    whole = pair.window
    tile = NodeTile(block().of(pair.left), block().of(pair.right), GRID, whole, whole, 1, 4)
    stage = DsmCheckStage()
    left = made.rasters[ortho_raster(pair.name, "left")]
    heights = np.full(whole.shape, 50.0, np.float32)
    flat = check_nodes(tile, stage.matching, stage.correction, left, left, heights)[..., 5]
    heights[:, 200:204] += 30
    behind = check_nodes(tile, stage.matching, stage.correction, left, left, heights)[..., 5]
    assert not (flat == Outcome.OCCLUDED).any()
    assert (behind == Outcome.OCCLUDED).mean() > 0.02
    assert (np.nonzero((behind == Outcome.OCCLUDED).any(axis=0))[0] * 4).min() > 100


def test_moving_things_are_not_taken_for_heights():
    """A textured patch that stands elsewhere in the right photograph leaves no correction under it."""
    made = project(512, lambda x, y: 0 * x, hole=False)
    made.run(DsmCheckStage(pairs=1))
    pair = made.tables["dsm_check/pairs.json"].pairs[0]
    images = [made.rasters[ortho_raster(pair.name, side)].copy() for side in ("left", "right")]
    patch = np.random.default_rng(9).integers(1, 255, (12, 12)).astype(np.uint8)
    images[0][150:162, 150:162] = patch
    images[1][150:162, 175:187] = patch
    tile = NodeTile(block().of(pair.left), block().of(pair.right), GRID, pair.window, pair.window, 1, 4)
    stage = DsmCheckStage()
    out = check_nodes(tile, stage.matching, stage.correction, *images, made.rasters[HEIGHT][pair.window.slices])
    under = np.abs(out[37:41, 37:41, 0])
    assert not (under > 1.0).any()


def test_greedy_cover():
    a, b, c = (np.zeros((10, 10), bool) for _ in range(3))
    a[:, :6], b[:, 4:], c[:5] = True, True, True
    assert [k for k, _ in best_cover([a, b, c], [0.5, 0.5, 0.5], None)] == [0, 1]
    assert [k for k, _ in best_cover([a, b, c], [0.1, 0.1, 0.6], 1)] == [2]
    assert not best_cover([np.zeros((5, 5), bool)], [0.5], None)


def test_a_surface_from_elsewhere_is_refused():
    far = Surface(grid=GRID.model_copy(update={"west": GRID.west + 50_000}), height_low=20, height_high=85)
    with pytest.raises(GeometryError, match="No pair of photographs shows the surface model"):
        choose_checked_pairs(choose_pairs(block(), PairChoice(), 0.08), block(), far, 128, None, None)


def test_a_surface_file_is_checked_on_its_own_grid():
    made = project(256)
    heights = made.rasters.pop(HEIGHT)
    del made.tables[SURFACE.path]
    made.files = {"other.tif": (GRID, heights)}
    made.run(DsmCheckStage(surface=SurfaceFile(kind="file", path="other.tif"), pairs=3))
    dh, (x, y) = made.rasters["dsm_check/dh"], ground()
    known = np.isfinite(dh)
    wrong = (dh + error(x, y))[known]
    assert len(wrong) > 110_000 and np.sqrt((wrong**2).mean()) < 0.08
    assert (np.abs(wrong) > 0.5).mean() < 0.001
    assert (np.abs(wrong) < 3 * made.rasters["dsm_check/precision"][known]).mean() > 0.99


@pytest.mark.slow
def test_the_planted_errors_benchmark():
    path = Path(__file__).parents[2] / "benchmarks" / "planted_errors.py"
    spec = importlib.util.spec_from_file_location("planted_errors", path)
    bench = importlib.util.module_from_spec(spec)
    __import__("sys").modules["planted_errors"] = bench
    spec.loader.exec_module(bench)
    made = project(512, lambda x, y: 0 * x)
    scene = bench.Scene(block(), made.tables[PAIRS.path], made.tables[SURFACE.path], {n: photograph(n) for n in block().names})
    text = bench.run(scene, made.rasters[HEIGHT], (15, 25))
    rows = [row.split(" | ") for row in text.splitlines() if row.startswith("| open ground")]
    assert len(rows) == 2 and int(rows[1][4]) >= int(rows[0][4]) and int(rows[1][4]) == int(rows[1][2]) - int(rows[1][5])
