"""Pairs from tables: which ones are related, what each row says, and the sentence of every pair that cannot be oriented."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_block import DRONE, one_strip, simulate, view

from orthomill.schemas.photo import Photos
from orthomill.tasks.adjustment.model.network import Rays
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.imagery.photograph_rows import rows_of_photos
from orthomill.tasks.orientation.relative.pairs import chance_agreement, common_rays, no_pairs, relate_pairs, sharing_pairs
from orthomill.tasks.orientation.relative.relative_orientation import orient_robust


def rays(*rows):
    point, photo = np.array(rows, np.int32).T
    return Rays(point, photo, np.zeros((len(rows), 2)), np.ones(len(rows)))


FEW = rays((0, 0), (0, 1), (1, 0), (1, 1), (1, 2), (2, 1), (2, 2), (3, 2))


@pytest.mark.parametrize(("least", "pairs"), [(1, [(0, 1), (0, 2), (1, 2)]), (2, [(0, 1), (1, 2)]), (3, [])])
def test_pairs_share_at_least_so_many_points(least, pairs):
    assert sharing_pairs(FEW, 3, least) == pairs


def test_common_rays_belong_to_the_same_points():
    a, b = common_rays(FEW, *rows_of_photos(FEW.photo, 3)[1:])
    assert FEW.point[a].tolist() == FEW.point[b].tolist() == [1, 2]
    assert set(FEW.photo[a]) == {1} and set(FEW.photo[b]) == {2}


@pytest.fixture(scope="module")
def strip():
    return one_strip(5, photos=4, tracks=500)


@pytest.fixture(scope="module")
def related(strip):
    return relate_pairs(strip.photos, strip.cameras, strip.tie_points, 15)


def test_rows_tell_the_relative_orientation_of_the_true_views(strip, related):
    truth = {v.name: v for v in strip.views}
    assert len(related.pairs) >= 3 and all(pair.oriented for pair in related.pairs)
    assert [pair.kept for pair in related.pairs] == sorted((pair.kept for pair in related.pairs), reverse=True)
    for pair in related.pairs:
        left, right = truth[pair.left], truth[pair.right]
        turn = rotation_matrix(*np.radians(pair.omega_phi_kappa)) @ left.rotation @ right.rotation.T
        assert np.degrees(np.arccos(min((np.trace(turn) - 1) / 2, 1.0))) < 1.0
        base = left.rotation @ (right.centre - left.centre)
        assert np.degrees(np.arccos(np.array(pair.base) @ base / np.linalg.norm(base))) < 3.0
        assert pair.kept <= pair.matches and 0.1 < pair.sigma0_px < 1.0


def test_the_intersection_angle_is_that_of_base_and_height(strip, related):
    """Neighbours are 20 m apart at 80 m over the ground: rays meet at about 14 degrees."""
    angles = {(pair.left, pair.right): pair.intersection_deg for pair in related.pairs}
    assert angles["d0", "d1"] == pytest.approx(np.degrees(np.arctan(20 / 80)), abs=2.0)


def test_by_and_bz_are_told_where_the_base_lies_along_x(related):
    along = [pair for pair in related.pairs if pair.by_bz is not None]
    across = [pair for pair in related.pairs if pair.by_bz is None]
    assert all(abs(pair.base[0]) > 0.7 for pair in along) and all(abs(pair.base[0]) <= 0.7 for pair in across)
    for pair in along:
        assert pair.by_bz == pytest.approx((pair.base[1] / pair.base[0], pair.base[2] / pair.base[0]))


def test_more_shared_points_may_be_asked_for(strip, related):
    counts = sorted(pair.matches for pair in related.pairs)
    assert len(relate_pairs(strip.photos, strip.cameras, strip.tie_points, counts[-1]).pairs) == 1


def test_a_block_read_from_a_file_has_no_pairs():
    assert no_pairs().pairs == ()


def only_pair(block):
    (pair,) = relate_pairs(block.photos, block.cameras, block.tie_points, 6).pairs
    assert not pair.oriented
    return pair


def two_views(second, **options):
    views = [view("a", DRONE, (407000, 4357000, 180), (0, 0, 90)), view("b", DRONE, *second)]
    return simulate(views, DRONE, 3, **({"gnss": None, "control": 0, "check": 0, "tracks": 200} | options))


def test_a_handful_of_matches_that_agree_by_chance_is_no_orientation():
    """Eight matches that are wrong by up to 10 px: five unknowns fit most of them."""
    block = two_views(((407020, 4357000, 180), (0, 0, 90)), tracks=8)
    ties = block.tie_points
    wrong = replace(ties, col=ties.col + np.random.default_rng(1).uniform(-10, 10, len(ties)))
    assert only_pair(replace(block, tie_points=wrong)).outcome.startswith("Only 7 of 8 matches agree with one relative orientation")


def test_a_rotated_camera_is_named_with_its_rotation():
    pair = only_pair(two_views(((407000, 4357000, 180), (3, -2, 95))))
    assert "taken from one place (pure rotation)" in pair.outcome and not pair.same_photo
    expected = rotation_matrix(*np.radians([3, -2, 95])) @ rotation_matrix(0, 0, np.radians(90)).T
    np.testing.assert_allclose(rotation_matrix(*np.radians(pair.omega_phi_kappa)), expected, atol=2e-3)


def test_positions_that_lie_apart_are_not_called_one_place():
    block = two_views(((407000, 4357000, 180), (3, -2, 95)))
    places = {"a": (407000.0, 4357000.0, 180.0), "b": (407040.0, 4357000.0, 180.0)}
    photos = tuple(
        photo.model_copy(update={"position": places[photo.name], "position_sigma": (3.0, 3.0, 5.0)})
        for photo in block.photos.photos
    )
    pair = only_pair(replace(block, photos=Photos(photos=photos)))
    assert "positions lie 40 m apart" in pair.outcome and "one place" not in pair.outcome


def test_the_same_photograph_twice_is_named():
    pair = only_pair(two_views(((407000, 4357000, 180), (0, 0, 90)), sigma=0.01))
    assert pair.same_photo and "b is the same photograph as a" in pair.outcome


def test_matches_on_one_line_are_named():
    block = two_views(((407020, 4357000, 180), (0, 0, 90)))
    ties = block.tie_points
    flat = replace(ties, row=np.where(ties.photo == 0, 500.0, ties.row))
    assert "lie on one line in a" in only_pair(replace(block, tie_points=flat)).outcome


def test_a_lens_that_cannot_be_inverted_is_named():
    block = two_views(((407020, 4357000, 180), (0, 0, 90)))
    folding = block.cameras.cameras["cam"].model_copy(update={"source": "given"}).changed(k1=-400.0)
    cameras = block.cameras.model_copy(update={"cameras": {"cam": folding}})
    assert "distortion of the camera cannot be undone" in only_pair(replace(block, cameras=cameras)).outcome


def test_chance_falls_with_every_match_that_agrees():
    """Ten times as many agreeing matches among as many wrong ones leave no room for chance."""
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.uniform(-0.5, 1.5, 60), rng.uniform(-1, 1, 60), rng.uniform(-2.2, -1.8, 60)])
    moved = points - [1, 0, 0]
    observations = 1000 * np.hstack([-points[:, :2] / points[:, 2:], -moved[:, :2] / moved[:, 2:]])
    observations += 0.3 * rng.standard_normal(observations.shape)
    wrong = rng.uniform(-500, 500, (40, 4))
    camera = DRONE.model_copy(update={"c": 1000.0})
    logs = [
        chance_agreement(orient_robust(own, 1000.0, 1000.0), own, camera)
        for own in (np.vstack([observations[:count], wrong]) for count in (20, 60))
    ]
    assert logs[1] < logs[0] < -3 and logs[1] < -50
