"""What is drawn of a block: counts, means and places that can be computed by hand."""

from dataclasses import replace

import numpy as np
import pytest

from orthomill.schemas.orientation import GroundResiduals
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.orientation.examined.overlap_map import CENTRE, OUTLINE, SIDE, _ground_map, outline, overlap_map
from orthomill.tasks.orientation.examined.residual_places import ARROWS_SHOWN, PHOTOS_SHOWN
from orthomill.tasks.orientation.report.block_charts import block_charts
from orthomill.tasks.orientation.report.overlap_picture import overlap_picture


def chart(facts, title):
    return next(chart for chart in block_charts(facts) if chart.title == title)


def test_the_histogram_counts_every_used_residual(facts):
    drawn = chart(facts, "Image residuals")
    assert sum(drawn.series["col"]) == sum(drawn.series["row"]) == len(facts.image)
    assert drawn.x[int(np.argmax(drawn.series["col"]))] == pytest.approx(0.3, abs=0.06)
    assert drawn.x[int(np.argmax(drawn.series["row"]))] == pytest.approx(-0.4, abs=0.06)


def test_rejected_residuals_are_not_drawn(facts):
    used = facts.image.used.copy()
    used[:10] = False
    assert sum(chart(replace(facts, image=replace(facts.image, used=used)), "Image residuals").series["col"]) == len(used) - 10


def test_residuals_by_photograph_carry_the_names(facts, with_block):
    first, second = facts.block.photos
    drawn = chart(with_block(photos=(first.model_copy(update={"residual_px": None}), second)), "Image residuals by photograph")
    assert drawn.labels == ("b",) and drawn.series["rms"] == (0.5,) and drawn.x == (1.0,)


def test_mean_residuals_of_a_constant_displacement_are_that_displacement(facts):
    image = facts.image.take(np.repeat(np.arange(len(facts.image)), 2))
    drawn = chart(replace(facts, image=image), "Mean image residuals over the frame, camera cam")
    assert np.allclose(drawn.series["dx"], 0.3) and np.allclose(drawn.series["dy"], 0.4)
    assert "the longest is 0.50 px" in drawn.caption
    assert np.abs(drawn.x).max() < 500 and np.abs(drawn.series["y"]).max() < 500


def test_areas_with_one_or_two_residuals_are_left_out(facts):
    own = facts.image.take(facts.image.photo == 0)
    assert len(chart(replace(facts, image=own), "Mean image residuals over the frame, camera cam").x) == 0


def test_a_camera_without_residuals_has_no_arrows(facts):
    empty = replace(facts, image=facts.image.take(np.zeros(len(facts.image), bool)))
    titles = [chart.title for chart in block_charts(empty)]
    assert not any(title.startswith(("Mean image residuals", "Image residuals of")) for title in titles)
    assert "Photographs that share tie points" not in titles


def test_the_worst_photographs_come_first(facts, with_block):
    first, second = facts.block.photos
    charts = block_charts(with_block(photos=(first, second.model_copy(update={"residual_px": 0.9}))))
    shown = [chart.title for chart in charts if chart.title.startswith("Image residuals of")]
    assert shown == ["Image residuals of b", "Image residuals of a"] and len(shown) <= PHOTOS_SHOWN


def test_many_residuals_of_a_photograph_are_thinned(facts):
    many = facts.image.take(np.repeat(np.flatnonzero(facts.image.photo == 0), 20))
    drawn = chart(replace(facts, image=many), "Image residuals of a")
    assert len(drawn.x) == len(drawn.series["dx"]) == ARROWS_SHOWN


def test_single_residuals_point_up_where_rows_decrease(facts):
    drawn = chart(facts, "Image residuals of a")
    assert np.allclose(drawn.series["dy"], 0.4) and max(drawn.series["y"]) == pytest.approx(999 / 2 - 1000 / 12)


def test_a_line_joins_photographs_by_the_class_of_their_common_tie_points(facts):
    drawn = chart(facts, "Photographs that share tie points")
    assert list(drawn.series) == ["30 to 99"]
    assert drawn.x[:2] == (0.0, 20.0) and np.isnan(drawn.x[2])
    few = facts.image.take((facts.image.photo == 0) | (facts.image.track < 7))
    assert list(chart(replace(facts, image=few), "Photographs that share tie points").series) == ["fewer than 30"]


