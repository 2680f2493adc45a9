"""Each cause that is planted into what the sources say is found, and nothing in sound ones; no images, only a rigid block."""

from dataclasses import replace

import numpy as np
import pytest
from rigid_flights import flight, raised

from orthomill.tasks.orientation.sources.causes import Unit, causes_of
from orthomill.tasks.orientation.sources.robust_motion import Offset, explained

RTK, GPS = {"gnss": (0.015, 0.015, 0.025)}, {}
ORIGIN = np.zeros(3)
SOUND = {
    "rtk": RTK,
    "gps": GPS,
    "rtk and control": RTK | {"control": 6},
    "gps and control": {"control": 6},
    "gps without attitudes": {"attitudes": False},
    "two short strips": {"strips": 2, "per_strip": 4},
}


def quiet(block, told, seed):
    """Positions that are stated to metres but scatter by a decimetre: most of their error is common."""
    rng = np.random.default_rng(seed)
    return replace(told, position=block.centre + rng.normal(0, 2, 3) + rng.normal(0, 0.1, block.centre.shape))


def single(found):
    """The only cause, an offset: its photographs, axes, values and standard errors."""
    (cause,) = found.causes
    assert isinstance(cause, Offset) and found.unit is None
    own = slice(-len(cause.axes), None)
    return cause.photos, cause.axes, found.after.parameters[own], np.sqrt(np.diag(found.after.covariance)[own])


@pytest.mark.parametrize("kind", SOUND)
@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_found_in_sound_sources(kind, seed):
    block, told, groups = flight(seed, **SOUND[kind])
    found = causes_of(block, told, groups, ORIGIN)
    assert not found.causes and found.unit is None


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("strips", "first", "end"), [(2, 4, 8), (4, 12, 24), (4, 6, 12), (3, 0, 6)])
def test_a_step_in_the_heights_is_found_without_tags(seed, strips, first, end):
    block, told, groups = flight(seed, strips=strips, per_strip=4 if strips == 2 else 6)
    own = np.isin(np.arange(len(block.centre)), np.arange(first, end))
    photos, axes, value, sigma = single(causes_of(block, raised(quiet(block, told, seed), own, 15.0), groups, ORIGIN))
    assert axes == (2,) and (photos == own).all()
    assert abs(value[0] - 15.0) < 4 * sigma[0] and sigma[0] < 1.0


@pytest.mark.parametrize(("by", "axes"), [(0.5, (2,)), ((0.6, -0.4, 0.1), (0, 1, 2))])
def test_a_flight_of_its_own_has_its_own_offset(by, axes):
    block, told, groups = flight(3, **RTK)
    own = np.arange(24) >= 18
    found = causes_of(block, raised(told, own, by), replace(groups, flight=own.astype(int)), ORIGIN)
    photos, found_axes, value, _ = single(found)
    assert found_axes == axes and (photos == own).all() and np.abs(value - np.array(by).ravel()).max() < 0.05


@pytest.mark.parametrize("kind", [RTK, GPS])
@pytest.mark.parametrize("seed", range(3))
def test_heights_in_two_systems_are_one_offset_against_control(kind, seed):
    block, told, groups = flight(seed, **kind, control=5)
    everything = np.ones(24, bool)
    photos, axes, value, _ = single(causes_of(block, raised(told, everything, 47.2), groups, ORIGIN))
    assert photos.all() and axes == (2,)
    assert value[0] == pytest.approx(47.2, abs=15.0 if kind is GPS else 5.0)  # the camera constant moves the centres as well


@pytest.mark.parametrize("unit", [Unit("feet", True), Unit("feet", False)])
@pytest.mark.parametrize("kind", [RTK, GPS])
def test_control_in_feet_is_told_by_its_unit(unit, kind):
    block, told, groups = flight(5, **kind, control=5)
    factor = np.where([unit.heights_only, unit.heights_only, False], 1.0, 1.0 / 0.3048)
    found = causes_of(block, replace(told, control=told.control * factor), groups, ORIGIN)
    assert found.unit == unit and not found.causes


def test_one_wrong_position_is_no_offset():
    block, told, groups = flight(6, **RTK)
    own = np.arange(24) == 7
    found = causes_of(block, raised(told, own, 30.0), groups, ORIGIN)
    assert not found.causes
    assert np.abs(found.after.motion[:3]).max() < 0.1


def test_a_motion_of_the_whole_block_is_found_exactly():
    block, told, _ = flight(7, **RTK)
    motion = np.array([1.0, -2.0, 0.5, 0.02, -0.03, 0.05, 0.01])
    there = block.moved(motion)
    exact = replace(told, position=there.centre, attitude=there.rotation, constant=np.zeros(1))
    result = explained(block, exact)
    assert block.moved(result.motion).centre == pytest.approx(there.centre, abs=1e-3)
