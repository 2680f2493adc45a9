"""Blocks of image measurements whose sources contradict each other: named, adjusted, and right afterwards."""

from dataclasses import replace

import numpy as np
import pytest
from orienting import orient, sentences
from simulated_block import DRONE, simulate, surface, view

from orthomill.schemas.observations import Control
from orthomill.schemas.photo import Photos
from orthomill.schemas.raster import MapGrid
from orthomill.tasks.adjustment.testing.adjustment_result import ObservationKind
from orthomill.tasks.geometry.rotation import angles
from orthomill.tasks.orientation.sources.elevation_model import Lattice


def grid(seed, strips=3, per_strip=5, camera=lambda strip: DRONE, **options):
    """Strips of a drone, flown to and fro, with the attitudes of a gimbal; `camera` by strip."""
    rng = np.random.default_rng(3000 + seed)
    places = [(s, i if s % 2 == 0 else per_strip - 1 - i) for s in range(strips) for i in range(per_strip)]
    views = [
        view(
            f"s{s}_{n % per_strip}",
            camera(s),
            np.array([407000 + 15 * i, 4357000 + 30 * s, 180]) + rng.normal(0, 0.5, 3),
            (*rng.normal(0, 1, 2), 90 + 180 * (s % 2) + rng.normal(0, 2)),
        )
        for n, (s, i) in enumerate(places)
    ]
    nominal = DRONE.changed(c=1165.0, k1=0.0)
    block = simulate(views, nominal, seed, tracks=500, **({"gnss": 0.02, "control": 0, "check": 0} | options))
    turns = [np.degrees(angles(v.rotation)) + rng.normal(0, 0.5, 3) for v in views]
    return changed(block, lambda i, photo: {"attitude": tuple(map(float, turns[i])), "attitude_of": "gimbal"})


def changed(block, of_photo):
    photos = tuple(photo.model_copy(update=of_photo(i, photo)) for i, photo in enumerate(block.photos.photos))
    return replace(block, photos=Photos(photos=photos))


def shifted(block, first, by):
    """The positions from photograph `first` on moved by (3,) m."""
    return changed(block, lambda i, photo: {"position": tuple(np.array(photo.position) + (i >= first) * np.array(by))})


def of_code(out, code):
    return [finding for finding in out["precision"].findings if finding.code == code]


def errors(block, out):
    return np.array([np.array(out["block"].of(v.name).centre) - v.centre for v in block.views])


def test_a_sound_block_has_a_table_and_no_contradiction():
    out = orient(grid(1))
    assert not any(of_code(out, code) for code in ("offset_adjusted", "unit_contradicted", "sources_disagree"))
    told = {(row.source, row.parameter) for row in out["precision"].sources}
    assert {("positions in height", "tilt about X"), ("attitudes", "tilt about X")} <= told
    assert max(row.ratio for row in out["precision"].sources if row.ratio is not None) < 3.5


def test_two_strips_with_heights_15_m_apart_are_not_tilted():
    block = grid(2, strips=2, per_strip=4, gnss=0.1)
    block = shifted(changed(block, lambda i, photo: {"position_sigma": (3.0, 3.0, 5.0)}), 4, (0.0, 0.0, 15.0))
    out = orient(block)
    (found,) = of_code(out, "offset_adjusted")
    assert found.photos == ("s1_0", "s1_1", "s1_2", "s1_3") and found.against == "others" and found.offset[:2] == (None, None)
    assert abs(found.offset[2] - 15.0) < 4 * found.sigma[2] and found.sigma[2] < 1.0 and 8 < found.tilt_deg < 12
    assert np.abs(errors(block, out)[:, 2]).max() < 0.6
    assert not of_code(out, "datum_misfit") and out["precision"].offsets[0].axis == 2


@pytest.mark.slow
def test_a_flight_by_its_tags_has_three_offsets():
    block = shifted(grid(5, strips=4), 10, (0.3, -0.2, 0.6))
    out = orient(changed(block, lambda i, photo: {"flight": int(i >= 10)}))
    (found,) = of_code(out, "offset_adjusted")
    assert found.offset == pytest.approx((0.3, -0.2, 0.6), abs=0.1) and len(found.photos) == 10
    assert np.abs(errors(block, out)).max() < 0.15


@pytest.mark.slow
@pytest.mark.parametrize("gnss", [0.02, 3.0])
def test_heights_of_positions_and_control_in_two_systems_keep_the_control(gnss):
    block = shifted(grid(3, gnss=gnss, control=5), 0, (0.0, 0.0, 47.23))
    out = orient(block)
    (found,) = of_code(out, "offset_adjusted")
    assert found.against == "control" and abs(found.offset[2] - 47.23) < 4 * found.sigma[2]
    assert out["precision"].control_factor == 1.0 and out["precision"].position_factor == 1.0
    # Without the positions' heights only the photographs tell the camera constant, to half a percent.
    assert np.abs(errors(block, out)).max() < 1.0
    assert any("above the control" in sentence for sentence in sentences(out["precision"]))


