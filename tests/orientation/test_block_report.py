"""What the report of a block shows: footprints, the graph of photographs, correlations, and warnings of weak control."""

import numpy as np
import pytest
from orienting import orient
from simulated_block import two_strips

from schemas.observations import Control
from tasks.geometry.view import block_view
from tasks.orientation.report import report
from tasks.orientation.report_overlap import CENTRE, MOST, OUTLINE, SIDE, outline, overlap_map


def page(block, result, control=None):
    names = ("relative", "block", "points", "image_residuals", "ground_residuals", "precision")
    return report(block.photos, block.cameras, control or block.control, *(result[name] for name in names))


@pytest.fixture(scope="module")
def shown(volos_like):
    return page(*volos_like)


def test_the_overlap_map_counts_photographs(volos_like):
    block = volos_like[1]["block"]
    drawn = overlap_map(block)
    assert drawn.shape == (SIDE, SIDE) and drawn.dtype == np.uint8
    assert set(np.unique(drawn)) <= {*range(MOST + 1), OUTLINE, CENTRE}
    assert (drawn == CENTRE).sum() >= 6 and (drawn == OUTLINE).sum() > 500
    middle = drawn[SIDE // 2 - 20 : SIDE // 2 + 20, SIDE // 2 - 20 : SIDE // 2 + 20]
    assert np.median(middle[middle <= MOST]) >= 4, "all six photographs overlap in the middle"
    assert drawn[0, 0] == 0


def test_an_outline_is_where_the_border_looks(volos_like):
    block = volos_like[1]["block"]
    view, height = block_view(block, block.names[0]), 0.5 * (block.ground_low + block.ground_high)
    places = outline(view, height)
    pixels = view.project(np.column_stack([places, np.full(len(places), height)]))
    edge = np.minimum(np.minimum(pixels[:, 0], 2399 - pixels[:, 0]), np.minimum(pixels[:, 1], 2399 - pixels[:, 1]))
    assert np.abs(edge).max() < 1e-3


def test_the_graph_joins_photographs_that_share_tie_points(shown):
    chart = next(chart for chart in shown.charts if chart.title == "Photographs that share tie points")
    lines = sum(np.isfinite(values).sum() // 2 for values in chart.series.values())
    assert 5 <= lines <= 15 and len(chart.x) == 3 * lines
    assert "300 tie points or more" in chart.series


def test_residuals_are_drawn_for_the_worst_photographs(shown):
    titles = [chart.title for chart in shown.charts]
    assert sum(title.startswith("Image residuals of ") for title in titles) == 4
    bars = next(chart for chart in shown.charts if chart.title == "Image residuals by photograph")
    assert len(bars.labels) == len(bars.series["rms"]) == 6


def test_correlations_of_the_camera_are_a_table(shown):
    grid = next(grid for grid in shown.grids if grid.title.startswith("Correlations of the interior"))
    values = np.array([row[1:] for row in grid.rows], float)
    assert np.allclose(np.diag(values), 1.0) and np.allclose(values, values.T) and np.abs(values).max() <= 1.0


def test_control_in_one_corner_is_one_sided():
    block = two_strips(5, control=24)
    corner = np.array([point.xyz[:2] for point in block.control.points]).min(axis=0)
    near = sorted(block.control.points, key=lambda point: np.linalg.norm(np.array(point.xyz[:2]) - corner))[:4]
    control = Control(points=tuple(point.model_copy(update={"role": "control"}) for point in near))
    one_sided = type(block)(**{**vars(block), "control": control})
    warnings = page(one_sided, orient(one_sided)).warnings
    assert any("one-sided" in warning and "south-west" in warning for warning in warnings)
    whole = page(block, orient(block)).warnings
    assert not any("one-sided" in warning for warning in whole)
