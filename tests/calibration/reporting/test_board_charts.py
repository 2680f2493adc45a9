"""The figures, tables, charts and pictures of a calibration from chessboards agree with its adjustment."""

from dataclasses import replace

import numpy as np
import pytest
from board_corners import easy_arrangement, easy_calibration, easy_tables, everything_named

from orthomill.schemas.stage_report import Figure, Grid, StageReport
from orthomill.tasks.calibration.board_tables import CornerResiduals
from orthomill.tasks.calibration.diagnosis.advice import CELLS, geometry
from orthomill.tasks.calibration.diagnosis.calibration_results import CalibrationResults
from orthomill.tasks.calibration.diagnosis.drawing import draw_boards, usual_length
from orthomill.tasks.calibration.report.board_charts import balance, board_charts
from orthomill.tasks.calibration.report.board_figures import board_figures, rounded
from orthomill.tasks.calibration.report.board_grids import board_grid, exterior_grid, model_grid, parameter_grid, photo_grid
from orthomill.tasks.calibration.report.board_report import _pictures, chessboards_report
from orthomill.tasks.calibration.solving.lens_models import MODELS
from orthomill.tasks.calibration.solving.model_choice import held_out


@pytest.fixture(scope="module")
def results() -> CalibrationResults:
    target, result = easy_calibration()
    photos, _, searches = easy_tables()
    constant = easy_arrangement()[1].constant
    checks = {**dict.fromkeys(MODELS), MODELS[3]: held_out(result)}
    return CalibrationResults(result, target, list(photos.names), constant, checks, searches, everything_named(photos, 3))


def figures(results: CalibrationResults) -> dict[str, Figure]:
    return {figure.name: figure for figure in board_figures(results, geometry(results.result, results.target))}


def chart(results: CalibrationResults, title: str):
    return next(chart for chart in board_charts(results) if chart.title == title)


def test_the_figures_have_their_promised_names(results):
    assert list(figures(results)) == [
        "board_photos",
        "board_photos_unused",
        "boards",
        "boards_on_site",
        "corners",
        "corners_rejected",
        "sigma0_px",
        "rms_px",
        "correlated_corners",
        "board_bend",
        "board_bend_sigma",
        "redundancy",
        "iterations",
        "rejection_rounds",
        "initial_c",
        "held_out_px",
        "held_out_all_px",
        "c_halves_difference",
        "balanced_c",
        "coverage",
        "largest_tilt",
        "kappa_range",
    ]
    assert [name for name, figure in figures(results).items() if figure.headline] == ["sigma0_px", "held_out_px"]


def test_the_figures_count_what_the_adjustment_used(results):
    found, result = figures(results), results.result
    assert found["board_photos"].value == 8 and found["boards"].value == 24 and found["boards_on_site"].value == 3
    assert found["corners"].value + found["corners_rejected"].value == 24 * 30
    assert found["redundancy"].value == 2 * found["corners"].value - (8 * 6 + 2 * 3 + 8) == result.redundancy
    assert found["sigma0_px"].value == round(result.sigma0, 4) and found["board_photos_unused"].value == 0


def test_without_a_check_its_figures_are_null(results):
    unchecked = figures(replace(results, checks=dict.fromkeys(MODELS)))
    assert all(unchecked[name].value is None for name in ("held_out_px", "held_out_all_px", "c_halves_difference"))


@pytest.mark.parametrize(
    ("value", "expected"), [(None, None), (np.nan, None), (np.inf, None), (1234.56789, 1234.57), (1.2e-9, 1.2e-9)]
)
def test_numbers_are_rounded_to_significant_digits(value, expected):
    assert rounded(value) == expected


def test_parameters_are_printed_in_powers_of_pixels(results):
    grid, state = parameter_grid(results), results.result.state
    rows = {row[0]: row for row in grid.rows}
    assert list(rows) == list(MODELS[3].free)
    c = state.interior[0]
    assert rows["c"][1] == pytest.approx(c, rel=1e-6) and rows["c"][4] == "px"
    assert rows["k1"][1] == pytest.approx(state.interior[3] / c**2, rel=1e-6) and rows["k1"][4] == "px^-2"
    assert rows["k2"][4] == "px^-4" and rows["p1"][1] == pytest.approx(state.interior[6] / c, rel=1e-6)
    sigma = np.sqrt(results.result.interior_covariance[3, 3]) / c**2
    assert rows["k1"][2] == pytest.approx(sigma, rel=0.01)


