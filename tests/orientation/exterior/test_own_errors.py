"""Positions of a flight share most of their errors: the common part moves the block, the own parts tilt it."""

from dataclasses import replace

import numpy as np
import pytest
from orienting import orient
from photographed_layouts import layout
from simulated_block import photo_of
from small_network import small_network

from orthomill.schemas.findings.datum_findings import TiltUnobserved
from orthomill.schemas.observations import Control
from orthomill.schemas.photo import Photos
from orthomill.tasks.orientation.exterior.own_errors import OwnParts, held_by_own, own_turn, with_own_parts
from orthomill.tasks.orientation.start.georeference import WEAK_TURN, Datum
from orthomill.tasks.orientation.start.similarity import Similarity

STATED = (3.0, 3.0, 5.0)


def flown(shape, common, own, seed=0):
    """A block of one flight without control, whose positions err by `common` (3,) together and by `own` (3,) each, m."""
    rng, block = np.random.default_rng(seed), layout(shape, "control")
    photos = [photo_of(view, view.centre + common + own * rng.standard_normal(3), 1.0) for view in block.views]
    photos = tuple(photo.model_copy(update={"position_sigma": STATED}) for photo in photos)
    return replace(block, photos=Photos(photos=photos), control=Control())


def errors(block, out):
    """(P, 3) m of the projection centres, and their standard errors."""
    found = [out["block"].of(view.name) for view in block.views]
    away = np.array([one.centre for one in found]) - np.array([view.centre for view in block.views])
    return away, np.array([np.sqrt(np.diag(np.array(one.covariance))[:3]) for one in found])


def test_what_a_flight_has_in_common_is_stated_and_its_own_parts_hold_the_tilt():
    block = flown("crossed_block", np.array([2.0, -2.5, 4.0]), np.array([0.2, 0.2, 0.3]))
    out = orient(block, gnss_shift="auto")
    away, sigma = errors(block, out)
    assert "differ from each other by" in out["block"].datum and "as stated" in out["block"].datum
    np.testing.assert_allclose(np.median(sigma, axis=0), STATED, rtol=0.05)
    assert not any(finding.code == "tilt_unobserved" for finding in out["precision"].findings)
    # What is left of the errors without the common part is far smaller than stated: the block has its shape and its tilt.
    assert np.abs(away - away.mean(axis=0)).max() < 0.6
    apart = orient(block, gnss_shift="none", relative=out["relative"])
    assert "differ" not in apart["block"].datum


def test_positions_that_err_as_stated_are_left_alone():
    block = flown("crossed_block", np.zeros(3), np.array(STATED))
    assert "differ" not in orient(block)["block"].datum


def parts_of(own, common, photos):
    return OwnParts(np.tile(np.array(own, float), (photos, 1)), np.tile(np.array(common, float), (photos, 1)))


def test_a_flight_gets_a_weighted_shift_and_one_with_an_offset_keeps_its_own():
    network, state, _ = small_network(photos=6)
    shift = np.full((6, 3), -1)
    shift[3:, 2] = 0
    network, state = replace(network, shift=shift), replace(state, shift=np.array([7.0]))
    flight = np.array([0, 0, 0, 1, 1, 1])
    network, state = with_own_parts(network, state, parts_of((0.2, 0.2, 0.4), (3.0, 3.0, 5.0), 6), flight, assumed=False)
    assert network.shift[0].tolist() == [1, 2, 3] and network.shift[5].tolist() == [4, 5, 0]
    np.testing.assert_allclose(network.shift_weights, [0, 1 / 9, 1 / 9, 1 / 25, 1 / 9, 1 / 9])
    np.testing.assert_allclose(network.centre_weight[0], [25.0, 25.0, 6.25])
    assert state.shift.tolist() == [7.0, 0, 0, 0, 0, 0]


@pytest.mark.parametrize("own", [0.3, 30.0])
def test_the_tilt_is_told_by_the_own_parts(own):
    network, _, _ = small_network(photos=6)
    datum = held_by_own(_weak_datum(), own_turn(network, parts_of((own,) * 3, (3.0,) * 3, 6)))
    told = [finding for finding in datum.findings if isinstance(finding, TiltUnobserved)]
    assert bool(told) == (own > 1) and (datum.basis is None) == (own < 1)
    assert all(finding.tilt_sigma_deg is None or np.radians(finding.tilt_sigma_deg) > WEAK_TURN for finding in told)


def _weak_datum():
    none = np.zeros(0, bool)
    found = (TiltUnobserved(tilt_sigma_deg=2.5, basis="down", sigma_deg=2.2),)
    return Datum(Similarity(1.0, np.eye(3), np.zeros(3)), np.zeros(3), False, np.zeros((6, 3)), "", found, none, none, basis="down")
