"""Blocks from tie points alone: the true shape, groups that nothing connects, copies, and starts that tie points contradict."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_block import DRONE, block_of, view

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.interior import interior_prior
from orthomill.tasks.adjustment.model.interior_settings import FixedInterior
from orthomill.tasks.orientation.measurements import tie_rays
from orthomill.tasks.orientation.relative.pairs import relate_pairs
from orthomill.tasks.orientation.start.block_growth import BlockGrowth, Given, GrowthMaterial, from_given
from orthomill.tasks.orientation.start.block_start import start_blocks, start_with, without_photo
from orthomill.tasks.orientation.start.similarity import VerticalityConstraint, fit_similarity

EXACT = DRONE.model_copy(update={"source": "given"})
NONE = VerticalityConstraint(np.array([0.0, 0.0, 1.0]), 0.0)


def strip(count, east=407000.0, prefix="s", seed=1):
    rng = np.random.default_rng(seed)
    return [
        view(
            f"{prefix}{i}", EXACT, (east + 22.0 * i, 4357000 + rng.normal(0, 1), 180 + rng.normal(0, 1)), (*rng.normal(0, 1, 2), 90)
        )
        for i in range(count)
    ]


def test_a_photograph_changes_the_rays_of_its_own_points_only():
    material = material_of(strip(6))
    growth = BlockGrowth(material, np.ones(6, bool))
    for photo in range(6):
        seen = np.unique(material.rays.point[material.rays.photo == photo])
        assert growth.beside(photo).tolist() == np.flatnonzero(np.isin(material.rays.point, seen)).tolist()


def material_of(views, seed=1, camera=EXACT, tracks=500):
    rng = np.random.default_rng(seed)
    low, high = (f([v.centre[:2] for v in views], axis=0) for f in (np.min, np.max))
    xy = rng.uniform(low - 40, high + 40, (tracks, 2))
    block = block_of(views, np.column_stack([xy, 100 + rng.uniform(-6, 6, tracks)]), rng, gnss=None, camera=camera)
    rays, tracks_ = tie_rays(block.photos, block.cameras, block.tie_points)
    relative = relate_pairs(block.photos, block.cameras, block.tie_points, 15).pairs
    interior = interior_prior([camera], FixedInterior(kind="fixed"))
    names = block.photos.names
    return GrowthMaterial(names, ("cam",), [camera], np.zeros(len(names), np.int64), interior, rays, len(tracks_), relative)


@pytest.fixture(scope="module")
def views():
    return strip(4)


@pytest.fixture(scope="module")
def material(views):
    return material_of(views)


@pytest.fixture(scope="module")
def started(material):
    return start_blocks(material)


def misfit(state, photos, views):
    """How far the projection centres of a model are from their true places after a similarity, m."""
    truth = np.array([views[i].centre for i in photos]) - views[0].centre
    fit = fit_similarity(state.centre[photos], truth, np.ones(len(photos)), NONE)
    return np.linalg.norm(fit.apply(state.centre[photos]) - truth, axis=1).max()


def test_a_strip_grows_to_its_true_shape(started, views):
    (start,), unoriented = started
    assert start.photos.tolist() == [0, 1, 2, 3] and unoriented == ()
    assert misfit(start.state, start.photos, views) < 0.3


def test_nearly_all_points_and_rays_are_kept(started, material):
    (start,), _ = started
    assert start.known.mean() > 0.9 and start.good.mean() > 0.97
    assert np.isfinite(start.state.point[start.known]).all()


def test_a_photograph_may_be_left_out_of_a_start(started):
    (start,), _ = started
    assert without_photo(start, 2).photos.tolist() == [0, 1, 3] and start.photos.tolist() == [0, 1, 2, 3]


def test_groups_that_nothing_connects_become_blocks_of_their_own():
    views = strip(2, 409000.0, "b", 2) + strip(3, 407000.0, "a", 3)
    rng = np.random.default_rng(5)
    points = np.vstack(
        [
            np.column_stack(
                [
                    rng.uniform(v.centre[0] - 60, v.centre[0] + 60, 150),
                    rng.uniform(4356960, 4357040, 150),
                    100 + rng.uniform(-6, 6, 150),
                ]
            )
            for v in views
        ]
    )
    block = block_of(views, points, rng, gnss=None, camera=EXACT)
    rays, tracks = tie_rays(block.photos, block.cameras, block.tie_points)
    relative = relate_pairs(block.photos, block.cameras, block.tie_points, 15).pairs
    interior = interior_prior([EXACT], FixedInterior(kind="fixed"))
    found, unoriented = start_blocks(
        GrowthMaterial(block.photos.names, ("cam",), [EXACT], np.zeros(5, np.int64), interior, rays, len(tracks), relative)
    )
    assert [start.photos.tolist() for start in found] == [[2, 3, 4], [0, 1]], "the largest first"
    assert unoriented == ()


def test_a_copy_is_named_and_takes_no_part(material):
    copy = replace(
        material,
        relative=tuple(
            pair.model_copy(update={"same_photo": True, "outcome": "s1 is the same photograph as s0"})
            if (pair.left, pair.right) == ("s0", "s1")
            else pair
            for pair in material.relative
        ),
    )
    (start,), (left,) = start_blocks(copy)
    assert start.photos.tolist() == [0, 2, 3] and left.photo == "s1" and "same photograph as s0" in left.reason


def test_without_any_oriented_pair_there_is_no_block(material):
    with pytest.raises(GeometryError, match=r"No two photographs could be oriented .* none of them share enough tie points"):
        start_blocks(replace(material, relative=()))
    failed = tuple(pair.model_copy(update={"outcome": "matches are wrong"}) for pair in material.relative)
    with pytest.raises(GeometryError, match="of the pair with most matches is known: matches are wrong"):
        start_blocks(replace(material, relative=failed))


def test_a_photograph_joins_by_its_tie_points_without_an_oriented_pair(material):
    pairs = tuple(pair for pair in material.relative if "s3" not in (pair.left, pair.right))
    (start,), unoriented = start_blocks(replace(material, relative=pairs))
    assert start.photos.tolist() == [0, 1, 2, 3] and unoriented == ()


def test_a_photograph_that_cannot_be_resected_says_why(material):
    """Of its rays only five are left: too few for a resection."""
    rays = material.rays
    own = np.flatnonzero(rays.photo == 3)
    kept = np.union1d(np.flatnonzero(rays.photo != 3), own[:5])
    pairs = tuple(pair for pair in material.relative if "s3" not in (pair.left, pair.right))
    (start,), (left,) = start_blocks(replace(material, rays=rays.take(kept), relative=pairs))
    assert start.photos.tolist() == [0, 1, 2]
    assert left.reason == "s3 shares too few tie points with any other photograph; its overlap is too small."
    untied = replace(material, rays=rays.take(rays.photo != 3), relative=pairs)
    assert "s3 has no tie points" in start_blocks(untied)[1][0].reason
    oriented = start_blocks(replace(material, rays=rays.take(kept)))[1]
    assert "s3 did not join the block: only " in oriented[0].reason and "8 are needed" in oriented[0].reason


def given(views, shift=0.0, seed=7):
    rng = np.random.default_rng(seed)
    origin = views[0].centre
    rotation = np.array([v.rotation for v in views])
    return Given(
        rotation,
        np.array([v.centre - origin for v in views]) + shift * rng.standard_normal((len(views), 3)),
        np.ones(len(views), bool),
    )


def test_approximate_orientations_are_refined(material, views):
    growth = from_given(material, given(views, 1.0))
    assert growth.placed.all() and misfit(growth.state, np.arange(4), views) < 0.3


def test_a_start_of_other_photographs_is_refused(material, views):
    wrong = given(views)
    wrong = replace(wrong, centre=wrong.centre[::-1])
    with pytest.raises(GeometryError, match="contradict the exterior orientation that was given as a start"):
        from_given(material, wrong)


def test_a_start_with_other_constants_uses_them(material):
    (start, *_), _ = start_with(material, np.array([1.3 * EXACT.c]))
    assert start.state.interior[0, 0] == pytest.approx(1.3 * EXACT.c)
