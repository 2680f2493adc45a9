"""Several boards and one against the number of photographs, as the published tables have them."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.calibration.board_setups import SIX_BOARDS
from benchmarks.calibration.published_calibrations import (
    SINGLE,
    SINGLE_LONGER,
    TABLES,
    adjusted,
    gain,
    ours_of,
    standard_errors,
    start_rows,
)
from orthomill.tasks.calibration.solving.calibration_precision import correlations

ONE_CAMERA = [table for table in TABLES if table.table in ("4-23", "4-40")]


@pytest.mark.parametrize("table", ONE_CAMERA, ids=lambda table: table.table)
def test_standard_errors_fall_with_photographs_and_end_below_the_published_ones(table):
    ends = {number: row for number, row in table.rows.items() if number in (3, max(table.rows))}
    ours, published = ours_of(replace(table, rows=ends)), np.array([row[:5] for row in ends.values()])
    assert (gain(ours)[:4] > 1.1).all()
    # k2 depends on how far into the corners of the frame the boards reach, which is not stated.
    assert (ours[-1, :4] < published[-1, :4]).all(), "good geometry must not be less precise than the published one"


def test_several_boards_have_the_better_principal_point_and_the_lower_correlations():
    several, one = (adjusted(setup, 11, 0.35) for setup in (TABLES[2].setup, SINGLE))
    assert (standard_errors(several)[1:3] < standard_errors(one)[1:3]).all()
    tables = [correlations(result) for result in (several, one)]
    for pair in (("c", "Z0"), ("x0", "phi"), ("y0", "omega")):
        there, here = (table.largest[table.rows.index(pair[0]), table.columns.index(pair[1])] for table in tables)
        assert there < here, pair


def test_single_boards_of_both_cameras_cover_what_the_six_do():
    for setup in (SINGLE, SINGLE_LONGER):
        assert setup.boards == 1 and setup.straight and setup.board.corners == (12, 9)


def test_published_starts_are_near_the_camera_that_is_adjusted_from_them():
    for line in start_rows((SIX_BOARDS,)):
        true, by_rule, by_conic, _, apart, final, iterations = (cell.strip() for cell in line.strip("|").split("|")[1:])
        assert abs(float(by_rule) / float(true) - 1.0) < 0.03 and abs(float(by_conic) / float(true) - 1.0) < 0.03
        assert float(apart) < 0.05 and abs(float(final) - float(true)) < 1.5 and int(iterations) <= 6
