"""The error of the datum over a block: of answers against draws of blocks that are too high and lean."""

import numpy as np
import pytest
from shifted_block import COMMON, shifted_block, shown_places

from orthomill.schemas.raster import MapGrid
from orthomill.tasks.accuracy.answers.datum_lattice import DatumLattice, datum_lattice
from orthomill.tasks.accuracy.answers.error_correlation import ErrorCorrelation
from orthomill.tasks.accuracy.answers.linear_answer import SurfacePart, error_of
from orthomill.tasks.accuracy.answers.polygon_volumes import volume_weights

SIDE = 61
"""cells along a surface"""
AT = np.linspace(0.0, SIDE - 1.0, 4)
LEVEL, LEAN = 0.06, 0.04
"""m: of all of it, and at its border"""
ROWS, COLS = np.meshgrid(*(np.linspace(-1, 1, SIDE),) * 2, indexing="ij")


def leaning() -> tuple[DatumLattice, np.ndarray]:
    """The lattice of a block with errors of level and lean, and its standard errors (SIDE, SIDE) m."""
    row, col = (a.ravel() for a in np.meshgrid(*(np.linspace(-1, 1, len(AT)),) * 2, indexing="ij"))
    shapes = np.column_stack([LEVEL + 0 * row, LEAN * row, LEAN * col])
    return DatumLattice(AT, AT, shapes @ shapes.T), np.sqrt(LEVEL**2 + LEAN**2 * (ROWS**2 + COLS**2))


def draws(number: int) -> np.ndarray:
    """Errors (number, SIDE, SIDE) m of such blocks."""
    rng = np.random.default_rng(5)
    level, row, col = (s * rng.normal(size=(number, 1, 1)) for s in (LEVEL, LEAN, LEAN))
    return level + row * ROWS + col * COLS


@pytest.mark.parametrize("answer", ["height", "volume", "rise", "rise of neighbours", "halves"])
def test_answers_scatter_as_they_say_where_a_block_leans(answer):
    weights = np.zeros((SIDE, SIDE))
    if answer == "height":
        weights[25, 13] = 1.0
    elif answer == "volume":
        weights[10:30, 35:60] = 1.0
    elif answer == "halves":
        weights[:, :30], weights[:, 31:] = 1.0, -1.0
    else:
        weights[5, 5], weights[(55, 55) if answer == "rise" else (5, 15)] = 1.0, -1.0
    lattice, own = leaning()
    scatter = np.sqrt(((draws(4000) * weights).sum(axis=(1, 2)) ** 2).mean())
    assert lattice.sigma(weights, own, (0, 0)) == pytest.approx(scatter, rel=0.05)
    assert lattice.sigma(weights, 1.1 * own, (0, 0)) == pytest.approx(1.1 * lattice.sigma(weights, own, (0, 0)))


def test_a_part_of_a_surface_says_what_the_whole_says():
    lattice, own = leaning()
    weights = np.indices(own.shape).sum(axis=0) % 3 - 1.2
    weights[:40], weights[:, :20] = 0.0, 0.0
    whole = lattice.sigma(weights, own, (0, 0))
    assert lattice.sigma(weights[40:, 20:], own[40:, 20:], (40, 20)) == pytest.approx(whole)
    part = SurfacePart(0 * own, 0 * own, own, own > 0, (0, 0))
    known = error_of(weights, part, ErrorCorrelation(datum=lattice))
    assert known.datum == pytest.approx(whole) and known.measured == 0


def test_a_lean_has_no_part_above_the_plane_through_the_border():
    lattice, own = leaning()
    share = np.zeros(own.shape)
    share[8:50, 11:47] = 1.0
    level, border = (lattice.sigma(volume_weights(share, share > 0, above), own, (0, 0)) for above in (False, True))
    assert border < 1e-6 * level


def test_what_the_adjustment_did_not_store_counts_as_common():
    lattice, own = leaning()
    unknown = lattice.covariance.copy()
    unknown[0, -1] = unknown[-1, 0] = np.nan
    found, ones = DatumLattice(AT, AT, unknown), np.ones(own.shape)
    assert found.sigma(ones, own, (0, 0)) == pytest.approx(own.sum())
    near = ones[:15, :15], own[:15, :15], (0, 0)
    assert found.sigma(*near) == pytest.approx(lattice.sigma(*near))


def test_a_block_that_is_shifted_as_a_whole_errs_as_one():
    found = shifted_block()
    (x, y), (east, north) = (f(shown_places(found)[:, :2], axis=0) for f in (np.min, np.max))
    grid = MapGrid(west=float(x), north=float(north), cell=1.0, rows=max(2, round(north - y)), cols=max(2, round(east - x)))
    lattice = datum_lattice(found, grid)
    np.testing.assert_allclose(lattice.covariance, COMMON[2, 2], rtol=1e-3)
    ones = np.ones(grid.shape)
    assert lattice.sigma(ones, 0.3 * ones, (0, 0)) == pytest.approx(0.3 * grid.rows * grid.cols, rel=1e-3)
    bare = found.model_copy(update={"photos": tuple(p.model_copy(update={"covariance": None}) for p in found.photos)})
    assert datum_lattice(bare, grid) is None
