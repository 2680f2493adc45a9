"""Every setting of the choice of pairs, and of the heights that they must cover, changes the pairs as its sentence says."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from memory_runner import MemoryProject
from pydantic import ValidationError
from tiny_block import BASE, FLYING, HEIGHT, block, photograph, photos, tie_points

from orthomill.schemas.epipolar import PAIRS, EpipolarPairs, epipolar_raster
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.observations import IMAGE_RESIDUALS
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS, photo_raster
from orthomill.schemas.raster import RasterSpec
from orthomill.tasks.epipolar.pair_choice import PairChoice
from orthomill.tasks.epipolar.selection import (
    Candidate,
    Places,
    best_pairs,
    candidates,
    choose_pairs,
    footprint,
    seen_places,
    why_not,
)
from orthomill.tasks.epipolar.stage import EpipolarStage
from orthomill.tasks.geometry.epipolar_window import left_pixels
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View, block_view


def level_view(name="v", x=0.0, y=0.0, z=500.0, omega=0.0) -> View:
    camera = block().cameras["tiny"].changed(x0=0.0, y0=0.0, k1=0.0, k2=0.0, p1=0.0, p2=0.0)
    return View(name, camera, rotation_matrix(np.radians(omega), 0.0, 0.0), np.array([x, y, z]))


def names(**settings_) -> set[str]:
    return {pair.name for pair in choose_pairs(block(), PairChoice(**settings_), 0.08).pairs}


def test_base_height_low_leaves_flat_intersections_out():
    """Neighbours in a strip have base over height 110 / 400 = 0.27, across strips 105 / 400."""
    assert "a1-a2" in names() and BASE / FLYING < 0.3
    diagonal = {"a1-b2", "b2-a1", "b1-a2", "a2-b1", "a2-b3", "b3-a2", "b2-a3", "a3-b2"}
    steeper = names(base_height_low=0.32)
    assert "a1-a2" not in steeper and steeper <= diagonal and steeper


def test_base_height_high_leaves_steep_intersections_out():
    flatter = names(base_height_high=0.32, per_place=9)
    assert "a1-a2" in flatter and "b1-a2" in names(per_place=9) - flatter
    with pytest.raises(GeometryError, match=r"above 0\.2"):
        choose_pairs(block(), PairChoice(base_height_high=0.2), 0.08)


@pytest.mark.parametrize("most", [1, 2, 3])
def test_per_photo_limits_the_pairs_of_a_photograph(most):
    pairs = choose_pairs(block(), PairChoice(per_photo=most), 0.08)
    count = {name: sum(name in (p.left, p.right) for p in pairs.pairs) for name in block().names}
    assert min(count.values()) >= 1
    assert len(pairs.pairs) < len(choose_pairs(block(), PairChoice(per_photo=most + 1), 0.08).pairs)
    assert any(f"already has {most} better pairs" in reason for _, reason in pairs.not_used)


def test_per_place_leaves_out_pairs_whose_ground_has_enough():
    few, all_ = (choose_pairs(block(), PairChoice(per_place=most), 0.08) for most in (1, 9))
    assert len(few.pairs) < len(all_.pairs)
    assert any("most of its ground lies under 1 better pairs" in reason for _, reason in few.not_used)


def test_places_are_those_of_the_footprint():
    """Squares of the ground: their number is the area, and two photographs share what their footprints share."""
    one, other, horizon = seen_places([level_view("l"), level_view("r", x=100.0), level_view("h", omega=80.0)], 50.0)
    assert len(one) == pytest.approx(100, abs=12) and len(other) == pytest.approx(100, abs=12) and not horizon
    width = 479 * 450 / 700
    assert len(one & other) / len(one) == pytest.approx((width - 100) / width, abs=0.12)


def test_places_just_below_the_horizon_are_not_counted():
    """A footprint of hundreds of kilometres in units of a tenth of the vertical one; an ordinary oblique one is not cut."""
    steep, oblique, flat = level_view("s"), level_view("o", omega=50.0), level_view("f", omega=71.8)
    areas = [footprint(view, 50.0, np.zeros(2)).area for view in (steep, oblique, flat)]
    assert areas[2] > 100_000 * areas[0], "what this test is about: 100 million places"
    counts = [len(places) for places in seen_places([steep, oblique, flat], 50.0)]
    assert counts[1] == pytest.approx(100 * areas[1] / areas[0], rel=0.12) and counts[1] < counts[2] < 2500


@settings(max_examples=50, deadline=None)
@given(
    scores=st.lists(
        st.tuples(st.integers(0, 7), st.integers(0, 7), st.floats(0.1, 1.0)).filter(lambda p: p[0] < p[1]), min_size=1, max_size=20
    ),
    most=st.integers(1, 4),
)
def test_every_photograph_with_a_partner_gets_a_pair(scores, most):
    useful = [Candidate(a, b, s, 1.0, 0.0, 1.0) for a, b, s in {(a, b): (a, b, s) for a, b, s in scores}.values()]
    kept = best_pairs(useful, np.random.default_rng(most).normal(size=(8, 3)), [Places()] * 8, PairChoice(per_photo=most))
    assert {n for c in kept for n in (c.first, c.second)} == {n for c in useful for n in (c.first, c.second)}
    assert len({(c.first, c.second) for c in kept}) == len(kept)


def test_footprint_and_ground_pixel_of_a_vertical_photograph():
    """480 x 460 px at c = 700 px from 450 m: the ground pixel is 450 / 700 m."""
    view = level_view(z=500.0)
    ground = footprint(view, 50.0, np.zeros(2))
    assert ground.pixel == pytest.approx(450 / 700, rel=0.005)
    assert ground.area == pytest.approx(479 * 459 * (450 / 700) ** 2, rel=1e-4)
    assert footprint(level_view(omega=80.0), 50.0, np.zeros(2)) is None


def test_the_geometry_of_a_candidate():
    """Two vertical photographs, 100 m apart along x: 479 columns of 450 / 700 m overlap but for 100 m."""
    (pair,) = candidates([level_view("l"), level_view("r", x=100.0)], 50.0)
    width = 479 * 450 / 700
    assert pair.overlap == pytest.approx((width - 100) / width, rel=1e-3)
    assert pair.base_height == pytest.approx(100 / 450, rel=0.01)
    assert pair.convergence == pytest.approx(0.0, abs=1e-4) and pair.scale == pytest.approx(1.0)
    assert pair.score == pair.overlap * pair.base_height


def test_only_the_base_across_the_view_counts():
    (above,) = candidates([level_view("l"), level_view("r", z=600.0)], 50.0)
    assert above.base_height == pytest.approx(0.0, abs=1e-9) and above.scale == pytest.approx(550 / 450, rel=1e-3)
    assert "base/height" in why_not(above, PairChoice())


def test_convergence_and_scale_are_settings():
    tilted = Candidate(0, 1, 0.6, 0.5, 30.0, 1.4)
    assert why_not(tilted, PairChoice()) is None
    assert "30 degrees apart, more than 20" in why_not(tilted, PairChoice(convergence=20.0))
    assert "factor 1.4, more than 1.2" in why_not(tilted, PairChoice(scale=1.2))


def test_photographs_without_common_ground_are_no_candidates():
    assert candidates([level_view("l"), level_view("r", x=2000.0)], 50.0) == []


@pytest.mark.parametrize("wrong", [{"overlap": 0}, {"per_photo": 0}, {"convergence": 120}, {"scale": 0.5}, {"base_height_low": 0}])
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ValidationError):
        PairChoice(**wrong)


def chosen(**settings_) -> EpipolarPairs:
    """The pairs that the stage's first job chooses."""
    project = MemoryProject(128)
    job = next(iter(EpipolarStage(**settings_).plan(project)))
    return job.function(block=block(), measured=tie_points(0.1), photos=photos(), **job.params)


