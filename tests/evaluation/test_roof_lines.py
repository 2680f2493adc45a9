"""Edges of roofs whose departure from a straight line is known."""

import numpy as np
import pytest

from orthomill.tasks.evaluation.roof_lines import edge_lines

SHAPE = (160, 160)
CORE = slice(40, 120), slice(40, 120)
EVERYWHERE = np.ones(SHAPE, bool)


def roofs(turned: float, comb=0.0, moved=0.0, period=4.0) -> tuple[np.ndarray, np.ndarray]:
    """An image (rows, cols) of half a roof of 160 grey levels on ground of 80, its edge turned by an angle (radians), displaced by
    `moved` px, and a comb of `comb` px; and where the roof is."""
    row, col = np.indices(SHAPE) - 80.0
    across, along = col * np.cos(turned) + row * np.sin(turned), row * np.cos(turned) - col * np.sin(turned)
    edge = moved + comb * np.sqrt(2.0) * np.sin(2.0 * np.pi * along / period)
    return 120.0 - 40.0 * np.tanh((across - edge) / 1.2), across < 0


def jaggedness(turned: float, **wrong: float) -> float:
    true, roof = roofs(turned)
    found = edge_lines(roofs(turned, **wrong)[0], true, roof, EVERYWHERE, (0, 0), CORE)
    assert found.places > 100
    return float(np.sqrt(found.squares / found.places))


@pytest.mark.parametrize("turned", [0.0, 0.4, 1.2])
def test_a_straight_edge_is_straight_wherever_it_lies(turned):
    assert jaggedness(turned) < 0.02 and jaggedness(turned, moved=2.3) < 0.05


@pytest.mark.parametrize("turned", [0.0, 0.4, 1.2])
@pytest.mark.parametrize("comb", [0.5, 1.5])
def test_a_comb_is_measured_by_its_teeth(turned, comb):
    assert jaggedness(turned, comb=comb, period=9.0) == pytest.approx(comb, rel=0.15)


def test_an_edge_that_is_only_turned_is_straight():
    true, roof = roofs(0.3)
    found = edge_lines(roofs(0.36)[0], true, roof, EVERYWHERE, (0, 0), (slice(70, 90), slice(70, 90)))
    assert found.places > 20 and np.sqrt(found.squares / found.places) < 0.05


def test_without_contrast_or_roofs_nothing_is_judged():
    true, roof = roofs(0.0)
    assert edge_lines(true, np.full(SHAPE, 90.0), roof, EVERYWHERE, (0, 0), CORE).places == 0
    assert edge_lines(true, true, np.zeros(SHAPE, bool), EVERYWHERE, (0, 0), CORE).places == 0


def test_any_tiling_takes_the_same_places():
    true, roof = roofs(0.4)
    found = roofs(0.4, comb=1.0, period=9.0)[0]
    whole = edge_lines(found, true, roof, EVERYWHERE, (0, 0), CORE)
    halves = [
        edge_lines(
            found[at],
            true[at],
            roof[at],
            EVERYWHERE[at],
            (at.start, 0),
            (slice(max(at.start, a) - at.start, b - at.start), CORE[1]),
        )
        for at, a, b in ((slice(0, 114), 40, 80), (slice(46, 160), 80, 120))
    ]
    assert sum(half.places for half in halves) == whole.places
    assert sum(half.squares for half in halves) == pytest.approx(whole.squares, rel=1e-6)
