"""The project's reference system: known coordinates, and a sentence for every system that cannot be used."""

import numpy as np
import pytest

from orthomill.schemas.errors import WorkflowError
from orthomill.tasks.geometry.reference_system import AREA_MARGIN, ground_coordinates, ground_crs


def test_utm_of_the_equator_at_the_central_meridian():
    assert ground_coordinates("EPSG:32634", np.array([[21.0, 0.0]]))[0] == pytest.approx((500000.0, 0.0), abs=1e-4)


def test_northing_is_the_meridian_arc_times_the_scale_of_the_central_meridian():
    """The arc of WGS 84 from the equator to 45 degrees is 4 984 944.378 m (Snyder 1987, series 3-21); UTM takes 0.9996 of it."""
    x, y = ground_coordinates("EPSG:32634", np.array([[21.0, 45.0]]))[0]
    assert (x, y) == pytest.approx((500000.0, 0.9996 * 4984944.378), abs=1e-3)


def test_the_southern_zones_have_a_false_northing():
    x, y = ground_coordinates("EPSG:32734", np.array([[21.0, -45.0]]))[0]
    assert (x, y) == pytest.approx((500000.0, 1e7 - 0.9996 * 4984944.378), abs=1e-3)


def test_the_horizontal_part_of_a_compound_system_counts():
    assert ground_crs("EPSG:32634+5773").equals(ground_crs("EPSG:32634"))
    here = np.array([[22.9, 39.4]])
    np.testing.assert_array_equal(ground_coordinates("EPSG:32634+5773", here), ground_coordinates("EPSG:32634", here))


def test_the_horizontal_part_of_a_system_with_heights_above_the_ellipsoid_counts():
    assert ground_crs("EPSG:32634+4979").equals(ground_crs("EPSG:32634"))
    here = np.array([[22.9, 39.4]])
    np.testing.assert_array_equal(ground_coordinates("EPSG:32634+4979", here), ground_coordinates("EPSG:32634", here))
    with pytest.raises(WorkflowError, match="is for longitudes 18 to 24"):
        ground_coordinates("EPSG:32634+4979", np.array([[-60.0, 39.4]]))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("EPSG:999999", "crs: EPSG:999999 is not known to PROJ"),
        ("the usual one", "is not known to PROJ; give a projected one"),
        ("EPSG:4326", r"\(WGS 84\) is not projected: its coordinates are in degrees"),
        ("EPSG:4978", "is not projected: its coordinates are in metres"),
        ("EPSG:2263", "is not in metres but in US survey feet"),
        ("EPSG:2222", "is not in metres but in feet"),
    ],
)
def test_a_system_that_cannot_be_used_is_refused(text, sentence):
    with pytest.raises(WorkflowError, match=sentence):
        ground_crs(text)


def test_photographs_in_another_part_of_the_world_refuse_the_system():
    with pytest.raises(
        WorkflowError, match=r"for longitudes 19.* but photographs were taken at longitude -3\.7000, latitude 40\.4000"
    ):
        ground_coordinates("EPSG:2100", np.array([[22.9, 39.4], [-3.7, 40.4]]))


def test_photographs_next_to_the_area_of_use_are_accepted():
    """Greece ends at 28.3 degrees east; AREA_MARGIN more is a neighbouring country."""
    near = np.array([[28.3 + 0.9 * AREA_MARGIN, 37.0]])
    assert np.isfinite(ground_coordinates("EPSG:2100", near)).all()


def test_an_area_across_the_date_line_refuses_nobody():
    """New Zealand's offshore system has west > east: no box to compare with."""
    crs = ground_crs("EPSG:3832")
    assert crs.area_of_use is not None and crs.area_of_use.west > crs.area_of_use.east
    assert np.isfinite(ground_coordinates("EPSG:3832", np.array([[-179.0, 10.0], [179.0, 10.0]]))).all()


def test_positions_that_the_projection_does_not_reach_are_named():
    with pytest.raises(WorkflowError, match=r"is not defined at longitude 0\.0000, latitude -30\.0000"):
        ground_coordinates("+proj=gnom +lat_0=90 +lon_0=0 +datum=WGS84 +units=m", np.array([[0.0, 60.0], [0.0, -30.0]]))
