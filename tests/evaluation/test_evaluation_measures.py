"""Height measures, bringing grids together, classes, and orientation against truth."""

import numpy as np
import pytest
from box_scene import block
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Provenance
from orthomill.schemas.truth import Material
from orthomill.tasks.evaluation.accuracy import (
    SIGMAS,
    JudgedCells,
    building_medians,
    height_sums,
    histogram,
    measures,
    merged_histogram,
    merged_sums,
)
from orthomill.tasks.evaluation.classes import PlaceClass, place_classes, strata, strata_of
from orthomill.tasks.evaluation.grids import codes_on, colours_on, heights_on, placement
from orthomill.tasks.evaluation.orientation_accuracy import datum_heights, interior_differences, photo_differences


def measured(dh, cell=1.0, parts=1, expected=None, datum=0.0):
    """Measures of differences of one stratum, with a precision of 0.2 (0.1 among neighbours), that come in `parts` tiles."""
    pieces = np.array_split(np.asarray(dh, np.float64), parts)
    tiles = [JudgedCells(np.ones(len(d), int), d, *(np.full(len(d), v) for v in (0.2, 0.1, datum))) for d in pieces]
    counts = merged_histogram(tuple(histogram(t.dh[np.isfinite(t.dh)], t.stratum[np.isfinite(t.dh)], cell) for t in tiles), (1,))
    return measures(merged_sums(tuple(height_sums(t, cell) for t in tiles), (1,)), counts, cell, expected)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), bias=st.floats(-2, 2), spread=st.floats(0.05, 1.5), parts=st.integers(1, 7))
def test_merged_tiles_measure_what_the_whole_measures(seed, bias, spread, parts):
    dh = np.random.default_rng(seed).normal(bias, spread, 4000)
    m = measured(dh, parts=parts)
    assert m.bias == pytest.approx(dh.mean(), abs=1e-9) and m.sd == pytest.approx(dh.std(), rel=1e-6)
    assert m.rmse == pytest.approx(np.sqrt((dh**2).mean()), rel=1e-9) and m.fgdc95 == pytest.approx(1.96 * m.rmse)
    assert m.median == pytest.approx(np.median(dh), abs=0.011)
    assert m.nmad == pytest.approx(1.4826 * np.median(np.abs(dh - np.median(dh))), abs=0.02)
    assert m.median_absolute == pytest.approx(np.median(np.abs(dh)), abs=0.011)
    assert m.q68 == pytest.approx(np.quantile(np.abs(dh), 0.68), abs=0.011)
    assert m.q95 == pytest.approx(np.quantile(np.abs(dh), 0.95), abs=0.02)
    assert (m.lowest, m.highest) == (dh.min(), dh.max())


def test_blunders_beyond_the_histogram_count_but_do_not_move_the_median():
    m = measured(np.concatenate([np.full(95, 0.1), np.full(5, 500.0)]))
    assert m.median == pytest.approx(0.1, abs=0.006) and m.rmse > 100 and m.highest == 500


def test_shares_within_n_sigma():
    dh = np.array([0.1, 0.5, 0.7, 0.9, 1.1, 1.9, 2.1])
    m = measured(dh, expected=0.4)
    assert m.within == pytest.approx([100 * np.mean(dh <= k * 0.2) for k in SIGMAS])
    assert m.within_expected == pytest.approx([100 * np.mean(dh <= k * 0.4) for k in SIGMAS])


@pytest.mark.parametrize(("cell", "beyond"), [(1.0, 50.0), (0.5, 75.0), (2.0, 25.0)])
def test_large_differences_are_counted_in_metres_and_in_cells(cell, beyond):
    m = measured([0.3, 0.7, -1.2, 2.3], cell=cell)
    assert m.beyond_metre == 50.0 and m.beyond_cell == beyond and m.heights == 4


def test_selected_strata_are_those_of_their_classes_codes_and_views():
    place, code = np.array([PlaceClass.TREE, PlaceClass.WATER, PlaceClass.TREE]), np.array([Provenance.VOLUME] * 2 + [0])
    found = strata(place, code, np.array([True, False, False]))
    everything = strata_of(tuple(PlaceClass))
    assert len(everything) == len(set(everything)) == 2 * len(Provenance) * len(PlaceClass) and np.isin(found, everything).all()
    assert np.isin(found, strata_of((PlaceClass.TREE,))).tolist() == [True, False, True]
    assert np.isin(found, strata_of(tuple(PlaceClass), (Provenance.VOLUME,))).tolist() == [True, True, False]
    assert np.isin(found, strata_of(tuple(PlaceClass), only_seen_twice=True)).tolist() == [True, False, False]


def test_the_datum_is_taken_off_before_neighbours_are_compared():
    m = measured([0.35, 0.55, 0.75], datum=0.4)
    assert m.within_relative[:3] == pytest.approx([100 / 3, 200 / 3, 200 / 3]) and m.within_relative[3] == 100
    assert np.isnan(measured([0.35], datum=np.nan).within_relative).all(), "without a datum nothing is said"


def test_a_block_that_is_raised_raises_its_points():
    true, points = block(), np.array([[60.0, 60.0, 0.0], [50.0, 70.0, 5.0], [9e3, 60.0, 0.0]])
    photos = tuple(p.model_copy(update={"centre": tuple(np.add(p.centre, (0.3, 0.0, 0.7)))}) for p in true.photos)
    assert datum_heights(true, true, points)[:2] == pytest.approx(0.0, abs=1e-8)
    raised = datum_heights(true.model_copy(update={"photos": photos}), true, points)
    assert raised[:2] == pytest.approx(0.7, abs=1e-6) and np.isnan(raised[2]), "rays of one photograph at most do not intersect"


