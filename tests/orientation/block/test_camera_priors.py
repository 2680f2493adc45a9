"""Camera constants that an adjustment contradicts, and interior parameters that it does not determine, on a small network."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import INTERIOR_VALUES, more_control, small_network

from orthomill.schemas.camera import Camera
from orthomill.schemas.findings.camera_findings import ConstantContradicted, InteriorFixed, InteriorUndetermined, InteriorUnweighted
from orthomill.tasks.adjustment.bundle import BlunderTest, adjust
from orthomill.tasks.adjustment.model.interior_settings import FixedInterior, WeightedInterior
from orthomill.tasks.adjustment.solve.minimise import NotConverged
from orthomill.tasks.orientation.block import camera_constant
from orthomill.tasks.orientation.block.camera_constant import FARTHEST, adjust_tested, doubtful_constants, with_free_constants
from orthomill.tasks.orientation.block.self_calibration import all_fixed, determinable_without_control, determined, unweighted

TEST = BlunderTest(limit=4.0)
C = INTERIOR_VALUES[0]


def with_given(network, c, sigma):
    """The network with a given camera constant and its standard error."""
    value, weight = network.interior.value.copy(), network.interior.weight.copy()
    value[0, 0], weight[0, 0, 0] = c, 1 / sigma**2
    return replace(network, interior=replace(network.interior, value=value, weight=weight))


def without_prior(network):
    return replace(network, interior=replace(network.interior, weight=np.zeros_like(network.interior.weight)))


def begun(state, c):
    interior = state.interior.copy()
    interior[0, 0] = c
    return replace(state, interior=interior)


def adjusted(given, sigma=0.03 * C, fixed=False, start=None):
    network, state, rays = small_network(3, points=60, noise=1.0, interior_free=(3,) if fixed else (0, 1, 3))
    network = more_control(network, 20)
    return adjust_tested(with_given(network, given, sigma), begun(state, start or given), rays, TEST, ("cam",), fixed)


def test_a_right_constant_is_not_contradicted():
    found = adjusted(C)
    assert found.findings == () and np.isnan(found.restart).all()


def test_a_free_block_that_does_not_converge_is_tried_with_its_interior_orientations_fixed(monkeypatch):
    """One with a datum is not: it may be the datum that keeps it from converging."""

    def never_with_free_cameras(network, state, rays, test):
        if network.interior.free.any():
            raise NotConverged("did not converge")
        return adjust(replace(network, free=False), state, rays, test)

    monkeypatch.setattr(camera_constant, "adjust", never_with_free_cameras)
    network, state, rays = small_network(3, points=60, noise=1.0, interior_free=(0, 1, 3))
    network = more_control(network, 20)
    found = adjust_tested(replace(network, free=True), state, rays, TEST, ("cam",), True)
    assert found.findings[0] == InteriorFixed(cameras=("cam",))
    with pytest.raises(NotConverged):
        adjust_tested(network, state, rays, TEST, ("cam",), True)


@pytest.mark.parametrize("given", [0.8 * C, 1.25 * C])
def test_a_wrong_constant_is_replaced_and_reported(given):
    found = adjusted(given)
    (finding,) = found.findings
    assert isinstance(finding, ConstantContradicted) and not finding.fixed
    assert (finding.camera, finding.given_px) == ("cam", given)
    assert abs(finding.adjusted_px - C) < 4 * finding.sigma_px < 0.02 * C
    assert found.result.state.interior[0, 0] == finding.adjusted_px == found.restart[0]


def test_a_constant_that_the_workflow_fixes_is_only_reported():
    found = adjusted(0.8 * C, fixed=True)
    assert found.findings[0].fixed
    assert found.findings[0].adjusted_px == pytest.approx(C, rel=0.02)
    assert found.result.state.interior[0, 0] == 0.8 * C


def test_a_constant_that_the_start_replaced_is_tested_first():
    found = adjusted(0.8 * C, start=C)
    assert [finding.given_px for finding in found.findings] == [0.8 * C]
    assert found.result.state.interior[0, 0] == pytest.approx(C, rel=0.02)


def test_a_start_that_replaced_a_right_constant_returns_to_it():
    found = adjusted(C, start=1.02 * C)
    assert found.findings == () and found.result.state.interior[0, 0] == pytest.approx(C, rel=0.01)


def test_only_the_constants_of_the_named_cameras_are_freed():
    network, _, _ = small_network(0)
    freed = with_free_constants(network, np.array([True])).interior
    assert freed.weight[0, 0].tolist() == [0] * 8 and freed.weight[0, :, 0].tolist() == [0] * 8
    assert np.array_equal(freed.weight[0, 1:, 1:], network.interior.weight[0, 1:, 1:]) and freed.free[0, 0]
    kept = with_free_constants(network, np.array([False])).interior
    assert np.array_equal(kept.weight, network.interior.weight)
    assert network.interior.weight[0, 0, 0] > 0, "the network that was given is unchanged"


def test_a_fixed_constant_is_doubtful_where_it_would_move_far():
    network, state, rays = small_network(3, points=60, noise=1.0, interior_free=(3,))
    for given, doubt in ((C, False), (0.9 * C, True)):
        one = with_given(network, given, 2.0)
        result = adjust(one, begun(state, given), rays, TEST)
        doubtful, toward = doubtful_constants(result)
        assert doubtful.tolist() == [doubt]
        assert given / FARTHEST <= toward[0] <= given * FARTHEST
        if doubt:
            assert abs(toward[0] - C) < abs(given - C), "one step goes towards the value that fits"


def test_constants_with_strong_control_are_determined():
    network, state, rays = small_network(1, points=60)
    network = without_prior(network)
    found, findings = determined(network, state, rays, ("cam",))
    assert findings == () and found is network


def test_constants_over_flat_ground_without_a_datum_are_not_determined():
    network, state, rays = small_network(1, points=60, free=True, interior_free=(0, 1, 2))
    flat = state.point * [1.0, 1.0, 0.001]
    level = np.tile(np.eye(3), (4, 1, 1))
    state = replace(state, point=flat, rotation=level)
    found, (finding,) = determined(without_prior(network), state, rays, ("cam",))
    assert isinstance(finding, InteriorUndetermined) and finding.camera == "cam"
    assert finding.share is None or finding.share > 0.03
    assert not found.interior.free[0, :3].any()


def test_parameters_with_a_prior_are_never_fixed():
    network, state, rays = small_network(1, free=True, interior_free=(0, 1, 2))
    assert determined(network, state, rays, ("cam",)) == (network, ())


def test_a_camera_that_is_not_nominal_is_left_as_it_is():
    network, state, rays = small_network(1)
    assert determinable_without_control(network, state, rays) is network


@pytest.mark.parametrize(("sigma", "unknown"), [(1000.0, True), (0.001, False)])
def test_a_nominal_constant_becomes_unknown_where_the_block_knows_it_better(sigma, unknown):
    network, state, rays = small_network(1, points=60)
    network = with_given(network, C, sigma)
    considered = np.zeros_like(network.interior.free)
    considered[0, :3] = True
    network = replace(network, interior=replace(network.interior, considered=considered & network.interior.free))
    found = determinable_without_control(network, state, rays).interior
    assert found.considered[0, 0] == (not unknown)
    assert np.array_equal(found.weight, network.interior.weight), "the prior stays, as of any weighted parameter"


def test_with_all_interior_orientations_fixed_nothing_of_them_is_unknown():
    network, _, _ = small_network(0)
    fixed, finding = all_fixed(network, ("one", "two"))
    assert finding == InteriorFixed(cameras=("one", "two"))
    assert not fixed.interior.free.any() and not fixed.interior.weight.any() and (fixed.interior_columns < 0).all()


@pytest.mark.parametrize(("kind", "sigma", "told"), [("weighted", None, True), ("weighted", 0.5, False), ("fixed", None, False)])
def test_weights_that_nobody_gave_are_told(kind, sigma, told):
    covariance = None if sigma is None else tuple(map(tuple, np.diag([sigma**2] + [0.0] * 7)))
    given = Camera(name="given", width=4000, height=3000, c=3500.0, source="given", covariance=covariance)
    nominal = given.model_copy(update={"name": "exif", "source": "exif", "covariance": None})
    choice = FixedInterior(kind="fixed") if kind == "fixed" else WeightedInterior(kind="weighted")
    assert unweighted([given, nominal], choice) == ((InteriorUnweighted(cameras=("given",)),) if told else ())
