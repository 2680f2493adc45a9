"""Every kind of matching, search, correction, surface and output, run to its first page: verdict, answers, files to take away.

A stage, or a variant of one, that says nothing cannot be good; and where the truth is known, a verdict that contradicts it fails.
The scenes are the smallest that the kinds work on; the engine is the one in memory.
"""

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checked_ground import project as checked_project
from memory_runner import MemoryProject
from scipy import ndimage
from tiny_block import camera, photograph
from tiny_block import photos as tiny_photos
from village_pair import CELL, block_of, height_errors, normal_case, photos_of, render, village

from orthomill.pipeline.engine.run_facts import RunFacts, StageRun
from orthomill.pipeline.report.first_page import NOT_DETERMINED, FirstPage, first_page
from orthomill.schemas.camera import CAMERAS, Cameras
from orthomill.schemas.epipolar import PAIRS, EpipolarPairs, epipolar_raster
from orthomill.schemas.observations import GROUND_POINTS, GroundPoints
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS, Photos, photo_raster
from orthomill.schemas.raster import MapGrid, RasterSpec
from orthomill.schemas.stage_contract import Stage
from orthomill.schemas.stage_report import StageReport, report_table
from orthomill.schemas.surface import HEIGHT, MEASURED, PROVENANCE, SURFACE, Surface
from orthomill.tasks.densification.stage import DensificationStage
from orthomill.tasks.dsm_check.stage import DsmCheckStage
from orthomill.tasks.imagery.pyramid import halved
from orthomill.tasks.projection.stage import ProjectionStage
from orthomill.tasks.tie_points.stage import TiePointsStage
from tests.support.solid import wall_and_box

pytestmark = pytest.mark.slow
SIDE = 300
"""cells of the village: windows of 25 px, two levels of a pyramid and a rim of blind ground fit into it"""
MATCHINGS: dict[str, dict[str, Any]] = {
    "object_space": {"kind": "object_space"},
    "vertical_line_locus": {"kind": "vertical_line_locus", "window": 15, "block": 48},
    "vertical_line_locus, published": {
        "kind": "vertical_line_locus",
        "window": 25,
        "photographs": 2,
        "threshold": {"kind": "t_test", "error_probability": 0.001},
        "alignment": "image",
        "start": "neighbour",
    },
    "guided": {"kind": "guided", "guide": {"kind": "levels"}},
    "pyramid": {"kind": "pyramid", "pyramid": {"levels": 3}},
    "cascade": {"kind": "cascade", "pyramid": {"levels": 3}},
    "region_growing": {"kind": "region_growing", "pyramid": {"levels": 3}},
    "region_growing, sized windows": {
        "kind": "region_growing",
        "pyramid": {"levels": 3},
        "growing": {"matching": {"window": {"kind": "statistical", "largest": 25, "min_deviation": 8.0}}},
    },
}
CORRECTIONS = ({"kind": "rays"}, {"kind": "plan"}, {"kind": "norvelle"})
SEARCHES = ({"kind": "features"}, {"kind": "correlation"}, {"kind": "region_growing"})
FRONT = {"kind": "normal", "point": (0.0, 0.0, 1.5), "normal": (0.0, -1.0, 0.0)}
OUTPUTS: tuple[dict[str, Any], ...] = (
    {"kind": "plane", "name": "front", "plane": FRONT, "pixel": 0.05},
    {"kind": "plane", "name": "oblique", "plane": FRONT, "pixel": 0.05, "towards": (0.3, -1.0, 0.2)},
    {"kind": "plane", "name": "alone", "plane": FRONT, "pixel": 0.05, "only": "b"},
    {"kind": "map", "pixel": 0.1},
    {"kind": "cylinder", "foot": (0.0, -0.4, 0.0), "head": (0.0, -0.4, 2.0), "radius": 0.5, "pixel": 0.05},
    {"kind": "perspective", "position": (1.0, -4.0, 2.0), "target": (0.0, 0.0, 1.4), "width": 100, "height": 75, "c": 80.0},
    {"kind": "photograph", "photo": "b"},
)


def page_of(engine: MemoryProject, stage: Stage, folder: Path) -> tuple[StageReport, FirstPage]:
    """The report of a stage and the first page of a run of it alone, with the files that it exports."""
    report = engine.tables[report_table(stage.kind).path]
    for export in engine.exports.values():
        (folder / export.path).parent.mkdir(parents=True, exist_ok=True)
        (folder / export.path).write_bytes(b"x")
    done = RunFacts(
        "memory", "EPSG:2100", "0", "2026-01-01T00:00:00+0000", "2026-01-01T00:01:00+0000", stages=(StageRun(stage.kind, 1, 1),)
    )
    return report, first_page({stage.kind: report}, ((stage.kind, stage.title),), done, folder)


def speaks(report: StageReport, page: FirstPage, products: bool = True) -> None:
    """A verdict with its reason, an answer, and files to take away."""
    assert report.verdict is not None and page.level in ("good", "fair", "poor") and page.headline
    assert report.verdict.level == "good" or page.reasons or page.cautions
    assert [text for _, text in page.answers if text != NOT_DETERMINED]
    assert report.answers
    assert page.products or not products


