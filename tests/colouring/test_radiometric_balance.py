"""The radiometric balance against a dense least-squares solution, its datum, and what cannot be determined."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

from orthomill.tasks.colouring.balance import radiometric_balance
from orthomill.tasks.colouring.balance.balancing import balanced_block
from orthomill.tasks.colouring.balance.photo_radiometry import PhotoRadiometry, Radiometry, corrected
from orthomill.tasks.colouring.balance.radiometric_balance import balance_block
from orthomill.tasks.colouring.balance.shared_ground import Samples, pair_differences

NAMES = ("a", "b", "c")
GAIN, OFFSET = np.array([1.06, 1.0, 0.94]), np.array([4.0, 0.0, -4.0])


def samples(points: int = 400, noise: float = 0.0, falloff: float = 0.0, seed: int = 1, scale: float = 1.0) -> Samples:
    """Every point in all three photos, equal in the three channels."""
    rng = np.random.default_rng(seed)
    ground, r2 = rng.uniform(50, 190, points), rng.uniform(0, 1, 3 * points)
    point, photo = np.repeat(np.arange(points), 3), np.tile(np.arange(3), points).astype(np.int32)
    grey = GAIN[photo] * (1 + falloff * r2) * ground[point] + OFFSET[photo] + noise * rng.normal(size=3 * points)
    columns = [(scale * grey).astype(np.float32)] * 3
    return Samples(point, photo, r2.astype(np.float32), *columns)


def test_exact_samples_are_brought_to_one_brightness():
    found = balance_block(NAMES, samples(), 255.0, False)
    assert found.difference_before > 5.0 and found.difference_after < 0.02
    assert (found.points, found.samples) == (400, 1200) and [photo.samples for photo in found.photos] == [400] * 3
    assert np.allclose([photo.gain for photo in found.photos], GAIN[:, None], atol=2e-3)
    assert np.allclose([photo.offset for photo in found.photos], OFFSET[:, None], atol=0.2)


@pytest.mark.parametrize("falloff", [-0.2, -0.05])
def test_vignetting_is_found_when_it_is_asked_for(falloff):
    made = samples(falloff=falloff, points=800)
    with_it, without = (balance_block(NAMES, made, 255.0, vignetting) for vignetting in (True, False))
    corner = [np.mean(photo.v1) + np.mean(photo.v2) for photo in with_it.photos]
    assert np.allclose(corner, falloff, atol=0.02)
    assert all(abs(value) < 1e-3 for photo in without.photos for value in (*photo.v1, *photo.v2))
    assert with_it.difference_after < 0.3 * without.difference_after


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 1000), noise=st.floats(0.0, 3.0))
def test_gains_have_the_mean_one_and_offsets_the_mean_zero(seed, noise):
    found = balance_block(NAMES, samples(120, noise, seed=seed), 255.0, False)
    assert np.mean([photo.gain for photo in found.photos]) == pytest.approx(1.0, abs=1e-3)
    assert np.mean([photo.offset for photo in found.photos]) == pytest.approx(0.0, abs=1e-2)


def test_noise_does_not_bias_the_gains():
    """A regression of one photo on another would lose a per cent of gain to 8 grey levels of noise."""
    gains = [
        [photo.gain[0] for photo in balance_block(NAMES, samples(600, 8.0, seed=seed), 255.0, False).photos] for seed in range(6)
    ]
    assert np.allclose(np.mean(gains, axis=0), GAIN, atol=0.008)


def test_a_photo_without_overlap_keeps_its_grey_values():
    made = samples()
    alone = balance_block((*NAMES, "d"), made, 255.0, True).photos[3]
    assert np.allclose(alone.gain, 1.0, atol=0.02) and np.allclose(alone.offset, 0.0, atol=0.5) and alone.samples == 0


def test_saturated_samples_are_not_used():
    made = samples(200)
    white = np.where(np.arange(len(made)) % 6 == 0, 255.0, made.first).astype(np.float32)
    clipped = Samples(made.point, made.photo, made.r2, white, white, white)
    found = balance_block(NAMES, clipped, 255.0, False)
    assert found.samples == (white < 255.0 * (1 - 0.012)).sum()
    assert np.allclose([photo.gain[0] for photo in found.photos], GAIN, atol=5e-3)


def test_points_that_one_photo_alone_still_sees_are_dropped():
    point, photo = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1], np.int32)
    grey = np.array([100.0, 110.0, 100.0, 254.0], np.float32)
    found = balance_block(("a", "b"), Samples(point, photo, np.zeros(4, np.float32), grey, grey, grey), 255.0, False)
    assert (found.points, found.samples) == (1, 2)


def test_sixteen_bits_give_the_result_of_eight_scaled():
    eight = balance_block(NAMES, samples(300, 1.0), 255.0, True)
    sixteen = balance_block(NAMES, samples(300, 1.0, scale=100.0), 25500.0, True)
    for small, large in zip(eight.photos, sixteen.photos, strict=True):
        assert np.allclose(small.gain, large.gain, atol=1e-4) and np.allclose(100 * np.array(small.offset), large.offset, atol=1.0)
    assert sixteen.difference_after == pytest.approx(eight.difference_after, rel=1e-3), "stated in grey levels of 8 bits"


@settings(max_examples=40, deadline=None)
@given(
    gain=st.floats(0.7, 1.4), offset=st.floats(-20, 20), v1=st.floats(-0.3, 0.0), v2=st.floats(-0.1, 0.1), r2=st.floats(0.0, 1.0)
)
def test_correction_inverts_the_model(gain, offset, v1, v2, r2):
    photo = PhotoRadiometry(photo="a", gain=(gain,) * 3, offset=(offset,) * 3, v1=(v1,) * 3, v2=(v2,) * 3)
    ground = np.array([[20.0, 120.0, 200.0]])
    recorded = gain * (1 + v1 * r2 + v2 * r2**2) * ground + offset
    assert np.allclose(corrected(recorded.astype(np.float32), np.array([r2]), photo), ground, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("bands", [1, 3])
def test_grey_and_colour_photographs_are_corrected_alike(bands):
    photo = PhotoRadiometry(photo="a", gain=(2.0, 4.0, 8.0), offset=(10.0, 20.0, 40.0))
    grey = np.full((2, 3, bands), 90.0, np.float32)
    found = corrected(grey, np.zeros((2, 3)), photo)
    assert found.dtype == np.float32 and found[0, 0].tolist() == [40.0, 17.5, 6.25][:bands]


def test_differences_are_between_rows_of_one_point():
    point = np.array([3, 1, 3, 1, 2])
    grey = np.array([[10.0, 10.0], [50.0, 60.0], [14.0, 12.0], [50.0, 50.0], [99.0, 99.0]])
    assert sorted(pair_differences(point, grey)) == [3.0, 5.0]


class _Block:
    names = NAMES


def test_the_method_none_keeps_grey_values_but_not_the_range_of_sixteen_bits():
    made = samples(200, scale=60.0)
    found = balanced_block((made,), _Block, True, "none", True)
    assert found.photos == tuple(PhotoRadiometry(photo=name) for name in NAMES) and found.points == 0
    assert found.white == pytest.approx(1.05 * np.quantile(made.grey, 0.999), rel=1e-6)
    assert balanced_block((made,), _Block, False, "none", True).white == 255.0


def test_the_stretch_of_sixteen_bits_ends_at_their_range():
    assert balanced_block((samples(200, scale=320.0),), _Block, True, "none", True).white == 65535.0
    empty = samples(1).take(np.zeros(0, int))
    assert balanced_block((empty,), _Block, True, "block", True).white == 65535.0


def test_samples_of_all_tiles_are_adjusted_together():
    made = samples(300)
    parts = tuple(made.take(np.flatnonzero(made.point % 3 == part)) for part in range(3))
    one, many = (balanced_block(tables, _Block, False, "block", False) for tables in ((made,), parts))
    assert isinstance(one, Radiometry) and one.points == many.points == 300
    assert np.allclose([p.gain for p in one.photos], [p.gain for p in many.photos], atol=1e-6)
    assert one.of("b").photo == "b"


def test_reduced_equations_are_the_schur_complement_of_the_whole_ones():
    """One iteration against dense normal equations of all parameters and all brightnesses; no photo sees all points."""
    rng = np.random.default_rng(5)
    point, photo = np.repeat(np.arange(9), 2), np.array([0, 1, 1, 2, 2, 3] * 3)
    channel = radiometric_balance._Channel(photo, point, rng.uniform(0, 1, 18), rng.uniform(20, 200, 18), 4, 9)
    ground, x = rng.uniform(20, 200, 9), np.tile([1.0, 0.02, -0.01, 3.0], 4) + rng.normal(0, 0.01, 16)
    found = radiometric_balance._reduced(channel, ground, x)
    a = x.reshape(4, 4)[photo]
    slope = a[:, 0] + channel.r2 * (a[:, 1] + channel.r2 * a[:, 2])
    residual = channel.g - slope * ground[point] - a[:, 3]
    sigma = max(1.4826 * np.median(np.abs(residual)), 0.1)
    W = np.diag(np.minimum(1.0, radiometric_balance.HUBER * sigma / np.abs(residual)))
    J, B = np.zeros((18, 16)), np.zeros((18, 9))
    for k in range(18):
        G = ground[point[k]]
        J[k, 4 * photo[k] : 4 * photo[k] + 4] = G, channel.r2[k] * G, channel.r2[k] ** 2 * G, 1.0
        B[k, point[k]] = slope[k]
    eliminated = B @ np.linalg.inv(B.T @ W @ B) @ B.T @ W
    np.testing.assert_allclose(found.normal.toarray(), J.T @ W @ (J - eliminated @ J), rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(found.right, J.T @ W @ (residual - eliminated @ residual), rtol=1e-9, atol=1e-6)


def test_a_photograph_beside_its_place_does_not_lose_its_contrast():
    """What it shows at the points of others is other ground of the kind; by the number of its samples its gain would be 0.02."""
    made, rng = samples(800, 2.0), np.random.default_rng(9)
    torn = np.where(np.asarray(made.photo) == 2, rng.normal(90.0, 30.0, len(made)), made.first).astype(np.float32)
    found = balance_block(NAMES, Samples(made.point, made.photo, made.r2, torn, torn, torn), 255.0, False)
    assert all(0.4 < photo.gain[0] < 1.5 for photo in found.photos)


def test_the_datum_is_no_part_of_the_matrix_that_is_factorised_and_the_solution_is_the_same():
    """Its rows touch every photograph: with them the equations of a long strip would be full."""
    rng, photos, hard = np.random.default_rng(3), 60, 1e7
    strip = sparse.diags_array(
        [np.full(4 * photos - 4, -40.0), np.full(4 * photos, 100.0), np.full(4 * photos - 4, -40.0)], offsets=[-4, 0, 4]
    )
    right, datum = rng.normal(size=4 * photos), radiometric_balance._datum(photos)
    found = radiometric_balance._solved(sparse.csc_matrix(strip), right, datum, hard)
    np.testing.assert_allclose(found, np.linalg.solve(strip.toarray() + hard * datum.T @ datum, right), rtol=1e-7, atol=1e-9)
    assert np.abs(datum @ found).max() < 1e-6, "the sums of the gains and of the offsets stay"
