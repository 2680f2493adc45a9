"""The edges of a box, measured in photographs with analytic truth, and lines through places along known edges."""

from dataclasses import fields, replace

import numpy as np
import pytest
from box_scene import BOX, CENTRES, DSM, ORTHO, heights, sharp_photograph, view

from orthomill.schemas.raster import Window
from orthomill.tasks.colouring.balance.radiometric_balance import balance_block
from orthomill.tasks.colouring.balance.shared_ground import Samples
from orthomill.tasks.colouring.edges.sharpened_ground import PartedPixels, sharpened
from orthomill.tasks.colouring.sampling.balanced_photograph import BalancedPhotograph
from orthomill.tasks.colouring.sampling.ground_sampling import ground_of
from orthomill.tasks.colouring.sampling.photograph_colours import PhotoPixelsAt
from orthomill.tasks.texture.edges.edge_places import edge_places
from orthomill.tasks.texture.edges.edge_positions import PRIOR_SIGMA, edge_fits
from orthomill.tasks.texture.edges.edge_profiles import along_parts, offsets
from orthomill.tasks.texture.edges.grown_lines import edge_sheet, straight_edges
from orthomill.tasks.texture.edges.measured_edges import MeasuredEdges, joined_edges, measured_edges, no_edges
from orthomill.tasks.visibility.height_model import HeightModel

WHOLE, CELLS = Window(0, 0, 240, 240), Window(0, 0, 120, 120)
WEST, EAST, SOUTH, NORTH, TOP = BOX


@pytest.fixture(scope="module")
def photos() -> list[BalancedPhotograph]:
    none = Samples(*(np.zeros(0, kind) for kind in (np.int64, np.int32, *4 * (np.float32,))))
    balance = balance_block(list(CENTRES), none, 255.0, False)
    pixels = {name: sharp_photograph(name) for name in CENTRES}
    return [BalancedPhotograph(view(n), PhotoPixelsAt(pixels[n], Window(0, 0, 420, 420), 0), balance) for n in CENTRES]


@pytest.fixture(scope="module")
def parted(photos) -> PartedPixels:
    """Of a model whose box is a cell too wide in the east, 0.6 m too low and not measured at its walls."""
    model = heights()
    model[52:68, 70] = TOP
    model[model > 0] -= 0.6
    measured = np.ones((120, 120), bool)
    measured[50:70, 48:72] = False
    measured[54:66, 52:68] = True
    certain = HeightModel(np.where(measured, model, np.float32(np.nan)), DSM, CELLS)
    found = sharpened(ground_of(model, CELLS, DSM, ORTHO, WHOLE), model, certain, photos).parted
    assert found is not None
    return found


@pytest.fixture(scope="module")
def edges(parted, photos) -> MeasuredEdges:
    return measured_edges(parted, ORTHO, WHOLE, WHOLE, photos, 2)


def distances(x: np.ndarray, y: np.ndarray, away_x: np.ndarray, away_y: np.ndarray) -> np.ndarray:
    """How far outside of the side of the box they face the places lie, m."""
    of_side = np.where(away_x > 0, x - EAST, WEST - x), np.where(away_y > 0, y - NORTH, SOUTH - y)
    return np.where(np.abs(away_x) > np.abs(away_y), *of_side)


def in_the_middle(edges: MeasuredEdges) -> np.ndarray:
    """Places of which the whole piece lies along one side."""
    along_x = np.abs(edges.away_y) > np.abs(edges.away_x)
    from_corner = np.where(along_x, np.minimum(edges.x - WEST, EAST - edges.x), np.minimum(edges.y - SOUTH, NORTH - edges.y))
    return from_corner > 4.5


def test_the_edges_of_a_box_are_where_they_are_and_as_high(edges):
    """A pixel is 0.5 m; the model is 0.6 m too low."""
    found = edges.take(in_the_middle(edges))
    assert len(found) >= 16
    assert np.abs(distances(found.x, found.y, found.away_x, found.away_y)).max() < 0.2
    assert abs(np.median(found.z) - TOP) < 0.25 and np.abs(found.z - TOP).max() < 0.5
    np.testing.assert_allclose(found.step, found.z, atol=0.05)


def test_errors_are_as_large_as_stated(edges):
    found = edges.take(in_the_middle(edges))
    across = np.abs(distances(found.x, found.y, found.away_x, found.away_y)) / found.sigma_across
    height = np.abs(found.z - TOP) / found.sigma_height
    assert np.mean(across < 1) > 0.3 and np.mean(across < 2) > 0.8 and np.mean(height < 2) > 0.8
    assert np.median(found.sigma_across) < 0.25


def test_every_tiling_measures_the_same_edges(parted, photos, edges):
    halves = [measured_edges(parted, ORTHO, WHOLE, core, photos, 2) for core in (Window(0, 0, 117, 240), Window(117, 0, 123, 240))]
    together, order = joined_edges(halves), np.lexsort((edges.y, edges.x))
    other = np.lexsort((together.y, together.x))
    for field in fields(MeasuredEdges):
        np.testing.assert_array_equal(getattr(together, field.name)[other], getattr(edges, field.name)[order])


