"""What orientation and lens leave in a pair is found from its differences with others, and nothing where there is only noise."""

import numpy as np
import pytest

from orthomill.schemas.raster import Window
from orthomill.tasks.dsm_check.correction_map import CorrectionMap, CorrectionNodes
from orthomill.tasks.dsm_check.coverage import CheckedPair, CheckedPairs
from orthomill.tasks.dsm_check.joint_correction import PairBends, PairGeometry, joint
from orthomill.tasks.dsm_check.nodes import BANDS, DH, SIGMA
from orthomill.tasks.dsm_check.precision.pair_bends import compare_pairs, pair_bends
from orthomill.tasks.dsm_check.tile import NodeWindow

GRID = CorrectionNodes(step=4, pixels_per_cell=2, radius=6.0, move=10.0, window=5.5)
NAMES, RATIOS = "abcd", (0.4, 0.6, 0.6, 0.8)
DIRECTIONS = ((1.0, 0.0), (0.0, 1.0), (0.7, 0.7), (0.7, -0.7))
PAIRS = CheckedPairs(
    pairs=tuple(
        CheckedPair(name=n, left=f"{n}1", right=f"{n}2", box=(0, 0, 768, 768), base_height=r, share=0.25)
        for n, r in zip(NAMES, RATIOS, strict=True)
    ),
    pixels_per_cell=2,
    pixel_height=float(np.mean([0.05 / r for r in RATIOS])),
)
SIDE, NOISE = 192, 0.01
"""nodes; m"""


def nodes(error: float, seed: int = 3) -> tuple[np.ndarray, ...]:
    """Nodes of four pairs: noise, an error of the surface of metres, and waves of `error` px over the ground of each pair."""
    random = np.random.default_rng(seed)
    row, col = np.mgrid[:SIDE, :SIDE] / SIDE
    surface, found = 3.0 * np.sin(9 * row) * np.cos(7 * col), []
    for ratio in RATIOS:
        phase, waves = random.uniform(0, 6, 6), np.zeros((SIDE, SIDE))
        for k in range(6):
            waves += np.sin(random.uniform(2, 12) * row + random.uniform(2, 12) * col + phase[k]) / np.sqrt(3)
        values = np.full((SIDE, SIDE, len(BANDS)), np.nan, np.float32)
        values[..., SIGMA] = NOISE
        values[..., DH] = surface + random.normal(0, NOISE, (SIDE, SIDE)) + error * 0.05 / ratio * waves
        values[random.random((SIDE, SIDE)) < 0.1, DH] = np.nan
        found.append(values)
    return tuple(found)


def found(given: tuple[np.ndarray, ...], tile: int) -> PairBends:
    """The bends from tiles of so many nodes."""
    tiles = []
    for row in range(0, SIDE, tile):
        for col in range(0, SIDE, tile):
            own = Window(row, col, tile, tile)
            windows = tuple(
                NodeWindow(n, own, own, PairGeometry(f"{n}1", f"{n}2", d)) for n, d in zip(NAMES, DIRECTIONS, strict=True)
            )
            tiles.append(compare_pairs(windows, GRID, PAIRS.pixel_height, tuple(one[own.slices] for one in given)))
    return pair_bends(tuple(tiles), PAIRS)


@pytest.mark.parametrize("error", [0.2, 0.5])
def test_the_error_of_the_photographs_is_found_whatever_the_surface(error):
    bends = found(nodes(error), 96)
    assert bends.error == pytest.approx(error, rel=0.3)
    assert bends.of_pair["a"] == pytest.approx(2 * bends.of_pair["d"], rel=1e-3), "narrow bases bend more"


def test_noise_is_no_bend():
    assert found(nodes(0.0), 96).error < 0.02


def test_every_tiling_gives_the_same_bends():
    given = nodes(0.3)
    assert found(given, 96) == found(given, 64) == found(given, 192)


def test_one_pair_alone_has_none():
    own = Window(0, 0, SIDE, SIDE)
    alone = compare_pairs((NodeWindow("a", own, own),), GRID, 0.1, nodes(0.5)[:1])
    assert alone.differences == () and pair_bends((alone,), PAIRS).error == 0.0


def test_a_bend_is_in_the_standard_error_of_a_single_pair():
    one = CorrectionMap(np.zeros((2, 2), np.float32), np.full((2, 2), 0.3, np.float32))
    assert joint([one], (2, 2), None, np.array([0.4]))[0].sigma == pytest.approx(0.5)
