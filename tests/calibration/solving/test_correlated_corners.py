"""Standard errors of corners that err together within a photograph."""

from dataclasses import replace

import numpy as np
import pytest
from board_truth import FREE, all_corners, network, plain, truth

from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment, adjust
from orthomill.tasks.calibration.solving.correlated_corners import correlation_factor
from orthomill.tasks.calibration.solving.solving import honest


def adjusted(seed: int, bend: float, boards: int = 1) -> BoardAdjustment:
    """Twelve photos with 0.05 px of noise, each bent by `bend` px in a direction of its own."""
    state = plain(truth(photos=12, boards=boards))
    corners = all_corners(state, 0.05, seed)
    own = np.random.default_rng([seed, 1]).normal(0.0, bend, (12, 2, 3))[corners.photo]
    x, y = (corners.xy - corners.xy.mean(axis=0)).T / 300.0
    shift = np.einsum("mij,mj->mi", own, np.column_stack([x * x, x * y, y * y]))
    return adjust(network(state), state, replace(corners, xy=corners.xy + shift))


@pytest.mark.parametrize("boards", [1, 3])
def test_independent_corners_keep_their_standard_errors(boards):
    factors = [correlation_factor(adjusted(seed, 0.0, boards)) for seed in range(6)]
    assert min(factors) >= 1.0 and np.mean(factors) < 1.2


def test_errors_that_corners_of_a_photo_share_are_in_the_standard_errors():
    state = plain(truth(photos=12, boards=1))
    free, formal, stated = range(len(FREE)), [], []
    for seed in range(12):
        result = adjusted(seed, 0.3)
        for found, own in ((formal, result), (stated, honest(result))):
            found.append((own.state.interior - state.interior)[free] / np.sqrt(np.diag(own.interior_covariance))[free])
    assert np.sqrt(np.mean(np.square(formal))) > 1.8, "independent corners were assumed"
    assert 0.6 < np.sqrt(np.mean(np.square(stated))) < 1.35


def test_the_factor_multiplies_all_standard_errors():
    result = adjusted(1, 0.3)
    wider = honest(result)
    assert wider.correlated == correlation_factor(result) > 1.3
    assert wider.covariance == pytest.approx(wider.correlated**2 * result.covariance) and wider.sigma0 == result.sigma0