def test_a_window_of_the_pixels_measures_the_same_edges(parted, photos, edges):
    """A tile knows ten pixels around it, and its photographs no more than they need."""
    core = Window(96, 90, 26, 60)
    around = core.grown(10)
    part = PartedPixels(*(getattr(parted, f.name)[around.slices] for f in fields(PartedPixels)))
    own = measured_edges(part, ORTHO, around, core, photos, 2)
    assert 0 < len(own) < len(edges)
    assert set(zip(own.x.tolist(), own.y.tolist(), strict=True)) <= set(zip(edges.x.tolist(), edges.y.tolist(), strict=True))


def test_one_photograph_measures_no_edge(parted, photos):
    assert len(measured_edges(parted, ORTHO, WHOLE, WHOLE, photos[:1], 2)) == 0
    assert len(measured_edges(None, ORTHO, WHOLE, WHOLE, photos, 2)) == 0


def test_the_box_has_four_straight_edges_that_meet_in_its_corners(edges):
    lines = straight_edges((edges,), DSM.cell)
    assert len(lines) == 8 and sorted(np.bincount(lines.line)) == [2] * 4
    corners = {(round(x, 2), round(y, 2)) for x, y in zip(lines.x, lines.y, strict=True)}
    assert len(corners) == 4
    for corner in ((WEST, SOUTH), (WEST, NORTH), (EAST, SOUTH), (EAST, NORTH)):
        assert min(np.hypot(x - corner[0], y - corner[1]) for x, y in corners) < 0.3
    assert (np.abs(lines.z - TOP) < 2.5 * lines.sigma_height).all() and (lines.photos >= 2).all()


# --- one place ---------------------------------------------------------------------------------------------------------------


def changes(at: np.ndarray, divisor: int = 2) -> np.ndarray:
    """(1, photos, PARTS, S): a change of 20 grey levels per px at `at` (photos, PARTS) px."""
    return (20.0 * np.exp(-0.5 * ((offsets(divisor) - at[..., None]) / 0.8) ** 2))[None].astype(np.float32)


def fit_of(lean: np.ndarray, at: np.ndarray):
    return edge_fits(changes(at), lean[None], PARTS_AT, 0.5, 2)


PARTS_AT = along_parts(2).mean(axis=1)
LEAN = np.array([-1.0, -0.4, 0.0, 0.5, 0.9])
"""px by which a metre displaces the edge in five photographs"""


def predicted(across: float, turn: float, height: float, board: float = 0.0) -> np.ndarray:
    return across + turn * PARTS_AT + (height * LEAN + board * np.maximum(-LEAN, 0.0))[:, None]


def test_displacement_turn_and_height_are_told_apart():
    fit = fit_of(LEAN, predicted(0.8, 0.12, 0.5))
    np.testing.assert_allclose([fit.across[0], fit.turn[0], fit.height[0]], [0.8, 0.12, 0.5], atol=0.08)
    assert fit.photos[0] == fit.asked[0] == 5 and fit.rms[0] < 0.1


def test_a_gutter_below_the_edge_does_not_draw_it_outwards():
    """Photographs from outside see the lower rim of the gutter 0.5 m below the edge."""
    fit = fit_of(LEAN, predicted(0.0, 0.0, 0.0, 0.5))
    assert abs(fit.across[0]) < 0.15 and abs(fit.height[0]) < 0.35


def test_a_photograph_that_shows_something_else_takes_no_part():
    at = predicted(0.5, 0.0, 0.0)
    at[2] += 2.5
    fit = fit_of(LEAN, at)
    assert fit.photos[0] == 4 and abs(fit.across[0] - 0.5) < 0.1


def test_photographs_from_one_side_know_less_of_the_edge():
    both, one = fit_of(LEAN, predicted(0.3, 0.0, 0.2)), fit_of(np.full(5, 0.9), np.tile(0.3 + 0.18, (5, 3)))
    assert one.sigma_across[0] > 1.5 * both.sigma_across[0] and one.sigma_height[0] > 2.0 * both.sigma_height[0]


def test_a_standard_error_grows_with_the_disagreement_of_photographs():
    noisy = predicted(0.0, 0.0, 0.0) + np.array([0.6, -0.6, 0.6, -0.6, 0.6])[:, None]
    assert fit_of(LEAN, noisy).sigma_across[0] > 1.5 * fit_of(LEAN, predicted(0.0, 0.0, 0.0)).sigma_across[0] > 0.0
    assert fit_of(LEAN, predicted(0.0, 0.0, 0.0)).sigma_across[0] < PRIOR_SIGMA


def test_without_changes_there_is_no_edge():
    fit = edge_fits(np.full((1, 5, 3, len(offsets(2))), 3.0, np.float32), LEAN[None], PARTS_AT, 0.5, 2)
    assert fit.photos[0] == 0 and fit.asked[0] == 5 and np.isnan(fit.across[0])


