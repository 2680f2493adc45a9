"""The published widening of occlusions step by step."""

import numpy as np
import pytest

from orthomill.tasks.colouring.widening.hidden_edges import HiddenEdges, WideningRules, hidden_edges, limit_zone, opened_by


def picture(*boxes: tuple[int, int, int, int]) -> np.ndarray:
    """(40, 40) bool with rectangles (row, col, height, width)."""
    out = np.zeros((40, 40), bool)
    for row, col, height, width in boxes:
        out[row : row + height, col : col + width] = True
    return out


@pytest.mark.parametrize("side", [1, 2, 3, 4, 5])
def test_opening_removes_what_is_smaller_than_its_window_and_keeps_the_rest_in_place(side, record_property):
    hidden = picture((3, 3, side - 1, side - 1), (20, 20, side, side), (10, 10, 8, 6)) if side > 1 else picture((10, 10, 8, 6))
    expected = picture((20, 20, side, side), (10, 10, 8, 6)) if side > 1 else hidden
    opened = opened_by(hidden.astype(np.uint8), side) > 0
    record_property("found", f"window {side}: {hidden.sum()} to {opened.sum()} px, {np.count_nonzero(opened != expected)} wrong")
    assert np.array_equal(opened, expected)


def test_edges_run_along_the_limit_on_both_sides_and_specks_have_none():
    edges = hidden_edges(picture((10, 10, 8, 6), (30, 30, 3, 3)), WideningRules(window=2, speck=12))
    inside, around = picture((11, 11, 6, 4)), picture((9, 9, 10, 8))
    assert not edges[inside].any() and not edges[~around].any()
    assert edges[picture((10, 10, 1, 6))].all() and edges[picture((9, 10, 1, 6))].all()
    # Nine hidden pixels are fewer than twelve, and so no holes grow from them; where specks are kept they do.
    assert hidden_edges(picture((30, 30, 3, 3)), WideningRules(window=2, speck=0)).any()


def test_the_zone_reaches_as_far_as_it_is_dilated():
    edges = HiddenEdges(np.array([0, 1], np.int16), np.array([20.2, 5.0], np.float32), np.array([10.4, 5.0], np.float32))
    zone = limit_zone(iter([edges]), 0, (30, 40), (1.0, 3.0))
    row, col = np.indices((30, 40))
    away = np.hypot(row - 10, col - 20)
    assert np.array_equal(zone, np.where(away <= 1.0, 1, np.where(away <= 3.0, 2, 0)))
    assert not limit_zone(iter([edges]), 2, (30, 40), (3.0,)).any()
