"""What moves or lets rays pass: crowns in the wind, wires, glints on water, crawling vehicles."""

from functools import cache

import numpy as np
import pytest
from small_block import FLIGHT, ground_under, scene, site, whole

from orthomill.schemas.raster import Window, tiles_of
from orthomill.schemas.truth import OPEN_MATERIALS, Material
from orthomill.tasks.simulation.flight import exposure, views
from orthomill.tasks.simulation.rendering import Film, cast, render
from orthomill.tasks.simulation.scene.aloft import CABLE, LEAF, Aloft, first_seen, lifted, nothing_aloft
from orthomill.tasks.simulation.scene.crowns import TreeColumn, crown_top, leaves_at, stand_at_rest, stand_in_wind
from orthomill.tasks.simulation.scene.glints import with_glints
from orthomill.tasks.simulation.scene.layout import ground_at
from orthomill.tasks.simulation.scene.scene import bare_ground
from orthomill.tasks.simulation.scene.traversal import TOP, Ray, columns_of, first_hit
from orthomill.tasks.simulation.scene.vehicles import vehicle_cells, vehicles_of
from orthomill.tasks.simulation.scene.wires import MARKED, WIRE_RADIUS, near_spans, off_span, spans_of, wire_height
from orthomill.tasks.simulation.simulated_tiles import paint

SEED = FLIGHT.seed


@cache
def part() -> Window:
    """A window with many trees, on the blocks of the rays."""
    rows, cols = np.nonzero(whole().surface.material == Material.TREE)
    row, col = int(np.median(rows)) // 32 * 32, int(np.median(cols)) // 32 * 32
    return Window(max(row - 128, 0), max(col - 128, 0), 256, 256).clipped(site().grid.shape)


def in_photo(photo: int, window: Window):
    painted = whole()
    cut = type(painted.surface)(*(a[window.slices] for a in vars(painted.surface).values()))
    return lifted(scene(), type(painted)(cut, painted.colours[window.slices]), site().grid, window, photo)


def vertical(columns, aloft: Aloft, u: float, v: float):
    return first_seen(columns, aloft, Ray(u, v, 400.0, 0.0, 0.0), 400.0 - float(columns.highest.max()), 400.0)


