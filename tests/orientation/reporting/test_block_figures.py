"""The figures of a block, from numbers that are known beforehand."""

from dataclasses import replace

import numpy as np
import pytest

from orthomill.schemas.camera import Cameras
from orthomill.schemas.orientation import GroundResidual, GroundResiduals
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.examined.block_facts import filled_areas
from orthomill.tasks.orientation.examined.block_numbers import exterior_sigmas
from orthomill.tasks.orientation.examined.photographed_surface import coverage
from orthomill.tasks.orientation.report.block_figures import block_figures


def values(facts):
    return {figure.name: figure.value for figure in block_figures(facts)}


def test_photographs_are_counted(facts):
    found = values(facts)
    assert (found["photos_oriented"], found["photos_unoriented"]) == (2, 0)
    assert found["datum"] == facts.block.datum


def test_sigma0_is_stated_in_pixels_and_on_the_sensor(facts):
    found = values(facts)
    assert found["sigma0_px"] == 0.5
    assert found["sigma0_um"] == pytest.approx(0.5 * 5.0)
    assert found["sigma0_factor"] == 1.1


def test_cameras_of_different_pixels_have_no_common_sigma0_in_micrometres(facts, with_block):
    camera = facts.block.cameras["cam"]
    other = camera.model_copy(update={"name": "other", "pixel_um": 7.0})
    assert values(with_block(cameras={"cam": camera, "other": other}))["sigma0_um"] is None
    assert values(with_block(cameras={"cam": camera.model_copy(update={"pixel_um": None})}))["sigma0_um"] is None


def test_a_block_without_measurements_has_no_estimated_sigma0(facts):
    found = values(replace(facts, image=facts.image.take(np.zeros(len(facts.image), bool))))
    assert found["sigma0_px"] is None and found["sigma0_um"] is None


def test_correlated_image_errors_are_a_figure_in_pixels_and_percent(facts, with_precision):
    assert values(facts)["common_errors_px"] is None and values(facts)["common_errors_of_camera"] is None
    found = values(with_precision(common_px=0.7, common_share=0.25))
    assert (found["common_errors_px"], found["common_errors_of_camera"]) == (0.7, 25.0)


def test_observations_are_counted(facts):
    found = values(facts)
    assert (found["redundancy"], found["iterations"]) == (100, 7)
    assert (found["tie_points"], found["rays_per_point"]) == (40, 2.0)
    assert (found["image_measurements"], found["image_measurements_rejected"]) == (72, 3)


def test_no_tie_points_have_no_mean_number_of_rays(facts):
    assert values(replace(facts, points=facts.points.take(np.zeros(40, bool))))["rays_per_point"] is None


def test_standard_errors_in_plan_are_those_of_both_coordinates(facts):
    found = values(facts)
    assert found["centre_sigma_plan"] == pytest.approx(np.hypot(0.3, 0.4))
    assert found["centre_sigma_height"] == pytest.approx(0.2)
    assert found["ground_sigma_plan"] == pytest.approx(np.hypot(0.03, 0.04))
    assert found["ground_sigma_height"] == pytest.approx(0.06)


def test_unknown_standard_errors_leave_the_figure_empty(facts, with_block):
    unknown = tuple(photo.model_copy(update={"covariance": None}) for photo in facts.block.photos)
    found = values(with_block(photos=unknown))
    assert found["centre_sigma_plan"] is None and found["centre_sigma_height"] is None
    assert np.isnan(exterior_sigmas(unknown[0])).all()


def test_the_median_leaves_out_photographs_of_unknown_precision(facts, with_block):
    first, second = facts.block.photos
    found = values(with_block(photos=(first.model_copy(update={"covariance": None}), second)))
    assert found["centre_sigma_height"] == pytest.approx(0.2)


def test_angles_have_standard_errors_in_degrees(facts):
    assert np.allclose(exterior_sigmas(facts.block.photos[0])[3:], np.degrees(1e-4))


