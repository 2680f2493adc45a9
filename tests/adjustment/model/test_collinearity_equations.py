"""The collinearity equations: analytic projections, a plain NumPy twin, and the invariances that the datum defect rests on."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_network import moved, small_network

from orthomill.tasks.adjustment.model.collinearity import BEHIND, derivatives, residual_lengths, residuals
from orthomill.tasks.adjustment.model.network import Rays, State
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector, skew

ONE_CAMERA = np.zeros(1, np.int64)


def one_ray(point, interior, rotation=None, xy=(0.0, 0.0), sigma=1.0):
    """A photograph at (0, 0, 100), looking down unless a rotation says otherwise, and one point."""
    rotation = np.eye(3) if rotation is None else rotation
    state = State(rotation[None], np.array([[0.0, 0.0, 100.0]]), np.array([point], float), np.array([interior]), np.zeros(3))
    index = np.zeros(1, np.int32)
    return state, Rays(index, index, np.array([xy], float), np.array([sigma]))


def projected(point, interior, rotation=None):
    return -residuals(*one_ray(point, interior, rotation), ONE_CAMERA)[0]


def twin(state, rays, camera_of):
    """Observed minus computed coordinates, written with whole arrays."""
    u = np.einsum("mij,mj->mi", state.rotation[rays.photo], state.point[rays.point] - state.centre[rays.photo])
    a, b = -u[:, 0] / u[:, 2], -u[:, 1] / u[:, 2]
    c, x0, y0, k1, k2, k3, p1, p2 = state.interior[camera_of[rays.photo]].T
    r2 = a**2 + b**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    x = a * radial - 2 * p1 * a * b + p2 * (r2 + 2 * a**2)
    y = b * radial - p1 * (r2 + 2 * b**2) + 2 * p2 * a * b
    return rays.xy - np.column_stack([x0 + c * x, y0 + c * y])


def test_the_principal_ray_hits_the_principal_point():
    assert projected([0, 0, 40], [1000.0, 3.0, -2.0, 0.1, 0.1, 0.1, 0.01, 0.02]) == pytest.approx([3.0, -2.0], abs=1e-12)


def test_vertical_photographs_have_the_scale_c_over_flying_height():
    assert projected([10, -20, 0], [1500.0, 0, 0, 0, 0, 0, 0, 0]) == pytest.approx([150.0, -300.0])


def test_radial_distortion_is_k1_times_the_cube_of_the_radius():
    plain, bent = (projected([30, 40, 0], [1000.0, 0, 0, k1, 0, 0, 0, 0]) for k1 in (0.0, -0.2))
    assert np.linalg.norm(plain) == pytest.approx(500.0)
    assert np.linalg.norm(bent) == pytest.approx(1000.0 * (0.5 - 0.2 * 0.5**3))
    assert plain[0] * bent[1] == pytest.approx(plain[1] * bent[0]), "radial distortion leaves the direction"


def test_a_rotation_about_the_viewing_axis_rotates_the_image():
    kappa = 0.3
    R = np.array([[np.cos(kappa), np.sin(kappa), 0], [-np.sin(kappa), np.cos(kappa), 0], [0, 0, 1]])
    plain, turned = projected([10, 5, 0], [1000.0, 0, 0, 0, 0, 0, 0, 0]), projected([10, 5, 0], [1000.0, 0, 0, 0, 0, 0, 0, 0], R)
    assert turned == pytest.approx(R[:2, :2] @ plain)


@pytest.mark.parametrize("height", [100.0, 150.0])
def test_points_beside_or_behind_the_camera_have_the_residual_behind(height):
    state, rays = one_ray([1.0, 2.0, height], [1000.0, 0, 0, 0, 0, 0, 0, 0])
    assert (residuals(state, rays, ONE_CAMERA) == BEHIND).all()
    jg, jp = derivatives(state, rays, ONE_CAMERA)
    assert not jg.any() and not jp.any()


def test_residual_lengths_are_in_stated_standard_errors():
    network, _, _ = small_network(photos=4)
    state, rays = one_ray([0, 0, 0], [1000.0, 0, 0, 0, 0, 0, 0, 0], xy=(3.0, 4.0), sigma=0.5)
    assert residual_lengths(replace(network, camera_of=ONE_CAMERA), state, rays) == pytest.approx([10.0])


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_the_kernel_equals_its_numpy_twin(seed):
    network, state, rays = small_network(seed=seed % 50, noise=1.0)
    rng = np.random.default_rng(seed)
    interior = state.interior + rng.normal(0, 1, state.interior.shape) * [50, 5, 5, 0.05, 0.05, 0.05, 0.002, 0.002]
    state = replace(moved(state, rng, 2.0), interior=interior)
    assert np.allclose(residuals(state, rays, network.camera_of), twin(state, rays, network.camera_of), rtol=1e-12, atol=1e-9)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6), scale=st.floats(0.1, 10.0))
def test_residuals_are_invariant_to_similarity_transformations(seed, scale):
    network, state, rays = small_network(seed=1, noise=1.0)
    rng = np.random.default_rng(seed)
    turn, shift = rotation_of_vector(rng.normal(0, 2, 3)), rng.normal(0, 1000, 3)
    other = replace(
        state,
        rotation=state.rotation @ turn.T,
        centre=scale * state.centre @ turn.T + shift,
        point=scale * state.point @ turn.T + shift,
    )
    assert np.allclose(residuals(other, rays, network.camera_of), residuals(state, rays, network.camera_of), atol=1e-7)


def test_derivatives_vanish_along_shift_rotation_and_scale_of_the_block():
    network, state, rays = small_network(noise=1.0)
    jg, jp = derivatives(state, rays, network.camera_of)
    assert np.allclose(jg[:, :, :3], -jp, atol=1e-12), "a shift of both ends"
    away = state.point[rays.point] - state.centre[rays.photo]
    assert np.abs(np.einsum("mki,mi->mk", jp, away)).max() < 1e-9, "a step along the ray"
    for axis in np.eye(3):
        arms = skew(axis) @ away[:, :, None]
        turned = np.einsum("mki,mi->mk", jp, arms[:, :, 0]) - np.einsum(
            "mki,mi->mk", jg[:, :, 3:6], state.rotation[rays.photo] @ axis
        )
        assert np.abs(turned).max() < 1e-9 * np.abs(jg).max()


def test_derivatives_by_the_interior_orientation_are_exact_where_it_is_linear():
    network, state, rays = small_network()
    jg, _ = derivatives(state, rays, network.camera_of)
    computed = rays.xy - residuals(state, rays, network.camera_of)
    for column, step in enumerate([7.0, 5.0, -4.0, 0.3, -0.2, 0.1, 0.02, 0.03]):
        interior = state.interior.copy()
        interior[:, column] += step
        after = rays.xy - residuals(replace(state, interior=interior), rays, network.camera_of)
        assert np.allclose(after - computed, step * jg[:, :, 6 + column], atol=1e-9), column
