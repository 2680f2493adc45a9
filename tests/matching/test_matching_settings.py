"""Every setting of point and strategy matching changes the result in the way it says."""

import numpy as np
import pytest
from known_warp import AFFINE, grid_points, noisy, texture, true_places, warped
from pydantic import ValidationError

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.dense.dense_settings import DenseMatching
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching
from orthomill.tasks.matching.least_squares.matching import Matches, match_points
from orthomill.tasks.matching.strategies.cascade import match_cascade
from orthomill.tasks.matching.strategies.cascade_settings import CascadeMatching
from orthomill.tasks.matching.strategies.coarse_to_fine import SearchRange, coarse_field, match_pyramid
from orthomill.tasks.matching.strategies.growing_settings import RegionGrowing
from orthomill.tasks.matching.strategies.node_grid import ImagePart, NodeGrid
from orthomill.tasks.matching.strategies.pyramid_settings import PyramidMatching
from orthomill.tasks.matching.strategies.region_growing import Seeds, grow
from orthomill.tasks.matching.windows.sizes import entropy_choice, grey_levels, window_sizes
from orthomill.tasks.matching.windows.window_settings import CombinedWindow, EntropyWindow

GRID = NodeGrid(5, 5, 18, 18, 8)
SEARCH = SearchRange(-22.0, 8.0, -12.0, 12.0)
INNER = np.pad(np.ones((16, 16), bool), 1).ravel()
"""nodes of the grid that have eight neighbours"""


@pytest.fixture(scope="module")
def images() -> tuple[np.ndarray, np.ndarray]:
    left = texture(200)
    return noisy(left, 1, 0, 2, 1), noisy(warped(left), 0.9, 10, 2, 2)


@pytest.fixture(scope="module")
def parts(images) -> tuple[ImagePart, ImagePart]:
    return ImagePart(images[0]), ImagePart(images[1])


def pyramid(parts, **changes) -> Matches:
    return match_pyramid(*parts, GRID, SEARCH, PyramidMatching(levels=2).model_copy(update=changes))


@pytest.fixture(scope="module")
def matched(parts) -> Matches:
    found = pyramid(parts)
    assert found.converged.mean() > 0.95
    return found


@pytest.mark.parametrize("limit", [0.005, 0.02])
def test_max_affine_step_bounds_the_affine_of_one_iteration(images, limit):
    points = grid_points(60, 140)
    one = LeastSquaresMatching(max_iterations=1, stop=1.0, max_affine_step=limit, min_correlation=-1.0)
    found = match_points(*images, points, true_places(points), one)
    change = np.abs(found.affine - [1.0, 0.0, 0.0, 1.0])[found.converged]
    # The step is composed inversely, so that it is bounded by limit / (1 - 2 limit).
    assert found.converged.mean() > 0.9 and change.max() <= limit / (1 - 2 * limit)
    assert np.median(change.max(axis=1)) > 0.9 * limit


def test_precise_decides_which_windows_are_sharpened(images):
    points = grid_points(40, 150, 10)
    shares = []
    for precise in (1e-6, 0.5):
        found = match_cascade(*images, points, true_places(points), CascadeMatching(precise=precise, max_sigma=1.0))
        shares.append((found.half[found.converged] == CascadeMatching().sharpen.half).mean())
    assert shares[0] < 0.7 and shares[1] > 0.99


def test_coarse_step_is_the_distance_of_coarse_nodes(parts):
    points = GRID.points()
    for step in (3, 6):
        assert coarse_field(*parts, points, SEARCH, PyramidMatching(levels=2, coarse_step=step)).grid.step == step


def test_the_coarse_recipe_is_used_on_the_coarser_levels(parts):
    blind = LeastSquaresMatching(min_gradient=1e4)
    seeing = coarse_field(*parts, GRID.points(), SEARCH, PyramidMatching(levels=2))
    unseeing = coarse_field(*parts, GRID.points(), SEARCH, PyramidMatching(levels=2, coarse=blind))
    assert seeing.solved.mean() > 0.4 and not unseeing.solved.any()


