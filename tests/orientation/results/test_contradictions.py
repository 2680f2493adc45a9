"""Which observations are blamed for a contradiction, from residuals that are known beforehand."""

from types import SimpleNamespace

import numpy as np
import pytest

from orthomill.schemas.findings.observation_findings import (
    ControlContradicted,
    DistanceContradicted,
    PositionContradicted,
    PositionsAlongView,
    PositionsElsewhere,
)
from orthomill.schemas.orientation import DistanceResidual, GroundResidual
from orthomill.tasks.orientation.results.contradictions import SINGLE, _distance, _points_left_out, _ratio, _within_frame


def looking(axis, photos=6):
    """Block results of photographs whose image z axis, which points away from the ground, is `axis`."""
    rotation = np.tile(np.eye(3), (photos, 1, 1))
    rotation[:, 2] = np.array(axis) / np.linalg.norm(axis)
    return SimpleNamespace(result=SimpleNamespace(state=SimpleNamespace(rotation=rotation)))


def left_out(name, difference, role="position", sigma=0.1):
    return GroundResidual(name=name, role=role, difference=difference, predicted=(sigma,) * 3, photos=1)


@pytest.mark.parametrize(("size", "told"), [(41.5, 41.5), (499.0, 499.0), (501.0, None), (1e6, None)])
def test_a_measurement_that_is_off_by_more_than_the_frame_has_no_misfit_in_pixels(size, told):
    """A frame of 300 x 400 px has a diagonal of 500; a point behind the camera has a misfit of any size."""
    rays = SimpleNamespace(photo=np.array([0, 1]))
    cameras = [SimpleNamespace(width=9000, height=9000), SimpleNamespace(width=300, height=400)]
    problem = SimpleNamespace(rays=rays, cameras=cameras, camera_of=np.array([0, 1]))
    assert _within_frame(problem, 1, size) == told


def positions(count, difference):
    return [left_out(f"p{i}", difference) for i in range(count)]


def found(rows, axis=(0.0, 0.0, 1.0)):
    return list(_points_left_out(looking(axis), rows))


def test_the_ratio_is_that_of_the_worst_coordinate():
    row = GroundResidual(name="p", role="control", difference=(1.0, -6.0, 2.0), predicted=(1.0, 2.0, 4.0), photos=2)
    assert _ratio(row) == 3.0


def test_control_points_are_blamed_one_by_one():
    rows = [left_out(f"C{i}", (0.5, 0.0, 0.0), role="control") for i in range(8)]
    assert found(rows) == [ControlContradicted(point=f"C{i}", difference=(0.5, 0.0, 0.0), ratio=5.0) for i in range(8)]


@pytest.mark.parametrize("count", [1, 2, 3, SINGLE])
def test_a_few_positions_are_blamed_one_by_one(count):
    rows = positions(count, (5.0, 0.0, 0.0))
    assert found(rows) == [PositionContradicted(photo=f"p{i}", difference=(5.0, 0.0, 0.0), ratio=50.0) for i in range(count)]


def test_many_positions_are_blamed_together():
    assert found(positions(SINGLE + 1, (3.0, 4.0, 0.0))) == [PositionsElsewhere(photos=6, distance_m=5.0)]


def test_one_stray_position_does_not_change_where_the_others_lie():
    rows = [*positions(6, (3.0, 4.0, 0.0)), left_out("stray", (1e6, 0.0, 0.0))]
    assert found(rows) == [PositionsElsewhere(photos=7, distance_m=5.0)]


@pytest.mark.parametrize("count", [3, 6])
def test_positions_off_along_the_view_point_to_heights_or_the_camera_constant(count):
    assert found(positions(count, (1.0, 0.0, -40.0))) == [PositionsAlongView(photos=count, along_m=-40.0)]


def test_the_viewing_direction_counts_and_not_the_vertical():
    (finding,) = found(positions(3, (40.0, 0.0, 0.0)), axis=(1.0, 0.0, 0.0))
    assert finding == PositionsAlongView(photos=3, along_m=40.0)


def test_two_positions_show_no_common_direction():
    assert [type(one) for one in found(positions(2, (0.0, 0.0, -40.0)))] == [PositionContradicted] * 2


def test_control_is_named_before_positions():
    rows = [*positions(1, (5.0, 0.0, 0.0)), left_out("C", (5.0, 0.0, 0.0), role="control")]
    assert [type(one) for one in found(rows)] == [ControlContradicted, PositionContradicted]


def distance(difference, predicted=0.01):
    return DistanceResidual(first="A", second="B", length=10.0, difference=difference, predicted=predicted)


@pytest.mark.parametrize(
    ("difference", "excluded", "enlarged", "outcome"),
    [
        (0.03, False, False, None),
        (0.05, False, False, "undecided"),
        (-0.05, False, False, "undecided"),
        (0.5, True, False, "excluded"),
        (0.01, True, False, "excluded"),
        (0.01, False, True, "downweighted"),
        (0.5, True, True, "downweighted"),
    ],
)
def test_the_outcome_of_a_distance(difference, excluded, enlarged, outcome):
    finding = _distance(distance(difference), excluded, enlarged)
    if outcome is None:
        assert finding is None
    else:
        assert isinstance(finding, DistanceContradicted) and finding.outcome == outcome
        assert finding.ratio == pytest.approx(abs(difference) / 0.01)


def test_a_distance_that_nothing_checks_does_not_contradict_anything():
    assert _distance(distance(0.5, predicted=0.0), False, False) is None