def test_the_model_in_use_is_marked(results):
    grid = model_grid(results)
    assert [row[-1] for row in grid.rows] == ["", "", "", "used"] and [row[2] is None for row in grid.rows] == [
        True,
        True,
        True,
        False,
    ]


@pytest.mark.parametrize(("make", "rows"), [(exterior_grid, 8), (board_grid, 3), (photo_grid, 8)])
def test_tables_have_a_row_for_each_and_as_many_cells_as_columns(results, make, rows):
    grid: Grid = make(results)
    assert len(grid.rows) == rows and {len(row) for row in grid.rows} == {len(grid.columns)}


def test_photographs_are_listed_with_their_corners_and_residuals(results):
    grid = photo_grid(results)
    assert [row[1:3] for row in grid.rows] == [(3, 90)] * 8
    assert sum(row[3] for row in grid.rows) == int((~results.result.used).sum())
    assert all(0.2 < row[4] < row[5] < 3.0 and row[6] == 0.8 for row in grid.rows)


def test_board_1_is_the_origin_of_the_boards(results):
    first = board_grid(results).rows[0]
    assert first[:8] == (1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) and first[8] == "" and 0.2 < first[9] < 0.6


def test_the_chart_of_corners_shows_each_used_one_and_the_frame(results):
    drawn = chart(results, "Corners over the frame")
    corners, border = (np.array(drawn.series[name]) for name in ("corners used", "border of the frame"))
    assert np.isfinite(corners).sum() == results.result.used.sum() and np.isfinite(border).sum() == 240
    assert (np.isfinite(corners) ^ np.isfinite(border)).all() and np.nanmin(border) == -(results.target.size[1] - 1)


def test_mean_residuals_of_the_cells_are_the_planted_shift(results):
    shifted = replace(results, result=replace(results.result, residual=np.full_like(results.result.residual, 0.25)))
    drawn = chart(shifted, "Mean residuals over the frame")
    assert set(drawn.series["dx"]) == set(drawn.series["dy"]) == {0.25} and 10 < len(drawn.x) <= CELLS**2


def test_the_histogram_holds_every_coordinate_used(results):
    drawn = chart(results, "Residuals of the corners")
    assert sum(drawn.series["corners"]) == 2 * results.result.used.sum() and len(drawn.x) == 34
    assert drawn.x[0] == pytest.approx(-4.0 * results.result.sigma0, abs=1e-3)


def test_residual_vectors_are_thinned_to_what_can_be_seen(results):
    drawn = chart(results, "Residual vectors")
    assert 150 < len(drawn.x) <= 250 and "one in 3" in drawn.caption
    assert len(drawn.series["dx"]) == len(drawn.series["y"]) == len(drawn.x)


def test_correlations_are_percentages_of_every_group(results):
    drawn = chart(results, "Correlations of the interior orientation")
    assert list(drawn.series) == ["c", "x0", "y0", "k1", "k2", "k3"] and drawn.labels[:3] == ("X0", "Y0", "Z0")
    assert all(0.0 <= value <= 100.0 for values in drawn.series.values() for value in values)


def test_the_balanced_curve_is_drawn_next_to_the_adjusted_one(results):
    drawn = chart(results, "Balanced radial distortion")
    radius, change = balance(results)
    assert list(drawn.series) == ["as adjusted", f"balanced, c {change:+.1f} px"]
    assert radius == pytest.approx(0.85 * 0.5 * np.hypot(*results.target.size))


def test_the_report_adds_to_that_of_the_camera_and_keeps_its_order(results):
    plain = StageReport(figures=(Figure(name="c", value=1.0),), warnings=("plain",))
    report = chessboards_report(plain, results)
    assert report.figures[0].name == "c" and report.figures[1].name == "board_photos" and report.warnings[-1] == "plain"
    titles = [grid.title for grid in report.grids]
    assert titles[0] == "Interior orientation in pixels" and titles[-1] == "Calibration photographs" and "Not used" not in titles
    assert [picture.raster for picture in report.pictures] == [f"calibration/boards/{name}" for name in results.photos]


