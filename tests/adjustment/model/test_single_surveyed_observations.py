"""Surveyed observations taken out of a network and put back."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import small_network

from orthomill.tasks.adjustment.model.network import Distances
from orthomill.tasks.adjustment.model.surveyed_observations import (
    Blunder,
    SurveyedKind,
    has_weight,
    weights_of,
    with_weight,
    without,
)


@pytest.fixture
def network():
    network, _, _ = small_network()
    ends = np.array([[5, 20], [6, 21]])
    return replace(network, kept=np.unique(ends), distances=Distances(ends, np.full(2, 30.0), np.full(2, 1e4)))


@pytest.mark.parametrize("kind", SurveyedKind)
def test_an_observation_is_removed_alone_and_put_back_unchanged(network, kind):
    blunder = Blunder(kind, 1, 9.0)
    given = weights_of(network, kind)[1]
    less = without(network, blunder)
    assert has_weight(network, blunder) and not has_weight(less, blunder)
    for other in SurveyedKind:
        changed = weights_of(less, other) != weights_of(network, other)
        assert changed.any() == (other == kind) and not np.delete(changed, 1, axis=0).any()
    back = with_weight(less, blunder, given)
    assert all((weights_of(back, other) == weights_of(network, other)).all() for other in SurveyedKind)


@pytest.mark.parametrize("kind", SurveyedKind)
def test_only_a_point_without_its_coordinates_is_still_measured_by_a_person(network, kind):
    less = without(network, Blunder(kind, 1, 9.0))
    assert less.pointed[1] and (less.pointed == network.pointed).all()
    assert (1 in less.named) == (kind == SurveyedKind.CONTROL)