@cache
def seen():
    scene, pair = village(SIDE, 4, seed=4), normal_case(SIDE)
    return scene, render(scene, pair)


def pair_project() -> MemoryProject:
    """The village with its photographs, epipolar images and tie points."""
    (scene, pictures), engine = seen(), MemoryProject(128)
    pair, height = pictures.pair, scene.height
    row, col = (v.ravel() for v in np.meshgrid(*(np.arange(10, n, 31) for n in height.shape), indexing="ij"))
    none, rays = np.zeros(len(row), np.float32), np.full(len(row), 2, np.int16)
    ties = GroundPoints(np.arange(len(row)), CELL * col, -CELL * row, height[row, col], none, none, none, rays, none)
    engine.tables |= {BLOCK.path: block_of(pair), PHOTOS.path: photos_of(pair), GROUND_POINTS.path: ties}
    engine.tables[PAIRS.path] = EpipolarPairs(pairs=(pair,))
    for side, name, image in (("left", pair.left, pictures.left), ("right", pair.right, pictures.right)):
        engine.put(epipolar_raster(pair.name, side), image)
        put_levels(engine, name, image[..., None])
    return engine


def put_levels(engine: MemoryProject, name: str, pixels: np.ndarray) -> None:
    """A photograph and its halves."""
    for level in range(3):
        engine.put(photo_raster(name, level), pixels)
        engine.specs[photo_raster(name, level)] = RasterSpec(
            name=photo_raster(name, level), shape=pixels.shape, dtype="uint8", chunk=max(pixels.shape)
        )
        pixels = halved(pixels)


@pytest.mark.parametrize("name", MATCHINGS)
def test_a_way_of_matching_says_how_good_its_surface_is(name, tmp_path):
    engine, stage = pair_project(), DensificationStage.model_validate({"matching": MATCHINGS[name]})
    engine.run(stage)
    report, page = page_of(engine, stage, tmp_path)
    speaks(report, page)
    assert "products/dsm.tif" in [file.product.path for file in page.products]
    error, _ = height_errors(seen()[0], engine.tables[SURFACE.path].grid, engine.rasters[HEIGHT], 14)
    wrong = np.abs(error[np.isin(engine.rasters[PROVENANCE], MEASURED) & np.isfinite(error)]) > 1.0
    assert page.level != "good" or wrong.mean() < 0.2, f"{100 * wrong.mean():.0f} % of what it calls measured is beyond 1 m"


@pytest.mark.parametrize("correction", CORRECTIONS, ids=lambda one: one["kind"])
def test_a_correction_says_how_good_the_checked_surface_is(correction, tmp_path):
    engine, stage = checked_project(tile=512), DsmCheckStage.model_validate({"pairs": 1, "correction": correction})
    engine.run(stage)
    report, page = page_of(engine, stage, tmp_path)
    speaks(report, page)
    assert page.level != "good", "bumps of 3 m and a tilt of 2 m were planted"


@pytest.mark.parametrize("search", SEARCHES, ids=lambda one: one["kind"])
def test_a_search_says_how_well_the_photographs_are_tied(search, tmp_path):
    engine, stage = MemoryProject(512), TiePointsStage.model_validate({"search": search, "search_side": 500})
    # One strip: correlation is for photographs that are not turned against each other.
    strip = tuple(photo.model_copy(update={"levels": 3}) for photo in tiny_photos().photos if photo.name.startswith("a"))
    engine.tables |= {PHOTOS.path: Photos(photos=strip)}
    engine.tables[CAMERAS.path] = Cameras(cameras={"tiny": camera()}, of_photo={photo.name: "tiny" for photo in strip})
    for photo in strip:
        put_levels(engine, photo.name, photograph(photo.name))
    engine.run(stage)
    # Matches are no product that anybody takes away.
    speaks(*page_of(engine, stage, tmp_path), products=False)


def surfaces() -> Iterator[tuple[str, dict[str, Any], tuple[dict[str, Any], ...]]]:
    yield "mesh", {"kind": "mesh", "path": "mesh.ply"}, OUTPUTS
    yield "height_model", {"kind": "height_model", "every": 1}, ({"kind": "map", "pixel": 0.1},)


@pytest.mark.parametrize(("name", "surface", "outputs"), list(surfaces()), ids=["mesh", "height_model"])
def test_every_output_of_a_surface_is_judged_and_taken_away(name, surface, outputs, tmp_path):
    engine = wall_and_box.project_of(MemoryProject)
    if name == "height_model":
        grid = MapGrid(west=-2.0, north=-0.2, cell=0.1, rows=10, cols=40)
        engine.tables[SURFACE.path] = Surface(grid=grid, height_low=0.0, height_high=3.0)
        engine.put(HEIGHT, ndimage.gaussian_filter(np.full(grid.shape, 1.0, np.float32), 1.0))
        engine.specs[HEIGHT] = RasterSpec(name=HEIGHT, shape=grid.shape, dtype="float32", chunk=128)
    stage = ProjectionStage.model_validate({"surface": surface, "outputs": outputs, "model": {"kind": "none"}})
    engine.run(stage)
    report, page = page_of(engine, stage, tmp_path)
    speaks(report, page)
    files = " ".join(file.product.path for file in page.products)
    assert [output.name for output in stage.outputs if output.name not in files] == []
