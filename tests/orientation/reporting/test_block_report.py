"""What the report of a block shows: footprints, the graph of photographs, correlations, and warnings of weak control."""

import numpy as np
import pytest
from orienting import orient
from simulated_block import two_strips

from orthomill.schemas.observations import Control
from orthomill.schemas.orientation import DistanceResidual
from orthomill.schemas.stage_report import Topic
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.orientation.examined.overlap_map import CENTRE, MOST, OUTLINE, SIDE, outline, overlap_map
from orthomill.tasks.orientation.report.block_report import report


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


def table(shown, title):
    """The columns of a table of the report by name."""
    grid = next(grid for grid in shown.grids if grid.title == title)
    return dict(zip(grid.columns, zip(*grid.rows, strict=True), strict=True))


def test_groups_of_observations_add_up_to_the_redundancy(volos_like, shown):
    groups = table(shown, "Groups of observations")
    assert {"tie points in photographs", "surveyed coordinates"} <= set(groups["observations"])
    assert sum(groups["redundancy"]) == pytest.approx(volos_like[1]["block"].redundancy, rel=0.02)
    share = 100 * np.array(groups["redundancy"]) / np.array(groups["numbers observed"])
    assert np.allclose(share, groups["mean redundancy number, %"], atol=1.0) and (share > 0).all() and (share < 100).all()


def test_groups_say_which_error_of_one_of_them_would_be_found(volos_like):
    result = volos_like[1]
    groups = {group.name: group.reliability for group in result["precision"].groups}
    for role, name in (("control", "surveyed coordinates"), ("position", "GNSS positions")):
        rows = [row for row in result["ground_residuals"].of_role(role) if row.redundancy]
        sigma, share = np.array([row.sigma for row in rows]), np.array([row.redundancy for row in rows])
        found = 4.13 * sigma / np.sqrt(share)
        assert groups[name].detectable == pytest.approx(np.median(found), rel=1e-3)
        assert groups[name].detectable_most == pytest.approx(found.max(), rel=1e-3)
        assert groups[name].effect == pytest.approx(np.median((1 - share) * found), rel=1e-3)
        assert groups[name].unchecked == 0
    ties = groups["tie points in photographs"]
    assert ties.detectable > 4.13 * result["block"].sigma0_px and ties.detectable_most >= ties.detectable


def test_the_worst_measurements_are_named_with_photograph_and_point(volos_like, shown):
    worst = table(shown, "Largest standardised residuals")
    assert set(worst["photo"]) <= set(volos_like[1]["block"].names)
    assert all(point.startswith("tie point ") or point in names_of_control(volos_like[0]) for point in worst["point"])
    size = np.abs(worst["in standard errors"])
    assert (np.diff(size) <= 0).all() and size[0] > 2.5


def names_of_control(block):
    return {point.name for point in block.control.points}


def test_distances_are_a_table(volos_like):
    block, result = volos_like
    rows = (DistanceResidual(first="a", second="b", length=12.5, difference=0.004, predicted=0.003),)
    shown = page(block, result | {"ground_residuals": result["ground_residuals"].model_copy(update={"distances": rows})})
    assert table(shown, "Distances")["block minus measured m"] == (0.004,)


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


def test_check_points_decide_the_verdict_and_answer_the_client(shown):
    answers = {answer.topic: answer.text for answer in shown.answers}
    assert (
        shown.verdict.level == "good"
        and "check points" in shown.verdict.sentence
        and "formal statement needs 30" in shown.verdict.sentence
    )
    assert answers[Topic.PHOTOGRAPHS] == "all 6" and "root mean square" in answers[Topic.ACCURACY_HEIGHT]


def test_a_block_without_control_never_counts_as_good(volos_like):
    block, result = volos_like
    unchecked = {**result, "ground_residuals": result["ground_residuals"].model_copy(update={"points": ()})}
    assert page(block, unchecked, Control()).verdict.level == "fair"
