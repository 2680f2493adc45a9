"""The tables of the report: cameras, photographs, pairs, differences, groups of observations, antenna."""

from dataclasses import replace

import numpy as np
import pytest

from orthomill.schemas.orientation import (
    BlockPrecision,
    DistanceResidual,
    LargestResidual,
    LeverArm,
    ObservationGroup,
    RelativeOrientation,
    RelativeOrientations,
    Unoriented,
)
from orthomill.tasks.orientation.examined.block_numbers import interior_sigmas
from orthomill.tasks.orientation.report.adjustment_tables import adjustment_grids, ground_grids
from orthomill.tasks.orientation.report.camera_tables import camera_grids
from orthomill.tasks.orientation.report.photograph_tables import photograph_grids


def columns(grid):
    """The columns of a table by name; every row is as long as the header."""
    return dict(zip(grid.columns, zip(*grid.rows, strict=True), strict=True))


def adjusted(camera, **changes):
    """The camera after a self-calibration of c, x0 and k1, with c and x0 correlated by 0.6."""
    covariance = np.zeros((17, 17))
    covariance[0, 0], covariance[1, 1], covariance[3, 3] = 4.0, 1.0, 1e-6
    covariance[0, 1] = covariance[1, 0] = 0.6 * 2.0
    own = camera.model_copy(update={"source": "block", "covariance": tuple(map(tuple, covariance))})
    return own.changed(**changes)


@pytest.fixture
def calibrated(facts, with_block):
    camera = adjusted(facts.block.cameras["cam"], c=1010.0, k1=-0.02)
    return with_block(cameras={"cam": camera})


def test_the_change_of_a_camera_is_adjusted_minus_before(calibrated):
    rows = {row[1]: row[2:] for row in camera_grids(calibrated)[0].rows}
    assert rows["c"] == (1000.0, 1010.0, 2.0, 10.0)
    assert rows["x0"] == (0.0, 0.0, 1.0, 0.0)
    assert rows["y0"][2] is None


def test_k1_is_also_given_per_square_pixel(calibrated):
    rows = {row[1]: row[2:] for row in camera_grids(calibrated)[0].rows}
    before, after, sigma, change = rows["k1 in px^-2"]
    assert (before, after, change) == (0.0, pytest.approx(-0.02 / 1010.0**2), None)
    assert sigma == pytest.approx(1e-3 / 1010.0**2)


def test_correlations_are_those_of_the_adjusted_parameters(calibrated):
    (grid,) = camera_grids(calibrated)[1:]
    assert grid.columns == ("", "c", "x0", "k1")
    assert grid.rows == (("c", 1.0, 0.6, 0.0), ("x0", 0.6, 1.0, 0.0), ("k1", 0.0, 0.0, 1.0))


def test_a_camera_that_was_not_adjusted_has_no_standard_errors_and_no_correlations(facts):
    assert len(camera_grids(facts)) == 1
    assert interior_sigmas(facts.block.cameras["cam"]) == [None] * 17


def test_a_calibrated_covariance_is_not_shown_as_one_of_the_block(facts):
    assert interior_sigmas(adjusted(facts.block.cameras["cam"]).model_copy(update={"source": "chessboards"})) == [None] * 17


def test_residuals_by_photograph_are_those_of_the_used_measurements(facts):
    used = facts.image.used.copy()
    used[:4] = False
    rows = columns(photograph_grids(replace(facts, image=replace(facts.image, used=used)))[0])
    assert rows["photo"] == ("a", "b")
    assert rows["measurements"] == (32, 36) and rows["rejected"] == (4, 0)
    assert rows["rms col px"] == pytest.approx((0.3, 0.3)) and rows["rms row px"] == pytest.approx((0.4, 0.4))
    assert rows["rms micrometres"] == pytest.approx((2.5, 2.5)) and rows["largest px"] == pytest.approx((0.5, 0.5))
    assert rows["areas with points, of 9"] == (9, 9)


def test_a_photograph_without_measurements_has_an_empty_row(facts):
    rows = columns(photograph_grids(replace(facts, image=facts.image.take(facts.image.photo == 1)))[0])
    assert rows["measurements"] == (0, 36) and rows["rms col px"][0] is None and rows["largest px"][0] is None


def test_exterior_orientations_are_in_metres_and_degrees(facts):
    rows = columns(photograph_grids(facts)[1])
    assert rows["X"] == (0.0, 20.0) and rows["Z"] == (100.0, 100.0)
    assert rows["sigma Y"] == pytest.approx((0.4, 0.4))
    assert rows["sigma kappa"] == pytest.approx((np.degrees(1e-4),) * 2)


def test_unknown_standard_errors_are_empty(facts, with_block):
    unknown = tuple(photo.model_copy(update={"covariance": None}) for photo in facts.block.photos)
    assert columns(photograph_grids(with_block(photos=unknown))[1])["sigma X"] == (None, None)


