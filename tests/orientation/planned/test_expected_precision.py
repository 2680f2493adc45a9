"""What is expected of a block is what happens to it: blocks drawn from what is known, adjusted, and compared with their truth."""

from dataclasses import replace

import numpy as np
import pytest

from orthomill.tasks.adjustment.model.collinearity import residuals
from orthomill.tasks.adjustment.model.interior import camera_covariance
from orthomill.tasks.adjustment.model.network import State
from orthomill.tasks.adjustment.solve.minimise import minimise
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.planned.expected_precision import bend_forms, expected_precision, often_seen
from orthomill.tasks.orientation.planned.planned_block import PlannedBlock
from orthomill.tasks.orientation.planned.planned_network import (
    COMMON,
    GIMBAL,
    IMAGE,
    NO_MEASURES,
    PlannedMeasures,
    PlannedNetwork,
    planned_network,
)
from orthomill.tasks.orientation.planned.remedies import with_control
from tests.support.scenes.planned_flights import GPS, RTK, block, serpentine

SEEDS = 24
AGREES = 0.7, 1.5
"""Ratio of what happens to what is expected"""
BENDS = 0.6, 1.5
"""The same of bends: errors that are equal all over an area act less on distortion than single ones of the same weight do."""


def drawn(planned: PlannedNetwork, own: PlannedBlock, measures: PlannedMeasures, rng: np.random.Generator) -> PlannedNetwork:
    """The measurements of one flight: a camera, positions and image errors as likely as is stated."""
    network, state, rays = planned.network, planned.state, planned.rays
    prior = camera_covariance(own.cameras[0])
    k3 = 0.3**2 if own.cameras[0].source == "exif" else 0.0
    prior[5, 5] = prior[5, 5] or k3
    interior = state.interior + rng.multivariate_normal(np.zeros(len(prior)), prior)
    true = replace(state, interior=interior)
    areas = rng.normal(0, IMAGE, (network.photos, 3, 3, 2))
    size = np.array([own.cameras[0].width, own.cameras[0].height])
    place = np.clip(((rays.xy / size + 0.5) * 3).astype(int), 0, 2)
    noise = areas[rays.photo, place[:, 0], place[:, 1]] + rng.normal(0, 0.05, rays.xy.shape)
    xy = rays.xy - residuals(true, rays, network.camera_of) + noise
    sigma, common = own.sigma, own.common[:, None]
    shared = np.where(common, COMMON * rng.normal(0, 1, 3) * sigma, 0.0)
    single = rng.normal(0, 1, sigma.shape) * sigma * np.where(common, np.sqrt(1 - COMMON**2), 1.0)
    askew = rotation_matrix(*np.radians(rng.normal(0, GIMBAL, 2)), 0.0)
    known = replace(network, centre=network.centre + shared + single, up=network.up @ askew.T)
    if len(measures.control):
        point = known.point.copy()
        point[planned.ties :] += rng.normal(0, 1, measures.sigma.shape) * measures.sigma
        known = replace(known, point=point)
    return replace(planned, network=known, rays=replace(rays, xy=xy))


def errors(own: PlannedBlock, measures: PlannedMeasures) -> tuple[np.ndarray, np.ndarray]:
    """(s, n, 3) errors of the ground points that are often seen, and where (n, 2) they are, of flights drawn at random."""
    planned, found = planned_network(own, measures), []
    points = often_seen(planned)
    for seed in range(SEEDS):
        flown = drawn(planned, own, measures, np.random.default_rng([5, seed]))
        state: State = minimise(flown.network, planned.state, flown.rays)[0]
        found.append((state.point - planned.state.point)[points])
    return np.array(found), planned.state.point[points, :2]


FIVE = np.array([(60.0, 60.0, 0.0), (5.0, 5.0, 0.0), (115.0, 5.0, 0.0), (5.0, 115.0, 0.0), (115.0, 115.0, 0.0)])
KINDS = {
    "RTK": (RTK, None),
    "GPS": (GPS, None),
    "GPS and five control points": (GPS, FIVE),
    "RTK and one control point": (RTK, FIVE[:1]),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_errors_are_as_large_as_expected(kind):
    sigma, control = KINDS[kind]
    own = block(*serpentine(4, 5), sigma=sigma)
    measures = with_control(own, control)
    expected, (found, xy) = expected_precision(planned_network(own, measures)), errors(own, measures)
    square = (found**2).mean(axis=0)
    forms = bend_forms(xy)
    bends = [np.ptp(forms @ (forms.T @ flown[:, 2] / len(xy))) for flown in found]
    assert AGREES[0] < np.sqrt(np.median(square[:, :2].mean(axis=1))) / expected.plan < AGREES[1]
    assert AGREES[0] < np.sqrt(np.median(square[:, 2])) / expected.height < AGREES[1]
    assert BENDS[0] < np.sqrt(np.mean(np.square(bends))) / expected.bend < BENDS[1]


def precision(own: PlannedBlock, measures: PlannedMeasures = NO_MEASURES):
    return expected_precision(planned_network(own, measures))


def test_control_corrections_and_calibration_each_make_heights_better():
    own = block(*serpentine(4, 5))
    before = precision(own)
    assert precision(own, with_control(own, FIVE)).height < 0.05 * before.height
    assert precision(own, replace(NO_MEASURES, positions=RTK)).height < 0.8 * before.height
    assert precision(own, replace(NO_MEASURES, calibrated=True)).bend < 0.7 * before.bend


def test_strips_across_and_at_another_height_bend_less():
    places, headings = serpentine(4, 5)
    more = places[::2, [1, 0, 2]] * (1.0, 1.0, 1.4)
    crossed = block(np.vstack([places, more]), np.append(headings, np.full(len(more), 90.0)))
    assert precision(crossed).bend < 0.8 * precision(block(places, headings)).bend


def test_common_errors_of_positions_move_the_block_and_do_not_bend_it():
    own = block(*serpentine(4, 5), sigma=RTK)
    shared = block(*serpentine(4, 5), sigma=RTK, common=np.ones(20, bool))
    assert precision(shared).bend <= precision(own).bend
    assert precision(shared).plan > 0.9 * COMMON * RTK[0]


def test_forms_have_no_plane_and_narrow_blocks_none_across():
    xy = np.random.default_rng(2).uniform(0, 100, (40, 2))
    forms = bend_forms(xy)
    assert np.allclose(forms.T @ np.column_stack([np.ones(40), xy]), 0, atol=1e-6)
    assert np.allclose(forms.T @ forms / 40, np.eye(3))
    assert bend_forms(xy * (1.0, 0.01)).shape == (40, 2)
