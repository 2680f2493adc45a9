"""Lines entered on an existing height model: through the stage, and models that cannot belong to the block."""

import numpy as np
import pytest
from pydantic import ValidationError
from village_pair import block_of, normal_case

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.raster import MapGrid
from orthomill.tasks.densification.settings.guide_settings import GuideFile, TiePointGuide
from orthomill.tasks.densification.settings.line_locus_settings import LineLocus
from orthomill.tasks.densification.volume.guide_heights import GuidedTerrain, guided_terrain

GRID = MapGrid(west=0.0, north=0.0, cell=20.0, rows=8, cols=9)
BLOCK = block_of(normal_case(420))
GROUND = np.add.outer(np.arange(8) * 2.0, np.arange(9) * 3.0).astype(np.float32) + 500.0


def points(noise: float = 0.3) -> GroundPoints:
    row, col = (values.ravel() for values in np.mgrid[:8, :9])
    none = np.zeros(row.size, np.float32)
    z = GROUND.ravel() + np.random.default_rng(1).normal(0, noise, row.size)
    x, y = GRID.west + (col + 0.5) * GRID.cell, GRID.north - (row + 0.5) * GRID.cell
    return GroundPoints(np.arange(row.size), x, y, z, none, none, none, np.full(row.size, 2, np.int16), none)


def terrain_of(guide: np.ndarray, reach: float | None = None) -> GuidedTerrain:
    return guided_terrain(points(), BLOCK, guide.astype(np.float32), GRID, "dem.tif", reach)


def test_a_model_is_taken_where_a_reach_is_given_and_tie_points_close_its_holes():
    guide = GROUND + np.random.default_rng(2).normal(0, 2.0, GROUND.shape).astype(np.float32)
    guide[2:5, 3:6] = np.nan
    heights, reach = terrain_of(guide, 7.0)
    known = np.isfinite(guide)
    assert np.array_equal(heights[known], guide[known])
    assert np.abs(heights - GROUND)[~known].max() < 1.5
    assert reach.shape == (*GRID.shape, 2) and (reach == 7.0).all()


def test_tie_points_correct_a_model_where_they_lie():
    """The model is 2 m off at every post, the tie points 0.3 m, on a slope."""
    guide = GROUND + np.random.default_rng(2).normal(0, 2.0, GROUND.shape)
    heights, reach = terrain_of(guide)
    # Neighbours say too little of a model whose posts are wrong independently: it is as good as their prediction of it.
    assert np.array_equal(heights, guide.astype(np.float32)) and np.ptp(reach[..., 0]) == 0
    smooth = GROUND + 3.0 * np.sin(np.arange(8) / 3.0)[:, None]
    heights, reach = terrain_of(smooth)
    assert np.abs(heights - GROUND).max() < 1.0 < np.abs(smooth - GROUND).max()
    assert ((heights - reach[..., 0] <= GROUND) & (heights + reach[..., 1] >= GROUND)).all()


@pytest.mark.parametrize(
    ("guide", "says"),
    [
        (np.full(GROUND.shape, np.nan), "dem.tif does not cover the block; check its CRS"),
        (GROUND / 0.3048, "heights of dem.tif are in feet; convert them to metres"),
        (GROUND + 43.0, "dem.tif lies 43.0 m above the tie points throughout; it is in another vertical datum"),
        (GROUND - 20.0, "dem.tif lies 20.0 m below the tie points"),
    ],
    ids=["elsewhere", "feet", "above", "below"],
)
def test_a_model_that_cannot_belong_to_the_block_is_refused_in_words(guide, says):
    with pytest.raises(GeometryError, match=says):
        terrain_of(guide)


def test_a_rough_model_is_not_taken_for_one_in_another_datum():
    rough = GROUND + np.random.default_rng(3).normal(3.0, 6.0, GROUND.shape)
    assert np.isfinite(terrain_of(rough).heights).all()


def test_too_few_common_places_judge_nothing():
    alone = np.full(GROUND.shape, np.nan, np.float32)
    alone[0, :2] = GROUND[0, :2] + 300.0
    assert np.array_equal(terrain_of(alone, 1.0).heights[0, :2], alone[0, :2])


def test_a_guide_without_effect_is_refused():
    with pytest.raises(ValidationError, match="guide has no effect with start: neighbour"):
        LineLocus(guide=GuideFile(kind="file", path="dem.tif"))
    assert LineLocus(start="terrain", guide=GuideFile(kind="file", path="dem.tif")).guide.path == "dem.tif"
    assert LineLocus().guide == TiePointGuide()
