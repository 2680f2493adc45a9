"""The bundle of photographs of boards: derivatives, recovery, precision that means what it says, wrong corners, uncertain
boards."""

from dataclasses import replace

import numpy as np
import pytest
from board_truth import FREE, all_corners, disturbed, network, plain, truth

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.boards.board_bundle import CornerTest, adjust, minimise
from orthomill.tasks.adjustment.boards.board_network import PARAMETERS, BoardState
from orthomill.tasks.adjustment.boards.board_projection import derivatives, projected
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector


def test_derivatives_agree_with_differences():
    state = truth(height=0.1)
    corners = all_corners(state).take(np.arange(0, 480, 7))
    by_unknowns, by_corner = derivatives(state, corners)
    step = 1e-6
    for column in range(22):  # those of Brown's lens
        difference = (projected(stepped(state, column, step), corners) - projected(stepped(state, column, -step), corners)) / (
            2 * step
        )
        scale = max(np.abs(by_unknowns[:, :, column]).max(), 1.0)
        assert np.abs(by_unknowns[:, :, column] - difference).max() < 1e-6 * scale, column
    for axis in range(3):
        local = [replace(state, local=state.local + sign * step * np.eye(3)[axis]) for sign in (1, -1)]
        difference = (projected(local[0], corners) - projected(local[1], corners)) / (2 * step)
        assert np.abs(by_corner[:, :, axis] - difference).max() < 1e-6 * np.abs(by_corner).max()


def stepped(state: BoardState, column: int, step: float) -> BoardState:
    unit = step * np.eye(6)[column % 6]
    if column >= 12:
        interior = state.interior.copy()
        interior[column - 12] += step
        return replace(state, interior=interior)
    turn = rotation_of_vector(unit[3:])
    if column < 6:
        return replace(state, centre=state.centre + unit[:3], rotation=turn @ state.rotation)
    return replace(state, shift=state.shift + unit[:3], turn=turn @ state.turn)


@pytest.mark.parametrize(("boards", "arrangement", "height"), [(1, "plane", 0.0), (3, "plane", 0.0), (3, "space", 0.12)])
def test_exact_corners_give_everything_back(boards, arrangement, height):
    state = plain(truth(boards=boards, height=height))
    result = adjust(network(state, arrangement=arrangement), disturbed(state), all_corners(state))
    assert result.state.interior == pytest.approx(state.interior, rel=1e-6, abs=1e-6)
    assert result.state.shift == pytest.approx(state.shift, abs=1e-8)
    assert result.sigma0 < 1e-5 and result.iterations <= 12 and result.used.all()


@pytest.mark.parametrize("free", [(*FREE, "k3"), (*FREE, "p1", "p2"), PARAMETERS[:10]])
def test_every_parameter_can_be_estimated(free):
    state = plain(truth(photos=12), free)
    result = adjust(network(state, free), disturbed(state, free), all_corners(state, 0.02))
    sigma = np.sqrt(np.diag(result.interior_covariance))
    chosen = [name in free for name in PARAMETERS]
    assert (np.abs(result.state.interior - state.interior)[chosen] < 4.5 * sigma[chosen]).all()
    assert not sigma[np.logical_not(chosen)].any() and (sigma[chosen] > 0).all()


def test_standard_errors_are_what_repetition_shows():
    state = plain(truth(photos=6))
    results = [adjust(network(state), disturbed(state), all_corners(state, 0.2, seed)) for seed in range(25)]
    errors = np.array([result.state.interior[:5] - state.interior[:5] for result in results])
    sigmas = np.array([np.sqrt(np.diag(result.interior_covariance))[:5] for result in results])
    ratio = np.sqrt((errors**2).mean(axis=0)) / sigmas.mean(axis=0)
    assert np.all((ratio > 0.6) & (ratio < 1.5)), ratio
    assert np.mean([result.sigma0 for result in results]) == pytest.approx(0.2, rel=0.05)
    assert results[0].redundancy == 2 * 6 * 3 * 20 - (36 + 6 + 5)


def test_wrong_corners_are_rejected_and_only_they():
    state = plain(truth())
    corners = all_corners(state, 0.1)
    wrong = np.random.default_rng(1).choice(len(corners), 20, replace=False)
    corners.xy[wrong] += np.random.default_rng(2).choice([-1, 1], (20, 2)) * np.random.default_rng(2).uniform(1.5, 40, (20, 2))
    result = adjust(network(state), disturbed(state), corners)
    assert not result.used[wrong].any() and (~result.used).sum() <= 24
    assert result.sigma0 == pytest.approx(0.1, rel=0.1)


def test_uncertain_boards_are_estimated_with_their_weight():
    state = plain(truth(photos=12))
    bent = state.local + np.random.default_rng(4).normal(0, 2e-4, state.local.shape)
    corners = all_corners(replace(state, local=bent), 0.05)
    stiff = adjust(network(state), disturbed(state), corners, CornerTest(limit=50.0))
    loose = network(state, local_sigma=(2e-4, 2e-4, 2e-4), image_sigma=0.05)
    result = adjust(loose, stiff.state, corners)
    assert result.sigma0 == pytest.approx(0.05, rel=0.15) and stiff.sigma0 > 2.5 * result.sigma0
    moved, true = (result.state.local - state.local).ravel(), (bent - state.local).ravel()
    assert np.corrcoef(moved, true)[0, 1] > 0.9


def test_photos_of_one_direction_are_refused_or_have_huge_standard_errors():
    state = plain(truth(photos=4))
    level = replace(state, rotation=np.tile(np.eye(3), (4, 1, 1)), centre=np.tile([[0.35, 0.1, 0.9]], (4, 1)))
    network_of = network(level, ("c", "x0", "y0"))
    start = level.with_interior(k1=0.0, k2=0.0)
    try:
        result = adjust(network_of, start, all_corners(start, 0.1))
    except GeometryError as error:
        assert "tilted" in str(error)
    else:
        assert np.sqrt(result.interior_covariance[0, 0]) > 10.0, "a constant that is not determined has a huge standard error"


def test_fixed_boards_and_cameras_leave_the_photos():
    state = plain(truth())
    corners = all_corners(state)
    found, _ = minimise(network(state, (), "fixed"), replace(disturbed(state), interior=state.interior, shift=state.shift), corners)
    assert found.centre == pytest.approx(state.centre, abs=1e-7) and (found.interior == state.interior).all()
