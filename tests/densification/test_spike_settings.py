"""Every setting of the spike filter does what its sentence says."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from orthomill.tasks.densification.settings.surface_settings import SpikeFilter
from orthomill.tasks.densification.spike_filter import spikes, stray

ONLY_NEAR = {"far_radius": 0.0}
"""the wider circle switched off"""


def flat(side: int = 31, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    return (100 + noise * np.random.default_rng(seed).standard_normal((side, side))).astype(np.float32)


def with_patch(height: float, half: int, side: int = 31) -> tuple[np.ndarray, tuple[slice, slice]]:
    """Flat ground with a square plateau of 2 half + 1 cells."""
    ground, place = flat(side), (slice(side // 2 - half, side // 2 + half + 1),) * 2
    ground[place] += height
    return ground, place


@pytest.mark.parametrize(("sigmas", "found"), [(3.0, True), (12.0, False)])
def test_sigmas_is_the_limit_in_standard_deviations(sigmas, found):
    ground = flat(noise=0.5)
    ground[15, 15] += 4.0
    rules = SpikeFilter(sigmas=sigmas, min_support=0, **ONLY_NEAR)
    assert spikes(ground, 1.0, rules)[15, 15] == found


@pytest.mark.parametrize(("floor", "found"), [(0.1, True), (2.0, False)])
def test_floor_protects_small_deviations_on_flat_ground(floor, found):
    ground = flat()
    ground[15, 15] += 1.0
    assert spikes(ground, 1.0, SpikeFilter(floor=floor, **ONLY_NEAR))[15, 15] == found


def test_floor_is_a_share_of_the_cell():
    ground = flat()
    ground[15, 15] += 1.0
    rules = SpikeFilter(floor=0.6, **ONLY_NEAR)
    assert spikes(ground, 1.0, rules)[15, 15] and not spikes(ground, 2.0, rules)[15, 15]


@pytest.mark.parametrize(("radius", "support"), [(1.0, 4), (2.0, 12), (3.0, 28)])
def test_radius_is_that_of_a_circle_of_cells(radius, support):
    """A height needs as many supporters as its circle has cells: only complete circles keep their centre."""
    complete = SpikeFilter(radius=radius, min_support=support, rounds=1, **ONLY_NEAR)
    removed = spikes(flat(), 1.0, complete)
    reach = int(radius)
    assert not removed[reach:-reach, reach:-reach].any() and removed[:reach].all()
    assert spikes(flat(), 1.0, complete.model_copy(update={"min_support": support + 1})).all()


@pytest.mark.parametrize(("slope", "kept"), [(0.5, False), (2.5, True)])
def test_support_slope_decides_who_supports(slope, kept):
    """Ground of slope 2: neighbours along the slope line support only when slopes of 2 are allowed."""
    slanted = (2.0 * np.arange(31.0)[None, :] + np.zeros((31, 1))).astype(np.float32)
    rules = SpikeFilter(support_slope=slope, min_support=45, sigmas=50.0, floor=0.0, **ONLY_NEAR)
    assert (not spikes(slanted, 1.0, rules)[15, 15]) == kept


def test_a_second_round_finds_what_a_greater_spike_had_hidden():
    ground = flat(noise=0.05)
    ground[15, 15], ground[15, 17] = 160.0, 103.0
    one, two = (spikes(ground, 1.0, SpikeFilter(rounds=rounds, min_support=0, **ONLY_NEAR)) for rounds in (1, 2))
    assert one[15, 15] and not one[15, 17]
    assert two[15, 15] and two[15, 17]


def test_without_rounds_only_stray_heights_go():
    ground = flat()
    ground[15, 15] += 50.0
    assert not spikes(ground, 1.0, SpikeFilter(rounds=0, **ONLY_NEAR)).any()
    rules = SpikeFilter(rounds=0)
    assert np.array_equal(spikes(ground, 1.0, rules), stray(ground, 1.0, rules))


@pytest.mark.parametrize(("slope", "stays"), [(0.5, False), (6.0, True)])
def test_far_slope_decides_what_the_wider_circle_supports(slope, stays):
    """A plateau of 20 m: the ground 8 to 12 cells away supports it only where slopes of 2 or more are believed."""
    ground, place = with_patch(20.0, 2)
    assert (not stray(ground, 1.0, SpikeFilter(far_slope=slope, far_support=0.3))[place].any()) == stays


@pytest.mark.parametrize(("radius", "stays"), [(6.0, True), (14.0, False)])
def test_far_radius_is_the_size_of_the_wider_circle(radius, stays):
    """A plateau of 11 by 11 cells fills half of a small circle but little of a large one."""
    ground, _ = with_patch(60.0, 5, side=61)
    assert (not stray(ground, 1.0, SpikeFilter(far_radius=radius, far_support=0.5))[30, 30]) == stays


@pytest.mark.parametrize(("share", "stays"), [(0.05, True), (0.6, False)])
def test_far_support_is_the_share_that_must_agree(share, stays):
    ground, _ = with_patch(60.0, 3, side=61)
    assert (not stray(ground, 1.0, SpikeFilter(far_support=share))[30, 30]) == stays


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6), shift=st.integers(-500, 500))
def test_the_datum_of_the_heights_does_not_matter(seed, shift):
    """Heights in whole quarters of a metre, so that shifted ones are exact in float32."""
    height = np.round(np.random.default_rng(seed).normal(50, 2, (16, 16)) * 4).astype(np.float32) / 4
    assert np.array_equal(spikes(height, 1.0, SpikeFilter()), spikes(height + np.float32(shift), 1.0, SpikeFilter()))


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_turning_the_surface_turns_the_spikes(seed):
    rng = np.random.default_rng(seed)
    height = rng.normal(50, 2, (16, 16)).astype(np.float32)
    height[rng.random(height.shape) < 0.2] = np.nan
    found = spikes(height, 1.0, SpikeFilter(far_radius=4.0, min_support=3))
    assert np.array_equal(np.rot90(found), spikes(np.rot90(height).copy(), 1.0, SpikeFilter(far_radius=4.0, min_support=3)))


def test_empty_cells_are_never_spikes_and_alone_a_height_is_one():
    lonely = np.full((9, 9), np.nan, np.float32)
    lonely[4, 4] = 7.0
    found = spikes(lonely, 1.0, SpikeFilter())
    assert found[4, 4] and found.sum() == 1


def test_the_halo_is_the_reach_of_all_rounds():
    assert SpikeFilter(radius=3.5, rounds=2, far_radius=0.0).halo == 8
    assert SpikeFilter(rounds=0, far_radius=9.2).halo == 10


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"far_radius": 0.0, "far_slope": 2.0}, "far_slope has no effect with far_radius: 0"),
        ({"rounds": 0, "sigmas": 2.0, "radius": 5.0}, "radius and sigmas have no effect with rounds: 0"),
    ],
)
def test_settings_of_a_part_that_is_switched_off_are_refused(wrong, sentence):
    with pytest.raises(ValidationError, match=sentence):
        SpikeFilter(**wrong)


def test_a_workflow_with_every_default_filled_in_is_accepted():
    for rules in (SpikeFilter(rounds=0), SpikeFilter(far_radius=0.0)):
        assert SpikeFilter.model_validate(rules.model_dump()) == rules
