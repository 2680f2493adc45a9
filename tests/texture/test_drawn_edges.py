"""Edges of orthoimages whose comb is known, beside photographs that show them straight."""

import numpy as np
import pytest
from box_scene import BOX, CENTRES, ORTHO, ROOF, ground_colour, sharp_photograph, view

from orthomill.schemas.raster import Window
from orthomill.tasks.colouring.balance.radiometric_balance import balance_block
from orthomill.tasks.colouring.balance.shared_ground import Samples
from orthomill.tasks.colouring.sampling.balanced_photograph import BalancedPhotograph
from orthomill.tasks.colouring.sampling.photograph_colours import PhotoPixelsAt
from orthomill.tasks.texture.edges.drawn_edges import DrawnEdges, all_drawn, drawn_edges, edge_path, found_pieces
from orthomill.tasks.texture.edges.measured_edges import MeasuredEdges, no_edges

WHOLE = Window(0, 0, 240, 240)
WEST, EAST, SOUTH, NORTH, TOP = BOX
FINE = 5
"""parts of a pixel along each side"""


@pytest.fixture(scope="module")
def photos() -> list[BalancedPhotograph]:
    none = Samples(*(np.zeros(0, kind) for kind in (np.int64, np.int32, *4 * (np.float32,))))
    balance = balance_block(list(CENTRES), none, 255.0, False)
    part = Window(0, 0, 420, 420)
    return [BalancedPhotograph(view(n), PhotoPixelsAt(sharp_photograph(n), part, 0), balance) for n in CENTRES]


@pytest.fixture(scope="module")
def edges() -> MeasuredEdges:
    """Places on the western and the northern side of the box, a quarter of a metre apart."""
    y, x = np.arange(SOUTH + 5, NORTH - 5, 0.25), np.arange(WEST + 5, EAST - 5, 0.25)
    west, north = np.ones(len(y)), np.ones(len(x))
    count = len(y) + len(x)
    return MeasuredEdges(
        x=np.concatenate([WEST * west, x]),
        y=np.concatenate([y, NORTH * north]),
        z=np.full(count, TOP),
        away_x=np.concatenate([-west, 0 * north]),
        away_y=np.concatenate([0 * west, north]),
        climb=np.zeros(count),
        step=np.full(count, TOP),
        sigma_across=np.full(count, 0.02),
        sigma_height=np.full(count, 0.05),
        rms=np.full(count, 0.1),
        photos=np.full(count, 4),
        asked=np.full(count, 4),
    )


def ortho(comb: float = 0.0, moved: float = 0.0, period: float = 7.0, roof: np.ndarray = ROOF) -> np.ndarray:
    """Of the box, whose sides are displaced by `moved` px and have a comb of `comb` px (root mean square)."""
    part = (np.arange(240 * FINE) + 0.5) / FINE * ORTHO.cell
    x, y = np.meshgrid(part, ORTHO.north - part)
    colour = ground_colour(x, y)

    def away(along: np.ndarray) -> np.ndarray:
        return ORTHO.cell * (moved + comb * np.sqrt(2.0) * np.sin(2.0 * np.pi * along / ORTHO.cell / period))

    colour[(x > WEST - away(y)) & (x < EAST) & (y > SOUTH) & (y < NORTH + away(x))] = roof
    colour = colour.reshape(240, FINE, 240, FINE, 3).mean(axis=(1, 3))
    return np.dstack([np.rint(colour), np.full((240, 240), 255.0)]).astype(np.uint8)


def judged(edges: MeasuredEdges, photos: list[BalancedPhotograph], picture: np.ndarray) -> DrawnEdges:
    return drawn_edges(edges, ORTHO, WHOLE, picture, photos, 2)


@pytest.mark.parametrize("moved", [0.0, 2.0])
def test_straight_edges_are_straight_wherever_they_lie(edges, photos, moved):
    found = judged(edges, photos, ortho(moved=moved))
    assert found.places > 10 and found.drawn == found.places
    assert found.jagged < 0.1 and found.photo_jagged < 0.15


@pytest.mark.parametrize("comb", [0.5, 1.0, 2.0])
def test_a_comb_is_measured_by_its_teeth(edges, photos, comb):
    found = judged(edges, photos, ortho(comb, period=8.0))
    assert found.drawn == found.places and found.jagged == pytest.approx(comb, rel=0.25)
    assert found.photo_jagged < 0.15


def test_16_bits_make_no_difference(edges, photos):
    picture = ortho(1.0)
    found, same = judged(edges, photos, picture), judged(edges, photos, picture.astype(np.uint16) * 257)
    assert same.places == found.places and same.jagged == pytest.approx(found.jagged, rel=1e-5)


def test_an_edge_that_the_orthoimage_does_not_show_is_counted(edges, photos):
    found = judged(edges, photos, ortho(roof=np.array([100.0, 120.0, 80.0])))
    assert found.places > 10 and found.drawn == 0 and found.jagged is None


def test_edges_that_photographs_do_not_show_straight_are_not_judged(edges, photos):
    bent = MeasuredEdges(**{**vars(edges), "rms": np.full(len(edges), 0.8)})
    assert judged(bent, photos, ortho()).places == 0
    assert judged(edges, photos[:1], ortho()).places == 0
    assert judged(no_edges(), photos, ortho()).places == 0


def test_what_the_tile_does_not_hold_is_not_judged(edges, photos):
    picture = ortho()
    whole = judged(edges, photos, picture)
    cores = Window(0, 0, 240, 110), Window(0, 110, 240, 130)
    halves = [drawn_edges(edges, ORTHO, core, picture[core.slices], photos, 2) for core in cores]
    assert 0 < all_drawn(halves).places < whole.places


def test_a_path_does_not_jump_to_a_brighter_place_for_one_profile():
    across = np.arange(-18, 19) / 2.0
    changes = np.exp(-0.5 * (across / 1.2) ** 2)[None, None, :, None] * np.full((1, 21, 1, 1), 10.0)
    changes[0, 10, :, 0] += 14.0 * np.exp(-0.5 * ((across - 4.0) / 1.2) ** 2)
    found = edge_path(changes, np.array([[10.0]]), across)
    assert np.abs(found).max() < 0.3


def test_a_line_is_taken_off_and_gaps_are_left_out():
    away = 1.0 + 0.1 * np.arange(21.0) + np.where(np.arange(21) % 2, 0.3, -0.3)
    away[5] = np.nan
    pieces = found_pieces(np.stack([away, np.where(np.arange(21) < 10, away, np.nan)]))
    assert pieces.pieces == 1 and len(pieces.left) == 20
    assert np.sqrt((pieces.left**2).mean()) == pytest.approx(0.3, rel=0.02)
