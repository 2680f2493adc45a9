"""Photographs that show the ground larger than others of their camera: zoom without a tag, told from flights at two heights."""

import numpy as np
import pytest

from orthomill.schemas.orientation import RelativeOrientation
from orthomill.tasks.adjustment.model.network import Rays
from orthomill.tasks.orientation.block.image_scales import image_scales, stepped_constants

NAMES = tuple(f"p{i}" for i in range(8))
CAMERA = np.zeros(8, np.int64)
PAIRS = tuple(
    RelativeOrientation(left=NAMES[i], right=NAMES[j], matches=40 - 5 * (j - i), kept=10, outcome="oriented")
    for i in range(8)
    for j in (i + 1, i + 2)
    if j < 8
)


def rays_of(scale, seed=3):
    """Rays of 60 points of one place in photographs of these scales, turned and shifted, to 0.3 px; a tenth is wrong."""
    random = np.random.default_rng(seed)
    ground = random.uniform(-300.0, 300.0, (60, 2))
    seen = []
    for size in scale:
        turn = random.uniform(0.0, 6.3)
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        xy = size * ground @ rotation.T + random.uniform(-50.0, 50.0, 2) + random.normal(0.0, 0.3, ground.shape)
        xy[random.random(60) < 0.1] = random.uniform(-300.0, 300.0, 2)
        seen.append(xy)
    point, photo = (grid.ravel() for grid in np.meshgrid(np.arange(60), np.arange(len(scale)), indexing="ij"))
    xy = np.stack(seen, axis=1).reshape(-1, 2)
    return Rays(point.astype(np.int32), photo.astype(np.int32), xy, np.full(len(point), 0.3))


def found(scale, height=None):
    height = np.full(8, 100.0) if height is None else np.asarray(height)
    return list(stepped_constants(image_scales(rays_of(scale), NAMES, PAIRS), CAMERA, NAMES, height, np.full(8, 5.0)))


def test_scales_of_photographs_are_those_of_their_pairs():
    true = np.array([1.0, 1.02, 0.98, 1.0, 1.5, 1.5, 1.45, 1.5])
    scale = image_scales(rays_of(true), NAMES, PAIRS)
    assert np.abs((scale - scale[0]) - np.log(true / true[0])).max() < 0.02


def test_a_zoom_that_begins_in_the_flight_is_found_with_its_factor():
    (own,) = found([1.0, 1.02, 0.98, 1.0, 1.5, 1.5, 1.45, 1.5])
    assert own.photos == NAMES[4:] and own.factor == pytest.approx(1.5, rel=0.03)
    # The smaller part has the other constant, also where it shows the ground smaller.
    (own,) = found([0.7, 0.7, 0.7, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert own.photos == NAMES[:3] and own.factor == pytest.approx(0.7, rel=0.03)


def test_another_height_relief_and_single_photographs_are_no_zoom():
    scale = [1.0, 1.02, 0.98, 1.0, 1.5, 1.5, 1.45, 1.5]
    assert not found(scale, [100.0] * 4 + [67.0] * 4), "positions say that these were taken from below"
    assert not found([1.0, 1.05, 1.1, 1.15, 1.2, 1.25, 1.3, 1.35]), "a slope"
    assert not found([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.6]), "one photograph is no flight"
    assert np.isnan(image_scales(rays_of(scale), NAMES, ())).all()