def test_of_many_photographs_only_some_are_shown(results):
    many = replace(results, photos=[f"p{i}" for i in range(40)], searches=results.searches * 5)
    shown = [picture.title for picture in _pictures(many)]
    assert len(shown) == 12 and shown[0] == "Boards in p0" and shown[-1] == "Boards in p39"


def residuals(**changes: np.ndarray) -> CornerResiduals:
    """The four outer corners of a board of 3 x 2."""
    fields = {
        "photo": np.array(["p"] * 4),
        "board": np.zeros(4, np.int32),
        "column": np.array([0, 2, 0, 2], np.int32),
        "row": np.array([0, 0, 1, 1], np.int32),
        "x": np.array([30.0, 90.0, 30.0, 90.0]),
        "y": np.array([30.0, 30.0, 70.0, 70.0]),
        "dx": np.zeros(4),
        "dy": np.full(4, 0.5),
        "used": np.ones(4, dtype=bool),
    }
    return CornerResiduals(**{**fields, **changes})


def test_boards_are_drawn_on_a_light_ground_in_their_photograph_only():
    overview = np.zeros((100, 120), np.uint8)
    picture = draw_boards(overview, residuals(), "p", (120, 100))
    assert picture.shape == (100, 120, 3) and (picture[5, 5] == 128).all()
    assert not np.array_equal(picture, draw_boards(overview, residuals(), "another", (120, 100)))
    assert (draw_boards(overview, residuals(), "another", (120, 100)) == 128).all()


def test_residuals_are_drawn_downwards_with_the_usual_length():
    picture = draw_boards(np.zeros((100, 120), np.uint8), residuals(column=np.array([1, 2, 1, 2], np.int32)), "p", (120, 100))
    assert (picture[70:86, 30] < 60).all(axis=1).sum() >= 12, "16 px down from the corner"
    assert (picture[92:96, 30] == 128).all()


def test_a_very_long_residual_is_shortened():
    long = residuals(dy=np.array([50.0, 0.5, 0.5, 0.5]))
    picture = draw_boards(np.zeros((200, 120), np.uint8), long, "p", (120, 200))
    assert (picture[85, 30] < 60).all() and (picture[95:, 30] == 128).all(), "60 px at most"


def test_the_origin_and_the_axes_of_a_board_are_drawn_where_they_are_known():
    whole = draw_boards(np.zeros((100, 120), np.uint8), residuals(), "p", (120, 100))
    without_origin = residuals(column=np.array([1, 2, 0, 2], np.int32))
    part = draw_boards(np.zeros((100, 120), np.uint8), without_origin, "p", (120, 100))
    assert (whole[30, 45:75] != 128).any(axis=1).all(), "an arrow along the first row"
    assert (part[30, 45:52] == 128).all() and (part[28:33, 86:94] != 128).any()


def test_boards_have_colours_and_numbers_of_their_own():
    second = residuals(board=np.ones(4, np.int32))
    one, two = (draw_boards(np.zeros((100, 120), np.uint8), own, "p", (120, 100)) for own in (residuals(), second))
    assert one[70, 91].tolist() != two[70, 91].tolist() and not np.array_equal(one[40:60, 55:80], two[40:60, 55:80])


def test_residuals_are_compared_between_photographs_by_one_scale():
    other = residuals(photo=np.array(["p", "q", "q", "q"]), dy=np.array([0.5, 5.0, 5.0, 5.0]))
    picture = draw_boards(np.zeros((100, 120), np.uint8), other, "p", (120, 100))
    assert (picture[34:40, 30] == 128).all(), "a tenth of the usual length: 1.6 px"


def test_rejected_corners_are_crossed_instead_of_dotted():
    rejected = residuals(used=np.array([True, True, True, False]))
    picture = draw_boards(np.zeros((100, 120), np.uint8), rejected, "p", (120, 100))
    red = (picture[66:75, 86:95, 0] > 180) & (picture[66:75, 86:95, 1] < 90)
    assert red.sum() >= 5 and (picture[80:86, 90] == 128).all(), "no residual is drawn"


def test_the_usual_length_is_the_median():
    assert usual_length(np.array([[3.0, 4.0], [0.0, 1.0], [30.0, 40.0]])) == 5.0 and usual_length(np.empty((0, 2))) == 1.0
