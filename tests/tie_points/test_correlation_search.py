"""The published search for near-vertical pairs, on photographs whose every homologous point is known."""

import numpy as np
import pytest
from textured_plane import CAMERA, NAMES, cameras, photograph, texture, true_partner

from orthomill.schemas.raster import Window, tiles_of
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View
from orthomill.tasks.matching.points.point_settings import HarrisPoints, TemplateCorrelation
from orthomill.tasks.tie_points.correlation_search import correlate_pair, mean_parallax, tile_interest_points
from orthomill.tasks.tie_points.features import Detection, photo_features
from orthomill.tasks.tie_points.pair_matching import PairRules
from orthomill.tasks.tie_points.search_settings import CorrelationSearch

SHAPE = (CAMERA.height, CAMERA.width)
SEARCH = CorrelationSearch(kind="correlation", points=HarrisPoints(min_strength=100.0), correlation=TemplateCorrelation(search=101))
FEW = 250
"""points of a photograph: every one is sought in the whole search window of the other, there and back"""
ANGLES = ((0.01, -0.015, 0.02), (-0.015, 0.01, -0.02))


@pytest.fixture(scope="module")
def pair():
    """Two near-vertical photographs with 62 % overlap, and their pixels."""
    views = [View(NAMES[i], CAMERA, rotation_matrix(*ANGLES[i]), np.array([17.0 * i, 1.0 * i, 42.0])) for i in (0, 1)]
    image = texture()
    return views, [photograph(view, image, seed) for seed, view in enumerate(views)]


def points_of(pixels, tile, limit=600):
    parts = []
    for cell in tiles_of(SHAPE, tile):
        detection = Detection(0, SHAPE, cell.window, limit, 0.02)
        parts.append(tile_interest_points(pixels[detection.window.slices], pixels[::2, ::2], detection, SEARCH))
    return photo_features(tuple(part.features for part in parts), tuple(part.descriptors for part in parts), 0, limit).features


def test_the_mean_parallax_is_found_from_a_few_points(pair):
    views, pixels = pair
    middle = np.array([[300.0, 190.0]])
    expected = (true_partner(*views, middle) - middle)[0]
    assert np.abs(mean_parallax(pixels[0][:, :, 0], pixels[1][:, :, 0]) - expected).max() < 12.0


def test_other_ground_has_no_mean_parallax(pair):
    other = photograph(pair[0][0], texture(seed=9))[:, :, 0]
    found = mean_parallax(pair[1][0][:, :, 0], np.full_like(other, 90))
    assert found is None


def test_points_do_not_depend_on_tiles(pair):
    whole, tiled = points_of(pair[1][0], 512), points_of(pair[1][0], 128)
    assert len(whole) == len(tiled) > 200
    assert np.abs(whole.col - tiled.col).max() < 1e-9 and np.abs(whole.row - tiled.row).max() < 1e-9


def test_matches_are_homologous(pair):
    views, pixels = pair
    features = [points_of(one, 512, FEW) for one in pixels]
    result = correlate_pair(tuple(features), tuple(pixels), cameras(), NAMES[:2], (0, 0), PairRules(0.8, 1.5), SEARCH)
    matches, summary = result
    assert summary.accepted and len(matches) > 60
    left, right = (
        np.column_stack([one.col, one.row])[numbers] for one, numbers in zip(features, (matches.left, matches.right), strict=True)
    )
    error = np.linalg.norm(true_partner(*views, left) - right, axis=1)
    assert np.median(error) < 0.6 and (error < 2.5).mean() > 0.98
    assert len(np.unique(matches.right)) == len(matches)


def test_a_pair_without_common_ground_is_not_accepted(pair):
    stranger = photograph(pair[0][0], texture(seed=9))
    features = [points_of(one, 512, FEW) for one in (pair[1][0], stranger)]
    result = correlate_pair(tuple(features), (pair[1][0], stranger), cameras(), NAMES[:2], (0, 0), PairRules(0.8, 1.5), SEARCH)
    assert not result.summary.accepted and len(result.matches) == 0


def test_a_window_is_read_with_what_its_points_depend_on():
    detection = Detection(0, SHAPE, Window(128, 128, 128, 128), 500, 0.02)
    assert 128 - detection.window.row >= SEARCH.points.reach
