"""An estimated height sets photographs back, a measured one hides from them."""

from dataclasses import replace

import numpy as np
from box_scene import CAMERA as LENS
from box_scene import DSM, view
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.raster import Window
from orthomill.tasks.visibility.height_model import HeightModel, Targets, visible_targets
from orthomill.tasks.visibility.lines_of_sight import HeightPlaces
from orthomill.tasks.visibility.sight import PlaceSight

WHOLE = Window(0, 0, DSM.rows, DSM.cols)
INDEX = np.arange(120)
CAMERA = replace(view("a"), centre=np.array([20.0, 60.0, 40.0]), camera=LENS.model_copy(update={"c": 88.0}))
"""Its frame ends within the model."""
ROW = int(DSM.pixel(20.0, 60.0)[1])


def seen(z: np.ndarray, measured: np.ndarray, guessed: np.ndarray | None = None, spread: np.ndarray | float = 0.0) -> np.ndarray:
    """Sight of all cell centres of a model of which `measured` (bool) says what is no estimate, and `spread` (m) by how much it
    may well be higher or lower."""
    targets = Targets(INDEX, INDEX, z, np.zeros_like(z))
    model, spread = HeightModel(z, DSM, WHOLE), np.broadcast_to(np.float32(spread), z.shape)
    certain = HeightModel(np.where(measured, z - spread, np.float32(np.nan)), DSM, WHOLE)
    above = spread if guessed is None else np.where(guessed, np.float32(np.inf), spread)
    return HeightPlaces(model, certain, targets, above, 0.2).sights(CAMERA)


def wall(col: int = 60) -> np.ndarray:
    z = np.zeros((120, 120), np.float32)
    z[:, col : col + 2] = 10.0
    return z


def test_a_measured_wall_hides_what_an_estimated_one_sets_back():
    measured = np.ones((120, 120), bool)
    behind = slice(64, 70)
    assert (seen(wall(), measured)[ROW, behind] == PlaceSight.HIDDEN).all()
    measured[:, 60:62] = False
    assert (seen(wall(), measured)[ROW, behind] == PlaceSight.BEHIND_ESTIMATE).all()


def test_where_nothing_is_measured_nothing_hides_for_certain():
    """A wood may fill a tile: its ground shall not depend on whether some cell of the tile is measured."""
    found = seen(wall(), np.zeros((120, 120), bool))
    assert (found[ROW, 64:70] == PlaceSight.BEHIND_ESTIMATE).all() and (found != PlaceSight.HIDDEN).all()


def test_a_measured_wall_behind_an_estimated_one_hides():
    z, measured = wall(), np.ones((120, 120), bool)
    z[:, 50:52], measured[:, 50:52] = 6.0, False
    assert (seen(z, measured)[ROW, 64:70] == PlaceSight.HIDDEN).all()
    assert (seen(z, measured)[ROW, 52:56] == PlaceSight.BEHIND_ESTIMATE).all()


def test_an_estimate_is_hidden_by_what_is_measured():
    z, measured = wall(), np.ones((120, 120), bool)
    measured[:, 62:] = False
    assert (seen(z, measured)[ROW, 64:70] == PlaceSight.HIDDEN).all()


def test_noise_of_measured_heights_hides_nothing_for_certain():
    """A low ridge between two cells of a rough surface is as high as its standard errors: what lies behind it keeps its photos."""
    z, measured = np.zeros((120, 120), np.float32), np.ones((120, 120), bool)
    z[:, 61::2] = 1.2
    assert (seen(z, measured)[ROW, 62:100:2] == PlaceSight.HIDDEN).all()
    assert (seen(z, measured, spread=0.6)[ROW, 62:100:2] == PlaceSight.BEHIND_ESTIMATE).all()


def test_a_wall_hides_what_its_standard_errors_do_not_explain():
    assert (seen(wall(), np.ones((120, 120), bool), spread=0.6)[ROW, 64:70] == PlaceSight.HIDDEN).all()


def test_a_place_that_may_lie_higher_is_hidden_by_nothing_for_certain():
    measured, spread = np.ones((120, 120), bool), np.zeros((120, 120), np.float32)
    spread[:, 66:] = 12.0
    found = seen(wall(), measured, spread=spread)[ROW]
    assert (found[64:66] == PlaceSight.HIDDEN).all() and (found[66:70] == PlaceSight.BEHIND_ESTIMATE).all()


def test_a_guessed_height_is_hidden_by_nothing_for_certain():
    """Draped ground behind a wood may lie as high as its crowns: a photograph that shows the place serves where no other does."""
    measured, guessed = np.ones((120, 120), bool), np.zeros((120, 120), bool)
    guessed[:, 66:] = True
    found = seen(wall(), measured, guessed)[ROW]
    assert (found[64:66] == PlaceSight.HIDDEN).all() and (found[66:70] == PlaceSight.BEHIND_ESTIMATE).all()
    assert found[110] == PlaceSight.SEEN


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), share=st.floats(0.0, 1.0))
def test_what_all_heights_leave_free_is_free_whatever_is_measured(seed, share):
    rng = np.random.default_rng(seed)
    z = (12 * rng.random((120, 120)) * (rng.random((120, 120)) < 0.05)).astype(np.float32)
    free = visible_targets(HeightModel(z, DSM, WHOLE), CAMERA, Targets(INDEX, INDEX, z, np.zeros_like(z)), 0.2) > 0
    found = seen(z, rng.random(z.shape) < share)
    np.testing.assert_array_equal(found >= PlaceSight.AT_BREAK, free & (found != PlaceSight.OUTSIDE))


def test_places_without_height_beside_the_frame_or_next_to_a_break_have_codes_of_their_own():
    z = wall()
    z[ROW, 30] = np.nan
    found = seen(z, np.ones(z.shape, bool))
    assert found[ROW, 30] == PlaceSight.NOWHERE
    rows, cols = np.indices(z.shape)
    x, y = DSM.centres(WHOLE)
    pixels = CAMERA.project(np.column_stack([x[cols.ravel()], y[rows.ravel()], np.nan_to_num(z).ravel()]))
    outside = ~CAMERA.contains(pixels).reshape(z.shape) & np.isfinite(z)
    np.testing.assert_array_equal(found == PlaceSight.OUTSIDE, outside)
    assert outside.any()
    # The edge of the wall that hides, and the end of its shadow; not the foot before it.
    assert found[ROW, 61] == PlaceSight.AT_BREAK and found[ROW, 55] == PlaceSight.SEEN
    end = np.flatnonzero(found[ROW] == PlaceSight.HIDDEN).max() + 1
    assert found[ROW, end] == PlaceSight.AT_BREAK and found[ROW, end + 2] == PlaceSight.SEEN
