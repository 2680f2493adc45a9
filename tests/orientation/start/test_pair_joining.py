"""A photograph at a weak link: its pair gives all but the length of the base, a few known points give that."""

from dataclasses import replace

import numpy as np
import photographed_layouts
import pytest
from orienting import orient

from orthomill.schemas.orientation import RelativeOrientation
from orthomill.tasks.geometry.rotation import angles, rotation_matrix
from orthomill.tasks.orientation.start.pair_joining import TRIED, base_lengths, by_pairs, spread_lengths


def poses(rng):
    """Rotations and centres of two photographs over flat ground."""
    turns = np.radians(rng.uniform(-8, 8, (2, 3)))
    return [(rotation_matrix(*turn), np.array([20.0 * i, 3.0 * i, 80.0])) for i, turn in enumerate(turns)]


def pair_of(left, right):
    """The relative orientation of two poses, as a pair states it."""
    turn, base = right[0] @ left[0].T, left[0] @ (right[1] - left[1])
    return RelativeOrientation(
        left="a",
        right="b",
        matches=50,
        kept=50,
        outcome="oriented",
        base=tuple(base / np.linalg.norm(base)),
        omega_phi_kappa=tuple(np.degrees(angles(turn))),
    )


@pytest.mark.parametrize("waiting", ["a", "b"])
def test_a_pair_and_its_points_give_the_pose_of_either_photograph(waiting):
    rng = np.random.default_rng(3)
    pose = dict(zip("ab", poses(rng), strict=True))
    other = "b" if waiting == "a" else "a"
    (ahead,) = by_pairs(waiting, {other: pose[other]}, (pair_of(pose["a"], pose["b"]),))
    rotation, centre = pose[waiting]
    assert ahead.rotation == pytest.approx(rotation, abs=1e-9)
    points = rng.uniform(-30, 30, (6, 3))
    lengths = base_lengths(ahead, points, points - centre)
    assert len(lengths) == 6
    assert ahead.origin + lengths[:, None] * ahead.direction == pytest.approx(np.tile(centre, (6, 1)), abs=1e-6)


def test_points_that_say_nothing_of_the_base_are_left_out():
    rng = np.random.default_rng(4)
    left, right = poses(rng)
    (ahead,) = by_pairs("b", {"a": left}, (pair_of(left, right),))
    along, opposite = left[1] + 50.0 * ahead.direction, left[1] + [0.0, 0.0, -80.0]
    assert not len(base_lengths(ahead, along[None], ahead.direction[None]))
    # The ray comes from a place behind the other photograph.
    behind = left[1] - 20.0 * ahead.direction
    assert not len(base_lengths(ahead, opposite[None], (opposite - behind)[None]))


def test_of_many_lengths_those_that_half_of_the_rays_give_are_tried():
    rng = np.random.default_rng(5)
    few = rng.uniform(1, 100, TRIED)
    assert spread_lengths(few) is few
    many = rng.permutation(np.concatenate([rng.normal(40.0, 0.01, 500), rng.uniform(1, 1000, 500)]))
    tried = spread_lengths(many)
    assert len(tried) == TRIED and (np.abs(tried - 40.0) < 0.05).sum() > 0.4 * TRIED


def test_pairs_with_photographs_that_are_not_placed_give_nothing():
    left, right = poses(np.random.default_rng(5))
    assert not list(by_pairs("b", {}, (pair_of(left, right),)))
    failed = pair_of(left, right).model_copy(update={"outcome": "too few"})
    assert not list(by_pairs("b", {"a": left}, (failed,)))


def weak_link(shared):
    """A strip whose first photograph shares `shared` tie points with the third one, and all others with the second one only."""
    block = photographed_layouts.layout("one_strip", "rough positions", 0)
    ties, seen = block.tie_points, [set(block.tie_points.track[block.tie_points.photo == i]) for i in range(3)]
    beyond = set(ties.track[ties.photo > 1])
    kept = set(sorted(seen[0] & seen[1] & seen[2])[:shared])
    lost = (ties.photo == 0) & np.isin(ties.track, sorted(beyond - kept))
    parts = {name: getattr(ties, name)[~lost] for name in ("track", "photo", "col", "row", "sigma")}
    return replace(block, tie_points=type(ties)(**parts), wrong=block.wrong[~lost])


@pytest.mark.parametrize(("shared", "joins"), [(5, True), (0, False)])
def test_a_photograph_with_few_known_points_joins_by_its_pair(shared, joins):
    block = weak_link(shared)
    out = orient(block)
    assert ("p00" in {photo.photo for photo in out["block"].photos}) == joins
    if joins:
        truth = next(view for view in block.views if view.name == "p00")
        beside = next(view for view in block.views if view.name == "p01")
        found = np.array(out["block"].of("p00").centre) - np.array(out["block"].of("p01").centre)
        assert found == pytest.approx(truth.centre - beside.centre, abs=1.5)
