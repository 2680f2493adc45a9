"""The benchmark of the drone block: two surfaces with known errors give the shares that their standard errors promise."""

import numpy as np
import pytest

from benchmarks.brighton import (
    CLASSES,
    CORNER,
    RANKED,
    JudgedCells,
    agreement_rows,
    class_numbers,
    common,
    robust_surface,
    surface_terms,
)
from orthomill.schemas.raster import MapGrid
from orthomill.schemas.surface import Provenance

GRID = MapGrid(west=CORNER[0] + 90.0, north=CORNER[1] + 130.0, cell=0.5, rows=90, cols=100)


def surface(grid: MapGrid, seed: int, tilt: float = 0.0, sigma: float = 0.05) -> JudgedCells:
    random = np.random.default_rng(seed)
    x = grid.west + grid.cell * np.arange(grid.cols)
    height = 100.0 + tilt * (x - CORNER[0]) + random.normal(0, sigma, grid.shape)
    return JudgedCells(grid, height, np.full(grid.shape, sigma), np.full(grid.shape, Provenance.AGREED, np.uint8))


def test_surfaces_with_honest_standard_errors_agree_after_the_tilt_of_their_blocks():
    rows = list(agreement_rows(surface(GRID, 1), surface(GRID, 2, tilt=0.01)))
    cells = [row.split("|") for row in rows if "agreed" in row]
    assert {row[1].split(",")[0].strip() for row in cells} >= {"open", "wood"}
    for row in cells:
        assert float(row[5]) == pytest.approx(95.4, abs=2.0) and float(row[6]) < 0.2
        assert float(row[3]) == pytest.approx(0.05 * np.sqrt(2), rel=0.1)


def test_only_the_cells_of_both_surfaces_are_compared():
    other = MapGrid(west=GRID.west + 10.0, north=GRID.north - 5.0, cell=0.5, rows=100, cols=60)
    one, two = common(surface(GRID, 1), surface(other, 2))
    assert one.grid == two.grid == MapGrid(west=other.west, north=other.north, cell=0.5, rows=80, cols=60)
    assert one.height[0, 0] == surface(GRID, 1).height[10, 20] and two.height[-1, -1] == surface(other, 2).height[79, 59]


def test_codes_are_ranked_and_a_missing_height_comes_last():
    cells = surface(GRID, 1)
    cells.code[0, :3] = Provenance.EMPTY, Provenance.VOLUME, Provenance.INTERPOLATED
    assert list(cells.rank()[0, :4]) == [len(RANKED), RANKED.index(Provenance.VOLUME), len(RANKED) - 1, 0]


def test_classes_lie_where_they_were_drawn():
    classes = class_numbers(MapGrid(west=CORNER[0] + 30.0, north=CORNER[1] + 150.0, cell=1.0, rows=150, cols=140))
    named = [CLASSES[classes[150 - y, x - 30]] for x, y in ((82, 100), (115, 12), (100, 60), (109, 68))]
    assert named == ["wood", "water", "open", "wood"]


def test_a_plane_is_found_beside_gross_errors():
    random = np.random.default_rng(3)
    x, y = random.uniform(-50, 50, (2, 2000))
    z = 1.0 + 0.02 * x - 0.01 * y + random.normal(0, 0.02, 2000)
    z[:200] += 30.0
    assert robust_surface(surface_terms(x, y, bent=False), z) == pytest.approx([1.0, 0.02, -0.01], abs=2e-3)
