"""Interior orientations as unknowns: which parameters are free, with which weight, and which are considered."""

import numpy as np
import pytest
from pydantic import ValidationError

from orthomill.schemas.camera import INTERIOR, Camera
from orthomill.tasks.adjustment.model.interior import NOMINAL_SIGMA, camera_covariance, given_sigmas, interior_prior
from orthomill.tasks.adjustment.model.interior_settings import FixedInterior, FreeInterior, WeightedInterior

EXIF = Camera(name="exif", width=2000, height=1000, c=1500.0, source="exif")
FIXED, WEIGHTED, FREE = FixedInterior(kind="fixed"), WeightedInterior(kind="weighted"), FreeInterior(kind="free")


def calibrated(known=("c", "x0", "y0", "k1")):
    """A calibrated camera whose `known` parameters are correlated."""
    rng = np.random.default_rng(4)
    half = rng.standard_normal((17, 17))
    chosen = np.isin(INTERIOR, known)
    sigma = np.where(chosen, [0.5, 0.3, 0.3, 1e-4, 1e-4, 1e-4, 1e-6, 1e-6, *[1e-4] * 9], 0.0)
    correlation = half @ half.T + 4 * np.eye(17)
    scale = sigma / np.sqrt(np.diag(correlation))
    covariance = correlation * scale[:, None] * scale
    rows = tuple(tuple(float(v) for v in row) for row in covariance)
    return EXIF.model_copy(update={"name": "calibrated", "covariance": rows, "source": "chessboards"}).changed(k1=-0.05)


def test_fixed_cameras_have_no_unknowns():
    prior = interior_prior([EXIF, calibrated()], FIXED)
    assert not prior.free.any() and not prior.weight.any() and not prior.considered.any()
    assert prior.value[0] == pytest.approx(EXIF.interior)


def test_free_cameras_have_the_named_unknowns_without_weight():
    prior = interior_prior([EXIF, calibrated()], FreeInterior(kind="free", parameters=("c", "k2")))
    assert [INTERIOR[i] for i in np.flatnonzero(prior.free[0])] == ["c", "k2"]
    assert (prior.free[0] == prior.free[1]).all() and not prior.weight.any()


def test_the_default_of_free_cameras_leaves_out_what_a_block_cannot_separate():
    free = interior_prior([EXIF], FREE).free[0]
    assert dict(zip(INTERIOR, free, strict=True)) == {name: name in ("c", "x0", "y0", "k1", "k2") for name in INTERIOR}


def test_weighted_cameras_have_the_inverse_covariance_of_what_is_known():
    camera = calibrated()
    prior = interior_prior([camera], WEIGHTED)
    known = np.flatnonzero(prior.free[0])
    assert [INTERIOR[i] for i in known] == ["c", "x0", "y0", "k1"]
    product = prior.weight[0] @ np.array(camera.covariance)
    assert np.allclose(product[np.ix_(known, known)], np.eye(4), atol=1e-8)


def test_named_parameters_of_weighted_cameras_use_their_own_part_of_the_covariance():
    camera = calibrated()
    chosen = WeightedInterior(kind="weighted", parameters=("c", "k1"))
    prior = interior_prior([camera], chosen)
    part = np.array(camera.covariance)[np.ix_([0, 3], [0, 3])]
    assert list(np.flatnonzero(prior.free[0])) == [0, 3]
    assert np.allclose(prior.weight[0][np.ix_([0, 3], [0, 3])] @ part, np.eye(2), atol=1e-8)


def test_a_camera_from_exif_is_weighted_by_nominal_standard_errors_and_keeps_k3():
    prior = interior_prior([EXIF], WEIGHTED)
    assert not prior.free[0][INTERIOR.index("k3")]
    sigma = 1 / np.sqrt(np.diag(prior.weight[0])[:3])
    assert sigma == pytest.approx([0.03 * 1500, 0.01 * 2000, 0.01 * 2000])


@pytest.mark.parametrize(("fix", "source", "considered"), [(True, "exif", 3), (False, "exif", 0), (True, "chessboards", 0)])
def test_only_nominal_constants_and_principal_points_are_considered(fix, source, considered):
    camera = EXIF if source == "exif" else calibrated()
    prior = interior_prior([camera], WEIGHTED, fix)
    assert prior.considered.sum() == considered
    assert not (prior.considered & ~prior.free).any()


def test_a_camera_of_unknown_precision_is_fixed_when_weighted():
    camera = EXIF.model_copy(update={"source": "given"})
    assert not camera_covariance(camera).any()
    assert not interior_prior([camera], WEIGHTED).free.any()


def test_given_standard_errors_come_back_from_the_weights():
    camera = calibrated()
    prior = interior_prior([camera, EXIF], WEIGHTED)
    sigma = given_sigmas(prior, (0, 1, 3))
    assert sigma[0] == pytest.approx(np.sqrt(np.diag(np.array(camera.covariance)))[[0, 1, 3]], rel=1e-6)
    assert sigma[1] == pytest.approx([45.0, 20.0, NOMINAL_SIGMA["k1"]])


def test_without_weights_the_constant_is_nominal_and_the_rest_unknown():
    sigma = given_sigmas(interior_prior([EXIF], FREE), (0, 1))
    assert sigma[0, 0] == pytest.approx(45.0) and np.isinf(sigma[0, 1])


@pytest.mark.parametrize("choice", [WeightedInterior, FreeInterior])
def test_no_parameter_at_all_is_refused(choice):
    with pytest.raises(ValidationError, match="at least 1"):
        choice(kind="free" if choice is FreeInterior else "weighted", parameters=())
