"""Each cause that is planted into what the sources say is found, and nothing in sound ones; no images, only a rigid block."""

from dataclasses import replace

import numpy as np
import pytest
from rigid_flights import flight, raised

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector
from orthomill.tasks.orientation.sources.causes import Unit, causes_of
from orthomill.tasks.orientation.sources.elevation_model import Elevation, ElevationModel, Lattice
from orthomill.tasks.orientation.sources.evidence import Source, equations
from orthomill.tasks.orientation.sources.hypotheses import Bend, Offset, PlanScale, Zoom
from orthomill.tasks.orientation.sources.robust_motion import explained
from orthomill.tasks.orientation.sources.source_table import source_table

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


def quiet(block, told, seed, scatter=0.1):
    """Positions that are stated to metres but scatter by a decimetre: most of their error is common."""
    rng = np.random.default_rng(seed)
    return replace(told, position=block.centre + rng.normal(0, 2, 3) + rng.normal(0, scatter, block.centre.shape))


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


@pytest.mark.parametrize("share", [0.46, 0.004])
@pytest.mark.parametrize("seed", range(3))
def test_control_in_a_map_of_another_scale_is_told_by_it(share, seed):
    block, told, groups = flight(seed, strips=4, per_strip=12, **RTK, control=8)
    scaled = told.control.copy()
    scaled[:, :2] = block.middle[:2] + (1.0 + share) * (scaled[:, :2] - block.middle[:2])
    found = causes_of(block, replace(told, control=scaled), groups, ORIGIN)
    (cause,) = found.causes
    assert isinstance(cause, PlanScale) and found.unit is None
    value, sigma = found.after.parameters[-1], np.sqrt(found.after.covariance[-1, -1])
    assert abs(value - share) < max(4 * sigma, 0.01 * share)


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


def bent(block, by):
    """The block as a dome (by < 0: its ends are too low) that its photographs lean with, m from its middle to its ends."""
    away = block.centre[:, :2] - block.middle[:2]
    reach = np.linalg.norm(away, axis=1).max()
    lift = by * (away**2).sum(axis=1) / reach**2
    lean = 2.0 * by / reach**2 * np.column_stack([away[:, 1], -away[:, 0], np.zeros(len(away))])
    turned = np.array([R @ rotation_of_vector(w).T for R, w in zip(block.rotation, lean, strict=True)])
    return replace(block, centre=block.centre + lift[:, None] * [0, 0, 1], rotation=turned)


@pytest.mark.parametrize("seed", range(3))
def test_a_dome_is_a_dome_and_no_offset_of_its_middle(seed):
    block, told, groups = flight(seed, strips=5, per_strip=8, **RTK)
    found = causes_of(bent(block, -0.6), told, groups, ORIGIN)
    assert [type(cause) for cause in found.causes] == [Bend]
    assert found.after.parameters[-1] == pytest.approx(0.6, abs=0.05)


@pytest.mark.parametrize("seed", range(3))
def test_another_camera_constant_is_told_from_an_offset_by_oblique_views(seed):
    rng = np.random.default_rng(seed)
    block, told, groups = flight(seed, **RTK)
    lean = np.array([rotation_matrix(*np.radians([*rng.uniform(-30, 30, 2), 0.0])) for _ in block.centre])
    block = replace(block, rotation=np.einsum("nij,njk->nik", lean, block.rotation))
    own = np.arange(24) >= 12
    told = replace(told, position=told.position + np.where(own[:, None], 0.25 * block.backwards, 0.0), attitude=block.rotation)
    found = causes_of(block, told, groups, ORIGIN)
    (cause,) = found.causes
    assert isinstance(cause, Zoom) and (cause.photos == own).all()
    assert found.after.parameters[-1] == pytest.approx(0.25, abs=0.01)


def test_from_straight_above_an_offset_in_height_may_be_another_camera_constant():
    block, told, groups = flight(2, strips=2, per_strip=6, **RTK)
    own = np.arange(12) >= 6
    found = causes_of(block, raised(quiet(block, told, 2, 0.6), own, 12.0), groups, ORIGIN)
    (cause,) = found.causes
    assert isinstance(cause, Offset) and cause.axes == (2,)
    ((zoom, share),) = found.zooms
    assert (zoom.photos == own).all() and share == pytest.approx(0.2, abs=0.03)


def test_an_elevation_model_says_height_and_tilt():
    block, told, groups = flight(1, **GPS, common=0.0)
    rng = np.random.default_rng(1)
    ground = np.column_stack([rng.uniform(-5, 65, 200), rng.uniform(-5, 65, 200), np.zeros(200)])
    ground[:, 2] = 150.0 + 3.0 * np.sin(ground[:, 0] / 15)
    block = replace(block, ground=ground)
    grid = MapGrid(west=-20.0, north=90.0, cell=1.0, rows=110, cols=110)
    x, y = grid.centres(Window(0, 0, 110, 110))
    heights = 150.0 + 3.0 * np.sin(x / 15)[None, :] + 47.0 + 0.02 * (y - block.middle[1])[:, None]
    model = ElevationModel(Elevation(heights, Lattice(grid, 0.3)), np.zeros(3))
    found = causes_of(block, replace(told, model=model), groups, ORIGIN)
    has = equations(block, found.told)
    said = {(row.source, row.parameter.number): row for row in source_table(block, has, found.after, found.causes, groups)}
    height, tilt = said[Source.MODEL, 2], said[Source.MODEL, 3]
    assert height.value == pytest.approx(47.0, abs=0.2) and 0.25 < height.sigma < 0.4 and height.ratio > 5
    assert tilt.value == pytest.approx(0.02, abs=2e-3) and tilt.ratio > 2


def test_the_table_says_what_each_flight_and_each_source_of_a_bend_say():
    block, told, groups = flight(4, strips=4, per_strip=8, **RTK, control=6)
    own = np.arange(32) >= 16
    groups = replace(groups, flight=own.astype(int))
    found = causes_of(bent(block, -0.3), raised(told, own, 0.8), groups, ORIGIN)
    rows = list(source_table(bent(block, -0.3), equations(bent(block, -0.3), found.told), found.after, found.causes, groups))
    flights = [row for row in rows if row.parameter.kind == "flight"]
    assert len(flights) == 2 and flights[1].value - flights[1].others == pytest.approx(0.8, abs=0.1) and flights[1].ratio > 5
    bends = {row.source: row for row in rows if row.parameter.kind == "bend"}
    assert {Source.HEIGHT, Source.ATTITUDE, Source.CONTROL} == set(bends)
    assert bends[Source.HEIGHT].value == pytest.approx(0.3, abs=0.06)
    assert bends[Source.HEIGHT].ratio < 3
