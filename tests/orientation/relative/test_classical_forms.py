"""A pair of an adjusted block in the classical forms: its tie points and the block say the same, in any turn of the photographs."""

from dataclasses import replace

import numpy as np
import pytest
from orienting import orient
from simulated_block import two_strips

from orthomill.pipeline.cli.lookups.relative_lines import relative_lines
from orthomill.schemas.errors import GeometryError, PhotoError
from orthomill.tasks.orientation.relative.classical_forms import classical_forms
from orthomill.tasks.orientation.relative.pair_precision import axes, scatter


@pytest.fixture(scope="module")
def adjusted():
    block = two_strips(seed=4)
    return block, orient(block)["block"]


def forms_of(adjusted, left, right):
    simulated, block = adjusted
    return classical_forms(block, simulated.photos, simulated.tie_points, left, right)


def test_tie_points_and_block_agree_within_their_standard_errors(adjusted):
    names = adjusted[1].names
    found = forms_of(adjusted, names[1], names[2])
    assert [unknown.form for unknown in found.unknowns] == ["dependent"] * 5 + ["five rotations"] * 5
    for unknown in found.unknowns:
        assert 0.4 < unknown.sigma_of_block / unknown.sigma_of_points < 1.2, (
            "the camera is calibrated, and the block holds more rays"
        )
        assert abs(unknown.of_points - unknown.of_block) < 4 * unknown.sigma_of_points
    assert found.kept > 0.9 * found.matches and found.sigma0_px == pytest.approx(0.3, rel=0.2)


def test_the_pair_named_the_other_way_round_is_turned(adjusted):
    names = adjusted[1].names
    there, back = forms_of(adjusted, names[1], names[2]), forms_of(adjusted, names[2], names[1])
    turns = np.subtract(back.quarter_turns, there.quarter_turns) % 4
    assert turns.tolist() == [2, 2], "the base points the other way"
    # With both photographs exchanged and turned by half a turn, the rotation between them is the inverse one.
    kappa = {unknown.name: unknown.of_block for unknown in there.unknowns[:5]}["kappa"]
    assert {unknown.name: unknown.of_block for unknown in back.unknowns[:5]}["kappa"] == pytest.approx(-kappa, abs=0.02)


def test_without_covariances_there_are_values_alone(adjusted):
    simulated, block = adjusted
    bare = block.model_copy(update={"joint": ()})
    found = classical_forms(bare, simulated.photos, simulated.tie_points, *bare.names[1:3])
    assert all(unknown.sigma_of_block is None and unknown.sigma_of_points for unknown in found.unknowns)
    assert [u.of_block for u in found.unknowns] == pytest.approx(
        [u.of_block for u in forms_of(adjusted, *bare.names[1:3]).unknowns]
    )


def test_unknown_photographs_and_pairs_without_common_points_are_named(adjusted):
    names = adjusted[1].names
    with pytest.raises(PhotoError, match="ghost is not in the block; it holds"):
        forms_of(adjusted, names[0], "ghost")
    simulated, block = adjusted
    alone = simulated.tie_points.take(simulated.tie_points.photo != simulated.photos.names.index(names[1]))
    with pytest.raises(GeometryError, match="share 0 tie points; a relative orientation needs six"):
        classical_forms(block, simulated.photos, alone, *names[:2])


def test_a_base_along_the_view_has_no_classical_form(adjusted):
    simulated, block = adjusted
    first, second = block.photos[1:3]
    above = second.model_copy(update={"centre": (*first.centre[:2], first.centre[2] + 30.0)})
    lifted = block.model_copy(update={"photos": tuple(above if p.photo == second.photo else p for p in block.photos)})
    with pytest.raises(GeometryError, match="lies along the view"):
        classical_forms(lifted, simulated.photos, simulated.tie_points, first.photo, second.photo)


def test_wrong_matches_that_hide_each_other_are_named_and_the_pair_started_again(adjusted):
    simulated, block = adjusted
    left, right = (simulated.photos.names.index(name) for name in block.names[1:3])
    shown = [set(simulated.tie_points.track[simulated.tie_points.photo == number].tolist()) for number in (left, right)]
    wrong = sorted(shown[0] & shown[1])[::3]
    row = simulated.tie_points.row.copy()
    own = (simulated.tie_points.photo == right) & np.isin(simulated.tie_points.track, wrong)
    # Alike in size, they widen sigma0 until none of them exceeds the limit.
    row[own] += 40.0 * np.random.default_rng(3).choice([-1.0, 1.0], own.sum())
    spoilt = replace(simulated.tie_points, row=row)
    found = classical_forms(block, simulated.photos, spoilt, *block.names[1:3])
    assert found.failed_start and found.failed_start[1] > 3 * found.sigma0_px and found.kept <= found.matches - 0.8 * len(wrong)
    away = [abs(u.of_points - u.of_block) / np.hypot(u.sigma_of_points, u.sigma_of_block) for u in found.unknowns]
    assert max(away) < 4
    assert "The published procedure went wrong" in list(relative_lines(found))[1]


def test_standard_errors_hold_what_neighbouring_points_share():
    rng = np.random.default_rng(8)
    places = rng.uniform(-500, 500, (400, 2))
    # Errors that are common to the points of a part of the photograph, beside their own.
    common = rng.normal(0, 1.0, (4, 4))[tuple(np.clip((places + 500) // 250, 0, 3).astype(int).T)]
    value = common + rng.normal(0, 0.1, 400)

    def mean(observations):
        return np.repeat(observations[:, 2].mean(), 5)

    found = np.sqrt(scatter(np.column_stack([places, value, value]), mean))
    alone = value.std() / 20.0
    assert 3 * alone < found[0] and found[0] == pytest.approx(common.std() / 4.0, rel=0.5)
    assert scatter(np.column_stack([places[:3], places[:3]]), mean) is None


def test_a_camera_that_is_not_known_widens_the_standard_errors(adjusted):
    simulated, block = adjusted
    name, camera = next(iter(block.cameras.items()))
    unknown = np.zeros((17, 17))
    unknown[1, 1] = unknown[2, 2] = 5.0**2
    loose = block.model_copy(update={"cameras": {name: camera.model_copy(update={"covariance": tuple(map(tuple, unknown))})}})
    known = classical_forms(block, simulated.photos, simulated.tie_points, *block.names[1:3])
    found = classical_forms(loose, simulated.photos, simulated.tie_points, *block.names[1:3])
    assert max(a.sigma_of_points / b.sigma_of_points for a, b in zip(found.unknowns, known.unknowns, strict=True)) > 1.3
    assert np.allclose((axes(unknown) ** 2).sum(axis=0), np.diag(unknown))