def test_the_fine_recipe_is_used_on_the_photographs(parts, matched):
    small = pyramid(parts, fine=PyramidMatching().fine.model_copy(update={"window": 9}))
    assert set(small.half) <= {4, PyramidMatching().wide_window // 2} and (small.half == 4).any()
    assert not (matched.half == 4).any()


def test_starts_too_far_apart_find_nothing(parts):
    wide = SearchRange(-150.0, 90.0, -60.0, 60.0)
    dense, sparse = (
        match_pyramid(*parts, GRID, wide, PyramidMatching(levels=2, start_spacing=spacing)).converged.mean()
        for spacing in (3.0, 1000.0)
    )
    assert dense > 0.9 and sparse < 0.2


def test_weak_nodes_are_tried_with_the_wide_window(parts, matched):
    half = PyramidMatching().wide_window // 2
    all_weak = pyramid(parts, weak_sigma=1e-6)
    assert (matched.half == half).mean() < 0.2
    assert (all_weak.half[INNER] == half).mean() > 0.8


def test_a_node_needs_as_many_neighbours_of_the_pyramid_as_set(parts, matched):
    strict = pyramid(parts, min_neighbours=8)
    assert not strict.converged[~INNER & (strict.outcome != Outcome.OUTSIDE)].all()
    assert strict.converged.sum() < matched.converged.sum()
    assert (strict.outcome == Outcome.INCONSISTENT).sum() > (matched.outcome == Outcome.INCONSISTENT).sum()


def test_neighbours_of_the_pyramid_agree_within_the_tolerance(parts):
    strict = pyramid(parts, neighbour_tolerance=1e-7)
    assert not strict.converged.any() and (strict.outcome == Outcome.INCONSISTENT).any()


def grown(parts, **changes) -> Matches:
    seeds = Seeds(np.array([[100.0, 100.0]]), true_places(np.array([[100.0, 100.0]])))
    return grow(*parts, GRID, seeds, RegionGrowing(region=0, levels=1, **changes))


def test_a_grown_node_needs_as_many_neighbours_as_set(parts):
    free, strict = grown(parts, min_neighbours=0), grown(parts, min_neighbours=8)
    assert free.converged.mean() > 0.9 and free.converged[~INNER].any()
    assert not strict.converged[~INNER].any() and strict.converged[INNER].any()
    assert (strict.outcome[free.converged & ~INNER] == Outcome.INCONSISTENT).all()


def test_grown_neighbours_agree_within_the_tolerance(parts):
    loose, strict = (grown(parts, min_neighbours=1, neighbour_tolerance=limit).converged for limit in (0.75, 1e-7))
    assert loose.mean() > 0.9 and not strict.any()


def test_a_combined_window_satisfies_its_entropy_rule(images):
    image, points = grey_levels(images[0]), grid_points(60, 140)
    rich = EntropyWindow(min_entropy=4.6)
    combined, alone = window_sizes(image, points, CombinedWindow(entropy=rich)), window_sizes(image, points, rich)
    default = window_sizes(image, points, CombinedWindow())
    assert (combined.half[combined.assigned] >= alone.half[combined.assigned]).all()
    assert combined.half[combined.assigned].mean() > default.half[combined.assigned].mean() + 1


@pytest.mark.parametrize(("min_stalled", "column"), [(3.0, 0), (2.52, 2), (2.4, 1)])
def test_a_window_accepted_for_its_small_gain_has_the_entropy_asked_for(min_stalled, column):
    values = np.array([[2.45, 2.5, 2.55, 2.56]])
    assert entropy_choice(values, EntropyWindow(min_gain=0.1, min_stalled=min_stalled)) == column


def test_the_affine_of_the_warp_is_found(matched):
    """Guards the fixture: the settings above are judged on matches that are right."""
    assert np.abs(np.median(matched.affine[matched.converged], axis=0) - AFFINE.ravel()).max() < 0.005


@pytest.mark.parametrize(
    ("kind", "set_to", "sentence"),
    [
        (LeastSquaresMatching, {"geometry": "shift", "max_affine_step": 0.2}, "max_affine_step has no effect with geometry: shift"),
        (PyramidMatching, {"levels": 0, "coarse_step": 6}, "coarse_step has no effect with levels: 0; set levels to 1 or more"),
        (PyramidMatching, {"min_neighbours": 0, "neighbour_tolerance": 2.0}, "with min_neighbours: 0; ask for neighbours"),
        (RegionGrowing, {"region": 0, "crossings": 5}, "crossings has no effect with region: 0; divide the grid into regions"),
        (RegionGrowing, {"neighbour_tolerance": 2.0}, "neighbour_tolerance has no effect with min_neighbours: 0"),
        (EntropyWindow, {"min_stalled": 2.0}, "min_stalled has no effect with min_gain: 0; set a min_gain, or leave it out"),
        (DenseMatching, {"small_window": 7, "edge_window": 9}, "edge_window is 9 and small_window is 7"),
        (DenseMatching, {"window": 21, "wide_window": 17}, "window is 21 and wide_window is 17"),
    ],
)
def test_a_setting_that_a_mode_ignores_is_refused(kind, set_to, sentence):
    with pytest.raises(ValidationError, match=sentence):
        kind.model_validate(set_to)


@pytest.mark.parametrize(
    "chosen",
    [LeastSquaresMatching(geometry="shift"), PyramidMatching(levels=0), RegionGrowing(region=0), EntropyWindow(), DenseMatching()],
)
def test_settings_written_back_with_all_defaults_are_accepted(chosen):
    assert type(chosen).model_validate(chosen.model_dump()) == chosen