def parallax_span(found: EpipolarPairs) -> tuple[float, float]:
    pair = next(p for p in found.pairs if p.name == "a1-a2")
    return pair.parallax_low, pair.parallax_high


def test_height_margin_widens_the_parallaxes_both_ways():
    (low, high), (lower, higher) = (parallax_span(chosen(height_margin=m, height_room=0.0)) for m in (0.02, 0.2))
    assert lower < low - 5 and higher > high + 5


def test_height_room_widens_the_parallaxes_of_high_objects_only():
    (low, high), (lower, higher) = (parallax_span(chosen(height_margin=0.0, height_room=r)) for r in (0.0, 100.0))
    assert higher > high + 20
    assert lower == pytest.approx(low, abs=8), "the frames that both photographs must show change a little with the range"


def test_heights_are_those_of_the_block_plus_the_margin():
    """The mean base of 110 m at c = 700 px: parallax 110 * 700 / depth."""
    low, high = parallax_span(chosen(height_margin=0.0, height_room=0.0))
    pair = next(p for p in chosen(height_margin=0.0, height_room=0.0).pairs if p.name == "a1-a2")
    depth = pair.base * pair.c / np.array([low, high])
    centre = pair.left_centre[2]
    assert centre - depth[0] == pytest.approx(HEIGHT - 8, abs=12) and centre - depth[1] == pytest.approx(HEIGHT + 8, abs=12)


