"""Surveyed observations one by one: positions, control points and distances, each with the weights that it has in a network."""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from orthomill.tasks.adjustment.model.network import Network


class SurveyedKind(StrEnum):
    """The kinds of observations that are tested, rejected and reinstated as a whole."""

    CONTROL = "control"
    POSITION = "position"
    DISTANCE = "distance"


@dataclass(frozen=True)
class Blunder:
    """A surveyed observation that contradicts the rest: its `kind`, the `number` of its photograph, point or distance, and its
    misfit in standard errors."""

    kind: SurveyedKind
    number: int
    misfit: float


def weights_of(network: Network, kind: SurveyedKind) -> np.ndarray:
    """Weights of all observations of a kind: positions (P, 3), control (N, 3) or distances (D,)."""
    if kind == SurveyedKind.POSITION:
        return network.centre_weight
    return network.point_weight if kind == SurveyedKind.CONTROL else network.distances.weight


def has_weight(network: Network, blunder: Blunder) -> bool:
    """Whether the observation takes part in the network."""
    return bool(np.any(weights_of(network, blunder.kind)[blunder.number]))


def with_weight(network: Network, blunder: Blunder, weight: np.ndarray | float) -> Network:
    """The network in which the observation has another weight."""
    # Networks share their arrays: a copy, or the network given to `adjust` would lose the weight, too.
    weights = weights_of(network, blunder.kind).copy()
    weights[blunder.number] = weight
    if blunder.kind == SurveyedKind.POSITION:
        return replace(network, centre_weight=weights)
    if blunder.kind == SurveyedKind.DISTANCE:
        return replace(network, distances=replace(network.distances, weight=weights))
    return replace(network, point_weight=weights)


def without(network: Network, blunder: Blunder) -> Network:
    """The network without the observation."""
    changed = with_weight(network, blunder, 0.0)
    # Wrong coordinates do not make wrong pointings: the point stays one that a person measured, and keeps its group.
    return replace(changed, named=np.append(network.named, blunder.number)) if blunder.kind == SurveyedKind.CONTROL else changed