@pytest.mark.slow
def test_control_in_feet_is_named_and_no_right_point_blamed():
    block = grid(4, gnss=3.0, control=5)
    feet = tuple(p.model_copy(update={"xyz": (*p.xyz[:2], p.xyz[2] / 0.3048)}) for p in block.control.points)
    out = orient(replace(block, control=Control(points=feet)))
    (found,) = of_code(out, "unit_contradicted")
    assert found.unit == "feet" and found.heights_only and found.fits_m < 5.0 < found.given_m
    assert not of_code(out, "control_contradicted") and not of_code(out, "datum_misfit")


def test_without_offsets_nothing_is_adjusted():
    out = orient(shifted(grid(3, control=5), 0, (0.0, 0.0, 47.23)), gnss_shift="none")
    assert not of_code(out, "offset_adjusted") and not out["precision"].offsets


@pytest.mark.parametrize("factor", [1.5, 1.06])
def test_strips_with_another_camera_constant_get_a_camera_of_their_own(factor):
    zoomed = DRONE.changed(c=factor * DRONE.c)
    block = grid(6, strips=4, per_strip=4, gnss=0.1, camera=lambda strip: zoomed if strip >= 2 else DRONE)
    out = orient(changed(block, lambda i, photo: {"position_sigma": (3.0, 3.0, 5.0)}))
    (found,) = of_code(out, "constant_of_its_own")
    assert found.photos == tuple(v.name for v in block.views[8:])
    assert found.c_px / found.others_px == pytest.approx(factor, rel=0.01)
    assert not of_code(out, "offset_adjusted") and len(out["block"].photos) == 16
    assert np.abs(errors(block, out) - np.median(errors(block, out), axis=0)).max() < 0.5
    assert len(set(out["block"].of_photo.values())) == 2


def test_heights_above_the_take_off_written_as_above_the_sea_are_one_offset():
    block = shifted(grid(3, gnss=3.0, control=5), 0, (0.0, 0.0, -2490.0))
    out = orient(changed(block, lambda i, photo: {"height_kind": "relative"}))
    (found,) = of_code(out, "offset_adjusted")
    assert found.against == "control" and abs(found.offset[2] + 2490.0) < 4 * found.sigma[2]
    assert np.abs(errors(block, out)).max() < 1.0 and not of_code(out, "positions_elsewhere")
    assert any("above the place of take-off" in sentence for sentence in sentences(out["precision"]))


@pytest.mark.parametrize(("raised", "told"), [(0.0, 0), (47.0, 1)])
def test_an_elevation_model_is_a_source_of_heights(raised, told):
    block = grid(3, gnss=2.0)
    x, y = np.meshgrid(np.arange(406900, 407200, 2.0) + 1.0, np.arange(4357300, 4356900, -2.0) - 1.0)
    grid_ = MapGrid(west=406900.0, north=4357300.0, cell=2.0, rows=x.shape[0], cols=x.shape[1])
    heights = surface(x - 407000, y - 4357000, 80.0) - raised
    out = orient(block, heights=heights, lattice=Lattice(grid_, 0.5))
    rows = {(row.source, row.parameter): row for row in out["precision"].sources}
    row = rows["elevation model", "shift in height"]
    assert row.value - row.others == pytest.approx(-raised, abs=8.0) and row.sigma < 1.0
    assert len(of_code(out, "sources_disagree")) == told


def two_drones(seed, sigma):
    """Four strips with stated errors of 2 cm, of which the odd ones were flown by a drone whose positions err by `sigma` m."""
    rng, block = np.random.default_rng(seed), grid(seed, strips=4)
    odd = [v.name.startswith(("s1", "s3")) for v in block.views]
    return changed(
        block,
        lambda i, photo: {
            "serial": "B" if odd[i] else "A",
            "flight": int(odd[i]),
            "position": tuple(np.array(photo.position) + odd[i] * rng.normal(0, sigma, 3)),
        },
    )


@pytest.mark.slow
def test_the_drone_whose_positions_err_is_weighed_down_and_the_other_keeps_its_weight():
    block = two_drones(9, 0.5)
    out = orient(block)
    good, bad = (group for group in out["precision"].groups if group.name == ObservationKind.POSITIONS)
    assert (good.part, bad.part) == ("A", "B") and good.factor == 1.0 and 15 < bad.factor < 40
    assert out["precision"].blunders == () and not of_code(out, "offset_adjusted")
    assert np.sqrt((errors(block, out) ** 2).mean(axis=0)).max() < 0.06