def test_nothing_measured_has_no_numbers():
    m = measured(np.full(3, np.nan))
    assert m.heights == 0 and np.isnan([m.bias, m.nmad, m.q95]).all()


def test_every_building_has_its_median():
    dh, place = np.array([0.1, 0.2, 0.3, -1.0, -1.2, -1.1, 9.0]), np.array([4, 4, 4, 7, 7, 7, 9])
    rows = building_medians((histogram(dh[:2], place[:2], 1.0), histogram(dh[2:], place[2:], 1.0)), 1.0, 3)
    np.testing.assert_allclose(rows, [[4, 3, 0.2], [7, 3, -1.1]], atol=0.011)


FINE = MapGrid(west=100.0, north=200.0, cell=0.5, rows=80, cols=100)


def plane(x, y):
    return (3.0 + 0.2 * x[None, :] - 0.1 * y[:, None]).astype(np.float32)


@pytest.mark.parametrize(
    "grid",
    [
        FINE,
        MapGrid(west=103.0, north=195.0, cell=1.0, rows=20, cols=25),
        MapGrid(west=103.13, north=195.21, cell=0.7, rows=20, cols=25),
    ],
)
def test_heights_of_a_plane_are_exact_on_any_grid(grid):
    window = Window(2, 3, 12, 14)
    place = placement(grid, window, FINE)
    z = plane(*FINE.centres(Window(0, 0, *FINE.shape)))
    np.testing.assert_allclose(heights_on(z[place.source_window.slices], place), plane(*grid.centres(window)), atol=1e-4)


def test_no_ramp_is_drawn_across_a_wall():
    z = np.zeros(FINE.shape, np.float32)
    z[:, 50:] = 12.0
    grid = MapGrid(west=100.13, north=200.0, cell=1.0, rows=40, cols=48)
    place = placement(grid, Window(5, 5, 20, 40), FINE)
    assert set(np.unique(heights_on(z[place.source_window.slices], place))) == {0.0, 12.0}


def test_beyond_the_reference_nothing_is_known():
    place = placement(FINE, Window(-4, 0, 8, 5), FINE)
    z = np.ones(FINE.shape, np.float32)
    found = heights_on(z[place.source_window.slices], place)
    assert np.isnan(found[:4]).all() and (found[4:] == 1).all()
    codes = codes_on(np.full(place.source_window.shape, 3, np.uint8), place)
    assert (codes[:4] == 0).all() and (codes[4:] == 3).all()
    far = placement(MapGrid(west=9e5, north=9e5, cell=1.0, rows=9, cols=9), Window(0, 0, 9, 9), FINE)
    assert far.empty and np.isnan(heights_on(z, far)).all() and np.isnan(colours_on(np.ones((1, 1, 3)), far)).all()


def test_colours_are_taken_over_exactly_or_averaged():
    rng = np.random.default_rng(1)
    colours = rng.integers(0, 255, (*FINE.shape, 3)).astype(np.uint8)
    place = placement(FINE, Window(10, 20, 16, 18), FINE)
    assert np.array_equal(colours_on(colours[place.source_window.slices], place), colours[10:26, 20:38])
    half = MapGrid(west=100.0, north=200.0, cell=1.0, rows=40, cols=50)
    place = placement(half, Window(3, 4, 10, 12), FINE)
    expected = colours.reshape(40, 2, 50, 2, 3).mean(axis=(1, 3))[3:13, 4:16]
    np.testing.assert_allclose(colours_on(colours[place.source_window.slices], place), expected, atol=1e-3)


def test_classes_of_places():
    material = np.full((30, 30), Material.OPEN_GROUND, np.uint8)
    material[5:15, 5:15] = Material.ROOF
    material[25, 25], material[28, 2] = Material.TREE, 0
    material[10, 16], material[20, 3] = Material.WIRE, Material.VEHICLE
    classes = place_classes(material)
    assert classes[10, 10] == PlaceClass.ROOF_INTERIOR and classes[5, 8] == PlaceClass.ROOF_EDGE
    assert classes[10, 17] == PlaceClass.BUILDING_MARGIN and classes[10, 18] == PlaceClass.CLEAR_GROUND
    assert classes[10, 16] == PlaceClass.WIRE and classes[20, 3] == PlaceClass.VEHICLE, "what a cell is beats what is near"
    assert classes[25, 22] == PlaceClass.TREE_MARGIN and classes[25, 25] == PlaceClass.TREE and classes[28, 2] == PlaceClass.UNKNOWN


def test_orientation_differences_in_units_of_their_errors():
    true = block()
    covariance = tuple(map(tuple, np.diag([0.1**2] * 3 + [np.radians(0.01) ** 2] * 3)))
    moved = true.photos[0].model_copy(
        update={
            "centre": tuple(np.add(true.photos[0].centre, (0.1, -0.2, 0.3))),
            "covariance": covariance,
            "omega_phi_kappa": tuple(np.add(true.photos[0].omega_phi_kappa, (0.02, 0, -360.01))),
        }
    )
    found = photo_differences(true.model_copy(update={"photos": (moved, *true.photos[1:])}), true)
    np.testing.assert_allclose(found[0].ratios, [1, -2, 3, 2, 0, -1], atol=1e-6)
    assert np.isnan(found[1].ratios).all() and len(found) == 4


def test_interior_differences_leave_fixed_parameters_without_a_ratio():
    true = block()
    covariance = np.zeros((8, 8))
    covariance[0, 0] = 4.0
    camera = true.cameras["test"].model_copy(update={"c": 403.0, "covariance": tuple(map(tuple, covariance))})
    rows = interior_differences(true.model_copy(update={"cameras": {"test": camera}}), true)
    assert rows[0].parameter == "c" and rows[0].block - rows[0].truth == 3.0 and rows[0].sigma == 2.0
    assert np.isnan(rows[1].sigma)
