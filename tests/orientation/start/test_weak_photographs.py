"""The most poorly determined photograph: found by its rays, and only where it is much worse than the others."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import small_network

from orthomill.tasks.orientation.start.weak_photograph import set_aside, weakest


@pytest.fixture(scope="module")
def block():
    return small_network(photos=6, points=60)


def corner(rays, photo, count):
    """All rays of the other photographs, and the `count` rays of one that are nearest to a corner of its frame."""
    own = np.flatnonzero(rays.photo == photo)
    kept = own[np.argsort(rays.xy[own].sum(axis=1))[:count]]
    return rays.take(np.union1d(np.flatnonzero(rays.photo != photo), kept))


def test_photographs_of_equal_geometry_have_no_weak_one(block):
    network, state, rays = block
    assert weakest(network, state, rays) is None


@pytest.mark.parametrize("photo", [0, 4])
def test_a_handful_of_rays_in_a_corner_is_weak(block, photo):
    network, state, rays = block
    assert weakest(network, state, corner(rays, photo, 4)) == photo


@pytest.mark.parametrize("count", [0, 2])
def test_a_photograph_that_its_rays_do_not_determine_is_the_weakest(block, count):
    """Six unknowns need three points."""
    network, state, rays = block
    assert weakest(network, state, corner(rays, 3, count)) == 3


def test_the_scale_of_the_model_does_not_matter(block):
    network, state, rays = block
    small = replace(state, centre=0.001 * state.centre, point=0.001 * state.point)
    assert weakest(network, small, corner(rays, 4, 4)) == 4


def test_the_sentence_names_number_and_reason():
    text = set_aside("p7", 9, "The adjustment does not converge.")
    assert text.startswith("p7 was set aside, because only 9 tie points") and "(the adjustment does not converge)" in text