def test_without_wind_the_envelope_is_the_surface_of_the_truth():
    grid, stand = site().grid, stand_at_rest(scene())
    rows, cols = np.nonzero(whole().surface.material == Material.TREE)
    for row, col in list(zip(rows, cols, strict=True))[:: len(rows) // 50]:
        x, y = grid.west + (col + 0.5) * grid.cell, grid.north - (row + 0.5) * grid.cell
        near = np.flatnonzero(np.hypot(stand[:, 0] - x, stand[:, 1] - y) < stand[:, 2])
        tops = [crown_top(stand, k, SEED, x, y) for k in near]
        assert max(tops) == pytest.approx(whole().surface.height[row, col], abs=1e-4)


def test_the_wind_bends_every_tree_by_a_few_percent_of_its_height_and_differently_in_every_photo():
    rest, one, two = stand_at_rest(scene()), stand_in_wind(scene(), 0), stand_in_wind(scene(), 1)
    tall = one[:, TreeColumn.TOP] - one[:, TreeColumn.FOOT]
    bend = one[:, TreeColumn.EAST :] / tall[:, None]
    assert np.array_equal(one[:, : TreeColumn.EAST], rest[:, : TreeColumn.EAST]) and not rest[:, TreeColumn.EAST :].any()
    assert bend.std(axis=0).min() > 0.01 and np.abs(bend).max() < 0.15
    assert np.array_equal(one, stand_in_wind(scene(), 0)) and np.abs(one - two).max() > 0.05


def test_leaves_are_carried_along_in_proportion_to_their_height():
    rest, bent = stand_at_rest(scene()), stand_at_rest(scene())
    bent[:, TreeColumn.EAST], bent[:, TreeColumn.NORTH] = 1.0, -0.5
    generator, x, y = np.random.default_rng(1), *rest[0, :2]
    foot, top = rest[0, TreeColumn.FOOT], rest[0, TreeColumn.TOP]
    found = []
    for dx, dy, share in generator.uniform((-2, -2, 0.3), (2, 2, 1), (200, 3)):
        z = foot + share * (top - foot)
        moved = leaves_at(bent, 0, SEED, x + dx + share, y + dy - 0.5 * share, z, top)
        found.append(moved)
        assert moved == pytest.approx(leaves_at(rest, 0, SEED, x + dx, y + dy, z, top), abs=1e-9) or moved == 0.0
    assert np.count_nonzero(found) > 20


def test_rays_meet_leaves_at_many_depths_and_some_meet_the_ground():
    painted, aloft = in_photo(1, part())
    columns = columns_of(painted.surface.height, part(), site().grid.cell)
    rows, cols = np.nonzero(aloft.number > 0)
    depths, kinds = [], []
    for row, col in list(zip(rows, cols, strict=True))[::3]:
        kind, s, _, _ = vertical(columns, aloft, part().col + col + 0.5, part().row + row + 0.5)
        kinds.append(kind)
        if kind == LEAF:
            depths.append(float(columns.tops[row, col, 0]) - (400.0 - s))
        else:
            assert kind == TOP and 400.0 - s == pytest.approx(aloft.ground[row, col], abs=1e-3)
    assert 0.02 < np.mean(np.array(kinds) == TOP) < 0.4, "gaps, but a crown and not a sieve"
    assert min(depths) >= 0 and np.median(depths) < 1.0 and np.quantile(depths, 0.9) > 1.0


def test_the_ground_under_crowns_is_that_of_the_scene():
    _, aloft = in_photo(0, part())
    crowned = np.nonzero(whole().surface.material[part().slices] == Material.TREE)
    x, y = site().grid.centres(part())
    assert np.allclose(aloft.ground[crowned], ground_at(scene(), x[crowned[1]], y[crowned[0]]), atol=1e-4)


def test_what_is_aloft_does_not_depend_on_the_window():
    painted, aloft = in_photo(2, part())
    for tile in tiles_of((part().height, part().width), 128):
        inner = Window(part().row + tile.window.row, part().col + tile.window.col, tile.window.height, tile.window.width)
        other, of_tile = in_photo(2, inner)
        cut = tile.window.slices
        assert np.array_equal(other.surface.height, painted.surface.height[cut]) and np.array_equal(
            of_tile.number, aloft.number[cut]
        )
        assert np.array_equal(other.colours, painted.colours[cut]) and np.array_equal(of_tile.ground, aloft.ground[cut])


def test_without_anything_aloft_a_ray_sees_what_it_hits():
    columns = columns_of(whole().surface.height[part().slices], part(), site().grid.cell)
    for u, v in np.random.default_rng(3).uniform(20.0, 200.0, (50, 2)):
        ray = Ray(part().col + u, part().row + v, 400.0, 0.05, -0.03)
        args = 400.0 - float(columns.highest.max()), 400.0
        assert first_seen(columns, nothing_aloft(), ray, *args) == first_hit(columns, ray, *args)


def test_crowns_differ_from_photo_to_photo_in_their_pixels():
    view, pixels = views(FLIGHT)[1], Window(200, 200, 120, 120)
    ground = ground_under(1, pixels)
    grid, window, painted = ground
    still = [
        cast(scene(), view, pixels, (grid, window, p), a) for p, a in (lifted(scene(), painted, grid, window, k) for k in (0, 1))
    ]
    changed = np.abs(still[0] - still[1]).max(axis=2) > 5
    assert 0.001 < changed.mean() < 0.5, "crowns move, the ground stays"


def along_wire(share: float) -> tuple[np.ndarray, float, float, float]:
    """A span of the scene, and the place of its wire at a share of the way."""
    west, north, cell = site().grid.west, site().grid.north, site().grid.cell
    inside = [s for s in spans_of(scene()) if west + 60 < s[0] and s[2] < west + site().grid.cols * cell - 60 and s[1] < north - 60]
    span = inside[len(inside) // 2]
    return span, span[0] + share * (span[2] - span[0]), span[1] + share * (span[3] - span[1]), wire_height(span, share)


def test_a_wire_hangs_between_its_poles():
    span, _, _, middle = along_wire(0.5)
    assert wire_height(span, 0.0) == span[4] and wire_height(span, 1.0) == span[5] and middle < 0.5 * (span[4] + span[5])
    share, distance = off_span(span, *along_wire(0.3)[1:3])
    assert share == pytest.approx(0.3) and distance == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("off", [0.0, 0.5 * WIRE_RADIUS, 2.0 * WIRE_RADIUS, 0.4])
def test_rays_meet_the_wire_or_pass_beside_it(off):
    grid = site().grid
    span, x, y, z = along_wire(0.4)
    across = np.array([-(span[3] - span[1]), span[2] - span[0]]) / np.hypot(span[2] - span[0], span[3] - span[1])
    u, v = (x + off * across[0] - grid.west) / grid.cell, (grid.north - y - off * across[1]) / grid.cell
    window = Window(int(v) // 16 * 16 - 32, int(u) // 16 * 16 - 32, 96, 96)
    painted, aloft = in_photo(0, window)
    kind, s, _, _ = vertical(columns_of(painted.surface.height, window, grid.cell), aloft, u, v)
    if off < WIRE_RADIUS:
        assert kind == CABLE and 400.0 - s == pytest.approx(z, abs=0.05)
    else:
        assert kind == TOP and 400.0 - s < z - 5.0


def test_the_truth_marks_what_passes_and_keeps_the_ground_there():
    tile = paint(site(), part())
    plain = whole().surface
    marked = np.isin(tile.material, (Material.VEHICLE, Material.WIRE))
    span = np.zeros(part().shape, np.int32)
    near_spans(span, site().grid.centres(part()), spans_of(scene()), MARKED)
    driven = vehicle_cells(scene(), site().grid, part(), 6)
    bare = np.isin(plain.material[part().slices], OPEN_MATERIALS)
    assert np.array_equal(marked, bare & ((span > 0) | driven)) and marked.any()
    assert np.array_equal(tile.surface, plain.height[part().slices])


def test_the_truth_knows_the_ground_below_crowns_and_roofs():
    tile, window = paint(site(), part()), part()
    crowns = tile.material == Material.TREE
    assert np.isfinite(tile.ground).all() and crowns.any()
    bare = bare_ground(scene(), *site().grid.centres(window))
    assert tile.ground == pytest.approx(bare, abs=1e-3)
    assert (tile.surface - tile.ground)[crowns].min() > 0.5, "leaves begin above the ground"


def test_crawling_vehicles_move_a_few_metres_along_their_lane():
    first, second = vehicles_of(scene(), 0), vehicles_of(scene(), 1)
    same = [(a, b) for a in first for b in second if np.array_equal(a[4:], b[4:]) and np.hypot(*(a[:2] - b[:2])) < 4.2]
    slow = [(b[:2] - a[:2], a[2:4]) for a, b in same if abs((b[:2] - a[:2]) @ a[2:4]) > 0.98 * np.hypot(*(b[:2] - a[:2]))]
    assert len(slow) >= 3 and all(np.hypot(*way) > 0.5 for way, _ in slow)


def test_water_looks_different_in_every_photo_and_only_water():
    grid = site().grid
    everything = Window(0, 0, *grid.shape)
    one, two = (with_glints(whole(), grid, everything, SEED, photo).colours.astype(float) for photo in (0, 1))
    water = whole().surface.material == Material.WATER
    assert np.array_equal(one[~water], whole().colours[~water])
    a, b = one[water].mean(axis=1), two[water].mean(axis=1)
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.2 and a.std() > 3.0 and a.max() > 120.0


def test_a_photo_with_crowns_is_the_same_in_two_tilings():
    col, row = views(FLIGHT)[1].project(np.array([[*scene().trees[0, :2], scene().tree_feet[0]]]))[0]
    film = Film(exposure(FLIGHT, 1), 2.0, SEED)
    pixels = Window(min(max(int(row) - 30, 0), 530), min(max(int(col) - 30, 0), 530), 60, 60)
    image = render(scene(), views(FLIGHT)[1], film, pixels, ground_under(1, pixels))
    cut = Window(pixels.row + 17, pixels.col + 21, 30, 33)
    assert np.array_equal(render(scene(), views(FLIGHT)[1], film, cut, ground_under(1, cut)), image[17:47, 21:54])
