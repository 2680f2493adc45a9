"""Tie points by region growing, on turned photographs whose every homologous point is known."""

import numpy as np
import pytest
from textured_plane import CAMERA, NAMES, cameras, photograph, texture, true_partner, views

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.raster import Window
from orthomill.tasks.tie_points.features import Detection, tile_features
from orthomill.tasks.tie_points.grown_search import feature_seeds, grow_pair, listed_seeds
from orthomill.tasks.tie_points.match_records import DESCRIPTOR
from orthomill.tasks.tie_points.pair_matching import PairRules
from orthomill.tasks.tie_points.search_settings import GrowingSearch

SHAPE = (CAMERA.height, CAMERA.width)
SEARCH = GrowingSearch(kind="region_growing", step=12)
RULES = PairRules(0.8, 1.5)


@pytest.fixture(scope="module")
def sides():
    """Pixels and features of two photographs that are turned by 23 degrees against each other, and of other ground."""
    image = texture()
    pixels = [photograph(view, image, seed) for seed, view in enumerate(views()[:2])] + [photograph(views()[1], texture(seed=9))]
    found = [tile_features(one, one[::2, ::2], Detection(0, SHAPE, Window(0, 0, *SHAPE), 800, 0.02)) for one in pixels]
    return pixels, [(one.features, one.descriptors) for one in found]


def grown(sides, other=1, seeds=None):
    pixels, found = sides
    return grow_pair(found[0], found[other], (pixels[0], pixels[other]), cameras(), NAMES[:2], (0, 0), RULES, SEARCH, seeds)


def errors(sides, matches) -> np.ndarray:
    here, there = (
        np.column_stack([one.col, one.row])[numbers]
        for (one, _), numbers in zip(sides[1][:2], (matches.left, matches.right), strict=True)
    )
    return np.linalg.norm(true_partner(*views()[:2], here) - there, axis=1)


def test_turned_photographs_are_matched_by_what_has_grown(sides):
    matches, summary = grown(sides)
    assert summary.accepted and len(matches) > 100
    error = errors(sides, matches)
    assert np.median(error) < 0.6 and (error < 2.5).mean() > 0.97 and len(np.unique(matches.right)) == len(matches)


def test_a_list_of_seeds_takes_the_place_of_features_in_either_order(sides):
    start = feature_seeds(*((one, values.rows(DESCRIPTOR)) for one, values in sides[1][:2]), 0.8)
    rows = [f"b,{right[0]},{right[1]},a,{left[0]},{left[1]}" for left, right in zip(start.points[:3], start.right[:3], strict=True)]
    text = "\n".join(["right,right_col,right_row,left,left_col,left_row", *rows])
    found = listed_seeds(text, ("a", "b"))
    np.testing.assert_allclose(found.points, start.points[:3])
    np.testing.assert_allclose(listed_seeds(text, ("b", "a")).points, start.right[:3])
    assert not len(listed_seeds(text, ("a", "c")).points)
    assert not grown(sides, seeds="left,left_col,left_row,right,right_col,right_row").summary.accepted


def test_other_ground_is_not_accepted_and_a_list_without_columns_is_told(sides):
    assert not grown(sides, other=2).summary.accepted
    with pytest.raises(WorkflowError, match="line 2, cannot be read"):
        listed_seeds("left,right\na,b\n", ("a", "b"))