@pytest.fixture(scope="module", params=["bicubic", "bilinear"])
def images(request):
    """The stage run in memory on a pair, with either interpolation."""
    project = MemoryProject(256)
    project.tables = {BLOCK.path: block(), PHOTOS.path: photos(), IMAGE_RESIDUALS.path: tie_points(0.1)}
    for name in block().names:
        project.specs[photo_raster(name)] = RasterSpec(name=photo_raster(name), shape=(460, 480, 1), dtype="uint8", chunk=256)
        project.put(photo_raster(name), photograph(name))
    project.run(EpipolarStage(interpolation=request.param, pairs=PairChoice(per_photo=1)))
    return request.param, project


def test_interpolation_reaches_the_tiles(images):
    kind, project = images
    for job in EpipolarStage(interpolation=kind, pairs=PairChoice(per_photo=1)).plan(project):
        if getattr(job, "item", "").endswith("-left"):
            assert job.params["bicubic"] == (kind == "bicubic")


def test_the_stage_writes_both_images_of_every_pair(images):
    _, project = images
    pairs = project.tables[PAIRS.path].pairs
    for pair in pairs:
        for side in ("left", "right"):
            image = project.rasters[epipolar_raster(pair.name, side)]
            assert image.dtype == np.uint8 and 0.3 < (image > 0).mean() <= 1.0
            assert project.written[epipolar_raster(pair.name, side)].all()
    assert len({name for pair in pairs for name in (pair.left, pair.right)}) == 6


def test_the_views_of_the_block_are_those_of_the_pairs():
    for pair in choose_pairs(block(), PairChoice(), 0.08).pairs:
        left, right = block_view(block(), pair.left), block_view(block(), pair.right)
        assert np.allclose(pair.left_centre, left.centre) and np.allclose(pair.right_centre, right.centre)
        assert pair.base == pytest.approx(np.linalg.norm(right.centre - left.centre))


def test_images_are_cut_to_the_area_that_is_wanted():
    whole = choose_pairs(block(), PairChoice(), 0.08)
    low, high = whole.heights
    ground = np.array([photo.centre for photo in block().photos]).mean(axis=0)
    area = (ground[0] - 20.0, ground[1] - 20.0, ground[0] + 20.0, ground[1] + 20.0)
    cut = choose_pairs(block(), PairChoice(), 0.08, area=area)
    whole_of = {pair.name: pair for pair in whole.pairs}
    assert cut.pairs and sum(p.rows * p.left_cols for p in cut.pairs) < 0.7 * sum(p.rows * p.left_cols for p in whole.pairs)
    for pair in cut.pairs:
        same = whole_of[pair.name]
        place = np.array([[ground[0], ground[1], 0.5 * (low + high)]])
        shift = np.array([same.left_col0 - pair.left_col0, same.row0 - pair.row0])
        assert left_pixels(pair, place) == pytest.approx(left_pixels(same, place) - shift)
        assert (left_pixels(pair, place) >= 0).all() and (left_pixels(pair, place) < (pair.left_cols, pair.rows)).all()
    with pytest.raises(GeometryError, match="sees nothing of the area"):
        choose_pairs(block(), PairChoice(), 0.08, area=(0.0, 0.0, 1.0, 1.0))