def test_a_pair_is_shown_with_the_standard_errors_of_its_rotation(facts):
    pair = RelativeOrientation(
        left="a", right="b", matches=50, kept=48, outcome="oriented", sigma=(0.1, 0.2, 0.3, 0.4, 0.5), by_bz=(0.01, -0.02)
    )
    failed = RelativeOrientation(left="a", right="c", matches=9, kept=0, outcome="too few")
    rows = columns(photograph_grids(replace(facts, relative=RelativeOrientations(pairs=(pair, failed))))[2])
    assert rows["by"] == (0.01, None) and rows["bz"] == (-0.02, None)
    assert [rows[f"sigma about {axis}"] for axis in "xyz"] == [(0.3, None), (0.4, None), (0.5, None)]
    assert rows["outcome"] == ("oriented", "too few")


def test_photographs_that_did_not_join_are_listed_with_their_reasons(with_block):
    grid = photograph_grids(with_block(unoriented=(Unoriented(photo="c", reason="c has no tie points."),)))[3]
    assert grid.rows == (("c", "c has no tie points."),)


def test_differences_are_sorted_by_role(facts):
    control, check, position = ground_grids(facts.ground)
    assert [row[0] for row in control.rows] == ["C0", "C1", "C2", "C3"]
    assert check.rows == (("K1", 0.03, -0.04, 0.1, 0.1, 0.1, 0.1, 2, 0.4),)
    assert position.rows == ()


def test_a_position_has_no_photographs_and_no_image_residual(facts):
    rows = tuple(row.model_copy(update={"role": "position"}) for row in facts.ground.points)
    position = ground_grids(facts.ground.model_copy(update={"points": rows}))[2]
    assert position.columns[-1] == "predicted sigma Z"
    assert all(len(row) == len(position.columns) for row in position.rows)


def precision(**changes):
    return BlockPrecision(image_factor=1.0, position_factor=1.0, control_factor=1.0, rays=10, rejected=0, **changes)


def test_the_mean_redundancy_number_is_a_percentage():
    groups = (ObservationGroup(name="tie points in photographs", count=200, redundancy=150.04, factor=1.2),)
    assert adjustment_grids(precision(groups=groups), ())[0].rows == (
        ("tie points in photographs", 200, 150.0, 75.0, 1.2, None, None, None, None),
    )


def test_an_empty_group_does_not_divide_by_zero():
    groups = (ObservationGroup(name="distances", count=0, redundancy=0.0, factor=1.0),)
    assert adjustment_grids(precision(groups=groups), ())[0].rows[0][3] == 0.0


def test_the_largest_residuals_keep_their_order():
    row = {"photo": "a", "axis": "x", "residual_px": 1.0, "redundancy_number": 0.7, "detectable_px": 2.0}
    largest = tuple(LargestResidual(point=f"tie point {i}", standardised=3.9 - i, **row) for i in range(3))
    grid = adjustment_grids(precision(largest=largest), ())[1]
    assert columns(grid)["in standard errors"] == (3.9, 2.9, 1.9)


def test_distances_are_compared_with_the_block():
    rows = (DistanceResidual(first="A", second="B", length=12.5, measured=12.51, difference=0.004, predicted=0.003),)
    assert adjustment_grids(precision(), rows)[2].rows == (("A", "B", "control", 12.51, 12.5, 0.004, 0.003),)


def test_an_antenna_that_is_exactly_known_has_no_standard_errors():
    grid = adjustment_grids(precision(lever_arm=(0.1, 0.2, 0.3)), ())[3]
    assert grid.rows == (("antenna from the projection centre: right, up, backwards", 0.1, 0.2, 0.3, None, None, None),)


def test_shift_and_antenna_are_shown_with_their_standard_errors():
    found = precision(
        gnss_shift=(3.0, -2.0, 5.0), gnss_shift_sigma=(0.1, 0.1, 0.2), lever_arm=(0.1, 0.2, 0.3), lever_arm_sigma=(1, 1, 1)
    )
    shift, antenna = adjustment_grids(found, ())[3].rows
    assert shift[1:] == (3.0, -2.0, 5.0, 0.1, 0.1, 0.2) and antenna[4:] == (1.0, 1.0, 1.0)


def test_each_of_several_antennas_has_a_row():
    arms = tuple(LeverArm(receiver=name, value=(0.1, 0.2, 0.3), sigma=(0.01,) * 3) for name in ("no1", ""))
    first, second = adjustment_grids(precision(lever_arms=arms), ())[3].rows
    assert first == ("antenna of no1: right, up, backwards", 0.1, 0.2, 0.3, 0.01, 0.01, 0.01)
    assert second[0].startswith("antenna of photographs without serial number")


def test_a_block_without_antenna_has_no_row():
    assert adjustment_grids(precision(), ())[3].rows == ()
