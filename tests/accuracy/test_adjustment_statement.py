"""The adjustment as an authority reads it: reliability of what was surveyed, groups of observations, and receivers."""

import numpy as np
import pytest
from box_scene import block as box_block

from orthomill.schemas.orientation import (
    BlockPrecision,
    DistanceResidual,
    GroundResidual,
    GroundResiduals,
    LeverArm,
    ObservationGroup,
)
from orthomill.tasks.accuracy.adjustment.adjustment_statement_of import correlations_of, state_adjustment
from orthomill.tasks.accuracy.report.adjustment_words import adjustment_grids

GROUP = ObservationGroup(name="GNSS positions", count=18, redundancy=14.0, factor=1.2)


def row(name, role, **changes):
    return GroundResidual(name=name, role=role, difference=(0, 0, 0), predicted=(0.02,) * 3, photos=3, **changes)


def distance(first, second, **changes):
    return DistanceResidual(first=first, second=second, length=10.0, difference=0.0, predicted=0.01, **changes)


def precision(**changes):
    given = {"image_factor": 1.0, "position_factor": 1.0, "control_factor": 1.0, "rays": 10, "rejected": 0}
    return BlockPrecision(**given, groups=(GROUP,), **changes)


@pytest.fixture(scope="module")
def stated():
    rows = (
        row("P1", "control", redundancy=(0.25, 1.0, 0.0), sigma=(0.02, 0.02, 0.03)),
        row("left out", "control"),
        row("photo", "position", redundancy=(0.81, 0.81, 0.64), sigma=(0.1, 0.1, 0.2)),
        row("K1", "check"),
    )
    distances = (distance("A", "B", redundancy=0.64, sigma=0.01), distance("A", "K1", role="check"))
    return state_adjustment(box_block(), GroundResiduals(points=rows, distances=distances), precision(lever_arm=(0.0, 0.1, 0.2)))


def test_the_smallest_error_found_and_its_effect_follow_from_the_redundancy_number(stated):
    x, y, z = stated.statement.control
    assert (x.point, x.axis, x.detectable, x.effect) == ("P1", "X", pytest.approx(0.1652), pytest.approx(0.75 * 0.1652))
    assert y.detectable == pytest.approx(4.13 * 0.02) and y.effect == 0
    assert z.detectable is None and z.effect is None, "nothing checks it"


def test_control_and_positions_that_took_part_are_rows_of_a_table(stated):
    table = stated.surveyed
    assert table.kind.tolist() == ["control"] * 3 + ["position"] * 3 + ["distance", "check distance"]
    assert set(table.name.tolist()) == {"P1", "photo", "A to B", "A to K1"}
    assert table.detectable[5] == pytest.approx(4.13 * 0.2 / 0.8) and np.isnan(table.detectable[2])


def test_a_distance_that_took_part_has_its_smallest_error_found(stated):
    (length,) = stated.statement.distances
    assert (length.point, length.axis, length.redundancy) == ("A to B", "length", 0.64)
    assert length.detectable == pytest.approx(4.13 * 0.01 / 0.8) and length.effect == pytest.approx(0.36 * length.detectable)
    *_, grid = adjustment_grids(stated.statement)
    assert grid.rows[-2][:3] == ("A to B", "length", 0.01)


def test_an_error_of_a_distance_to_a_check_point_shows_whole_and_is_not_in_the_block(stated):
    (length,) = stated.statement.check_distances
    assert (length.point, length.redundancy, length.effect) == ("A to K1", 1.0, 0.0)
    assert length.detectable == pytest.approx(4.13 * length.sigma)


def test_a_block_without_control_has_an_empty_table():
    found = state_adjustment(box_block(), GroundResiduals(), precision())
    assert len(found.surveyed.name) == 0
    assert not any("control" in grid.title for grid in adjustment_grids(found.statement))


def test_groups_and_receivers_are_stated(stated):
    statement = stated.statement
    assert statement.groups == (GROUP,)
    assert statement.lever_arms == (LeverArm(receiver="", value=(0.0, 0.1, 0.2), sigma=None),)
    assert statement.gnss_shift is None


def test_correlations_have_ones_where_there_is_a_variance():
    found = correlations_of(np.array([[4.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]]))
    assert np.array_equal(found, [[1.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 0.0]])
