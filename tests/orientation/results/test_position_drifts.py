"""Positions that drift along a flight: told with a standard error, and among the findings where they are more than stated."""

from dataclasses import replace

import numpy as np
import pytest
from orienting import orient, sentences
from simulated_block import two_strips

from orthomill.schemas.photo import Photos

DRIFT = np.array([0.0, 0.0, 3.0])
"""m from the first to the last of six photographs"""


def timed(block, drift):
    """The block as a flight of ten minutes whose positions drift."""
    photos = [
        photo.model_copy(
            update={"time": f"2026-05-01T10:{2 * i:02d}:00", "position": tuple(np.array(photo.position) + (i / 5 - 0.5) * drift)}
        )
        for i, photo in enumerate(block.photos.photos)
    ]
    return replace(block, photos=Photos(photos=tuple(photos)))


@pytest.fixture(scope="module")
def drifting():
    return orient(timed(two_strips(21), DRIFT))["precision"]


def test_a_drift_is_found_with_its_standard_error_and_named_before_other_things(drifting):
    (drift,) = drifting.drifts
    assert len(drift.photos) == 6 and drift.hours == pytest.approx(1 / 6)
    assert (np.abs(np.array(drift.value) - DRIFT) < 4 * np.array(drift.sigma)).all()
    (text,) = [text for text in sentences(drifting) if "drift against the block, in 10 min" in text]
    assert "m in height" in text


def test_positions_that_do_not_drift_are_not_said_to():
    found = [orient(timed(two_strips(seed), 0 * DRIFT))["precision"] for seed in (22, 23)]
    assert not [text for each in found for text in sentences(each) if "drift" in text]
    ratios = np.array([np.array(each.drifts[0].value) / each.drifts[0].sigma for each in found])
    assert (np.abs(ratios) < 4).all()


def test_nothing_is_said_of_photographs_without_times():
    assert orient(two_strips(21))["precision"].drifts == ()
