"""Up in a block without datum: across the ground round an object, the mean axis of its photographs where there is no such plane."""

import numpy as np
import pytest
from orienting import orient
from simulated_block import DRONE, block_of, looking

from orthomill.tasks.adjustment.model.interior_settings import FixedInterior
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View
from orthomill.tasks.orientation.start.dominant_plane import dominant_plane

FIXED = FixedInterior(kind="fixed")
CENTRE = np.array([407000.0, 4357000.0, 50.0])
ACROSS = ", up is across the plane that most tie points lie near"


def stone(seed, ground):
    """Half a ring of photographs that look down by 35 degrees at a stone, with `ground` points on the pavement round it."""
    rng = np.random.default_rng(seed)
    views = []
    for number, turn in enumerate(np.radians(np.linspace(-60, 60, 9))):
        aside = np.array([np.sin(turn), -np.cos(turn), 0.0])
        centre = CENTRE + 12 * np.cos(0.61) * aside + [0, 0, 12 * np.sin(0.61)]
        views.append(View(f"s{number}", DRONE, looking(CENTRE - centre + rng.normal(0, 0.3, 3)), centre))
    pavement = np.column_stack([rng.uniform(-6, 6, (ground, 2)), np.zeros(ground)])
    bulk = rng.normal(0, 1, (1500, 3))
    bulk = 1.5 * bulk / np.linalg.norm(bulk, axis=1, keepdims=True)
    return block_of(views, CENTRE + np.vstack([pavement, np.abs(bulk)]), rng, gnss=None)


def pavement_relief(block, out):
    """Height range of the pavement's points as a share of the distance of the cameras, 100 units."""
    level = block.ground[out["points"].track][:, 2] < CENTRE[2] + 1e-6
    return float(np.ptp(out["points"].z[level])) / 100


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_ground_round_an_object_is_level(seed):
    block = stone(seed, 1500)
    out = orient(block, interior=FIXED)
    assert len(out["block"].photos) == 9 and ACROSS in out["block"].datum
    assert pavement_relief(block, out) < 0.02


def test_without_a_plane_the_photographs_look_down_on_average():
    out = orient(stone(3, 0), interior=FIXED)
    axes = np.array([rotation_matrix(*np.radians(photo.omega_phi_kappa))[2] for photo in out["block"].photos])
    assert ACROSS not in out["block"].datum and axes.mean(axis=0)[2] > 0.999 * np.linalg.norm(axes.mean(axis=0))


def points_on(normal, seed=0, share=0.5):
    rng = np.random.default_rng(seed)
    on = rng.uniform(-20, 20, (1000, 3))
    on -= np.outer(on @ normal, normal)
    return np.vstack([on, rng.uniform(-20, 20, (round(1000 / share) - 1000, 3))])


UP, ROW = np.array([0.0, 0.0, 1.0]), np.array([[1.0, 0.0, 0.0]])
TILTED = np.array([0.0, np.sin(0.8), np.cos(0.8)])


def test_the_normal_points_to_the_cameras_and_is_the_same_each_time():
    found = [dominant_plane(points_on(TILTED), UP, ROW) for _ in range(2)]
    assert (found[0] == found[1]).all() and found[0] @ TILTED > np.cos(np.radians(1))


@pytest.mark.parametrize(
    ("normal", "share"),
    [
        ([0.0, 1.0, 0.1], 0.5),  # seen in passing
        ([0.6, 0.0, 0.8], 0.5),  # across the rows: the side wall of a corner
        ([0.0, 0.6, 0.8], 0.08),  # few points
    ],
)
def test_a_plane_that_is_not_what_the_photographs_show_is_none(normal, share):
    normal = np.array(normal) / np.linalg.norm(normal)
    assert dominant_plane(points_on(normal, share=share), UP, ROW) is None


@pytest.mark.parametrize("seed", range(5))
def test_points_that_fill_a_volume_have_no_plane(seed):
    assert dominant_plane(np.random.default_rng(seed).uniform(-3, 3, (2000, 3)), UP, ROW) is None


def test_a_handful_of_points_has_no_plane():
    assert dominant_plane(points_on(UP)[:9], UP, ROW) is None