def test_surveyed_points_connect_no_photographs(facts):
    image = replace(facts.image, track=-1 - facts.image.track)
    assert "Photographs that share tie points" not in [chart.title for chart in block_charts(replace(facts, image=image))]


def test_the_map_names_photographs_and_surveyed_points(facts):
    drawn = chart(facts, "Projection centres and ground points")
    assert drawn.labels == ("a", "b", "C0", "C1", "C2", "C3", "K1")
    assert drawn.x[1] == 20.0 and drawn.series["y"][2] == -45.0


def test_check_points_are_drawn_where_they_lie(facts):
    drawn = chart(facts, "Check points: differences in plan")
    assert drawn.x == (10.0,) and drawn.series == {"y": (0.0,), "dx": (0.03,), "dy": (-0.04,)}
    without = replace(facts, ground=GroundResiduals())
    assert "Check points: differences in plan" not in [chart.title for chart in block_charts(without)]


def test_the_footprint_of_a_vertical_photograph_is_its_frame_on_the_ground(facts):
    """The outer pixel centres of 1000 x 1000 pixels at c = 1000 px, 100 m above the ground: 99.9 m."""
    places = outline(block_view(facts.block, "a"), 0.0)
    assert np.ptp(places, axis=0) == pytest.approx([99.9, 99.9])
    assert np.abs(places).max() == pytest.approx(49.95)


def test_the_footprint_of_an_oblique_photograph_ends_before_the_horizon(facts, with_block):
    first, second = facts.block.photos
    oblique = with_block(photos=(first.model_copy(update={"omega_phi_kappa": (70.0, 0.0, 0.0)}), second)).block
    places = outline(block_view(oblique, "a"), 0.0)
    assert np.linalg.norm(places, axis=1).max() <= 300.0 + 1e-9


def test_the_overlap_map_shows_both_and_single_coverage(facts):
    drawn = overlap_map(facts.block)
    counts = [int((drawn == k).sum()) for k in range(3)]
    assert counts[2] / (counts[1] + counts[2]) == pytest.approx(80 / 120, abs=0.03)
    assert (drawn == CENTRE).sum() == 2 * 9 and (drawn == OUTLINE).any() and drawn.shape == (SIDE, SIDE)


@pytest.mark.parametrize("turned", [(0.0, 0.0, 30.0), (25.0, -10.0, 0.0), (70.0, 0.0, 0.0)])
def test_the_overlap_map_counts_every_photograph_wherever_it_looks(facts, with_block, turned):
    """By all places of the map in all photographs: near outlines, far ones that are cut off, and places beyond those."""
    first, second = facts.block.photos
    block = with_block(photos=(first.model_copy(update={"omega_phi_kappa": turned}), second)).block
    views, drawn = [block_view(block, name) for name in block.names], overlap_map(block)
    ground = _ground_map(block, views, [outline(one, block.ground_mean) for one in views])
    places = np.column_stack([ground.places(), np.full(SIDE * SIDE, block.ground_mean)])
    seen = np.sum([one.contains(one.project(places)) for one in views], axis=0).reshape(SIDE, SIDE)
    counted = drawn < OUTLINE
    assert (drawn[counted] == seen[counted]).all() and (seen[counted] > 0).any()


def test_the_picture_says_how_wide_it_is(facts):
    """119.9 m of footprints with a margin of 3 % on either side."""
    assert "127.1 m wide" in overlap_picture(facts.block).caption


def test_of_a_wall_the_map_shows_the_area_of_its_surface(facts, with_block):
    """Photographs that look along a wall show much more of its plane than is wall."""
    wall = with_block(area=(-10.0, -5.0, 30.0, 5.0)).block
    caption = overlap_picture(wall).caption
    centres = np.array([photo.centre[:2] for photo in wall.photos])
    wide = 1.06 * np.ptp(np.vstack([centres, [(-10.0, -5.0), (30.0, 5.0)]]), axis=0).max()
    assert "the surface's plane, seen from its front" in caption and f"{wide:.4g} m wide" in caption
    assert (overlap_map(wall) == 2).mean() > (overlap_map(facts.block) == 2).mean(), "no border around the footprints"