# --- where edges are looked for ----------------------------------------------------------------------------------------------


def test_places_lie_along_the_border_and_look_outwards():
    raised = np.zeros((80, 80), bool)
    raised[20:60, 30:50] = True
    places = edge_places(raised, np.ones((80, 80), bool), (0, 0), np.s_[:, :], 2)
    assert len(places.row) > 20
    west = (places.col == 30) & (places.row > 30) & (places.row < 50)
    np.testing.assert_allclose(places.normal[west], np.tile([-1.0, 0.0], (west.sum(), 1)), atol=1e-6)
    assert np.isin(places.row, (20, 59)).sum() + np.isin(places.col, (30, 49)).sum() >= len(places.row)


def test_no_place_where_only_one_surface_is_known():
    raised = np.zeros((40, 40), bool)
    raised[:, :20] = True
    assert len(edge_places(raised, np.zeros((40, 40), bool), (0, 0), np.s_[:, :], 2).row) == 0


# --- lines -------------------------------------------------------------------------------------------------------------------


def along(first: tuple[float, float, float], last: tuple[float, float, float], count: int, noise: float, seed: int = 1):
    """Places along a line with errors of `noise` m."""
    rng = np.random.default_rng(seed)
    share = np.linspace(0, 1, count)[:, None]
    point = np.array(first) + share * (np.array(last) - np.array(first)) + rng.normal(0, noise, (count, 3))
    direction = np.array(last) - np.array(first)
    length = np.hypot(*direction[:2])
    away = np.tile([direction[1] / length, -direction[0] / length], (count, 1))
    same = {name: np.full(count, value) for name, value in (("climb", direction[2] / length), ("step", 5.0), ("rms", 0.2))}
    sigma = {"sigma_across": np.full(count, max(noise, 0.01)), "sigma_height": np.full(count, max(noise, 0.01))}
    photos = {"photos": np.full(count, 4), "asked": np.full(count, 5)}
    return MeasuredEdges(
        x=point[:, 0], y=point[:, 1], z=point[:, 2], away_x=away[:, 0], away_y=away[:, 1], **same, **sigma, **photos
    )


def test_a_line_is_better_than_its_places_and_says_how_good():
    places = along((100.0, 200.0, 50.0), (130.0, 240.0, 50.0), 26, 0.1)
    lines = straight_edges((places,), 1.0)
    assert len(lines) == 2 and abs(lines.length[0] - 50.0) < 0.5
    off = ((lines.x - 100.0) * 40.0 - (lines.y - 200.0) * 30.0) / 50.0
    assert np.abs(off).max() < 2 * lines.sigma_across[0] < 0.4
    assert 0.05 < lines.scatter[0] < 0.15


def test_a_gable_is_two_lines_that_rise_and_fall():
    rise, fall = along((0, 0, 10.0), (0, 12, 16.0), 10, 0.01), along((0, 12.5, 16.0), (0, 24, 10.0), 10, 0.01)
    lines = straight_edges((rise, fall), 1.0)
    assert len(lines) == 4
    assert sorted(np.round(lines.z)) == [10, 10, 16, 16]


def test_the_order_of_the_tiles_changes_nothing():
    one, other = along((0, 0, 5.0), (20, 0, 5.0), 11, 0.05), along((20, 1, 5.0), (20, 21, 5.0), 11, 0.05, seed=2)
    for field in fields(straight_edges((one,), 1.0)):
        first, second = (getattr(straight_edges(parts, 1.0), field.name) for parts in ((one, other), (other, one)))
        np.testing.assert_array_equal(first, second)


def test_places_that_lie_on_no_line_are_left_out():
    rng = np.random.default_rng(3)
    turn = rng.uniform(0, 2 * np.pi, 40)
    scattered = replace(along((0, 0, 0), (40, 40, 0), 40, 3.0), away_x=np.cos(turn), away_y=np.sin(turn))
    assert len(straight_edges((scattered,), 1.0)) == 0


def test_sums_of_a_sheet_weigh_lines_by_their_length():
    sheet = edge_sheet((along((0, 0, 5.0), (20, 0, 5.0), 11, 0.05),), 1.0)
    assert sheet.sums.lines == 1 and abs(sheet.sums.length - 20) < 0.3
    assert np.sqrt(sheet.sums.variance / sheet.sums.length) == pytest.approx(sheet.lines.sigma_across[0], rel=1e-3)
    assert edge_sheet((no_edges(),), 1.0).sums.lines == 0


def test_lines_of_small_things_are_not_rounded_to_millimetres():
    """A coin of cells of a tenth of a millimetre."""
    places = along((0, 0, 0.005), (0.002, 0.001, 0.005), 11, 1e-6)
    lines = straight_edges((replace(places, sigma_across=np.full(11, 1e-6), sigma_height=np.full(11, 1e-6)),), 1e-4)
    assert len(lines) == 2 and np.abs(np.diff(lines.x)[0]) == pytest.approx(0.002, abs=5e-6)
    assert 0 < lines.sigma_across[0] < 1e-5