def test_differences_at_check_points_are_root_mean_squares(facts):
    found = values(facts)
    assert found["check_count"] == 1
    assert found["check_rmse_plan"] == pytest.approx(0.05)
    assert found["check_rmse_height"] == pytest.approx(0.1)
    assert found["check_by_predicted"] == pytest.approx(np.sqrt((0.3**2 + 0.4**2 + 1.0**2) / 3))


def test_only_check_points_are_headlines_of_accuracy(facts):
    headlines = {figure.name for figure in block_figures(facts) if figure.headline}
    assert headlines == {"photos_oriented", "sigma0_px", "check_rmse_plan", "check_rmse_height"}


def test_positions_are_told_under_the_name_of_their_source(facts):
    rows = tuple(row.model_copy(update={"role": "position"}) for row in facts.ground.points)
    found = values(replace(facts, ground=facts.ground.model_copy(update={"points": rows})))
    assert found["gnss_count"] == 5 and "check_count" not in found and "control_count" not in found


def test_the_height_system_is_named_or_said_to_be_unknown(facts, with_block):
    assert values(facts)["height_reference"] == "not stated"
    assert values(with_block(crs="EPSG:2100+5773"))["height_reference"] != "not stated"


def test_coverage_is_that_of_two_overlapping_squares(facts):
    """Footprints of 100 m side, 20 m apart: 80 m of 120 m are seen twice."""
    by_two, by_three = coverage(facts)
    assert by_two == pytest.approx(100 * 80 / 120, abs=2.0) and by_three == 0.0


def test_photographs_that_look_up_cover_nothing(facts, with_block):
    up = tuple(photo.model_copy(update={"omega_phi_kappa": (180.0, 0.0, 0.0)}) for photo in facts.block.photos)
    assert coverage(with_block(photos=up)) == (0.0, 0.0)


@pytest.mark.parametrize(("share", "areas"), [(1.0, 9), (2 / 3, 6), (1 / 3, 3)])
def test_areas_with_points_are_counted(facts, share, areas):
    camera, image = facts.block.cameras["cam"], facts.image
    assert filled_areas(image.take(image.col < share * camera.width), camera) == areas


def test_a_camera_that_is_not_in_the_calibration_is_compared_with_itself(facts):
    assert values(replace(facts, before=Cameras(cameras={}, of_photo={})))["photos_oriented"] == 2


@pytest.mark.parametrize("turn", [0.0, 90.0])
def test_the_overlap_of_a_facade_is_that_of_the_same_block_over_a_field(facts, turn):
    """The block turned about the X axis: a facade 100 m high, on a level plane of which nothing overlaps."""
    R = rotation_matrix(np.radians(turn), 0.0, 0.0)
    photos = tuple(
        photo.model_copy(update={"centre": tuple(np.array(photo.centre) @ R), "omega_phi_kappa": (turn, 0.0, 0.0)})
        for photo in facts.block.photos
    )
    x, y, z = R.T @ [facts.points.x, facts.points.y, facts.points.z]
    upright = replace(facts, block=facts.block.model_copy(update={"photos": photos}), points=replace(facts.points, x=x, y=y, z=z))
    assert coverage(upright)[0] == pytest.approx(100 * 80 / 120, abs=2.0)


def test_a_block_without_points_has_no_known_surface(facts):
    assert coverage(replace(facts, points=facts.points.take(np.zeros(40, bool)))) == (0.0, 0.0)


def test_a_point_that_took_no_part_does_not_count_as_misfit(facts, with_precision):
    rows = [
        GroundResidual(name=name, role="control", difference=(off, off, off), predicted=(0.01, 0.01, 0.01), photos=3)
        for name, off in (("good", 0.01), ("wrong", 5.0))
    ]
    spoilt = replace(facts, ground=GroundResiduals(points=tuple(rows)))
    assert values(spoilt)["control_by_predicted"] > 100
    found = values(replace(with_precision(blunders=("wrong",)), ground=spoilt.ground))
    assert found["control_by_predicted"] == pytest.approx(1.0) and found["control_count"] == 1
