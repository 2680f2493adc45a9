"""The interior orientation in an adjustment: fixed, weighted by its covariance, or free, as the workflow chooses."""

import numpy as np

from orthomill.schemas.camera import INTERIOR, Camera, lens_parameters, padded
from orthomill.tasks.adjustment.model.interior_settings import InteriorChoice
from orthomill.tasks.adjustment.model.network import Interior
from orthomill.tasks.geometry.distortion import LENS_CODES

NOMINAL_SIGMA = {"c": 0.03, "x0": 0.01, "y0": 0.01, "k1": 0.1, "k2": 0.1, "k3": 0.0, "p1": 0.003, "p2": 0.003}
"""Standard errors of a camera that is known from EXIF only: c in units of c, x0 and y0 in units of the width, the others as
numbers. Its k3 is fixed at 0 until the block demands it: with k1 and k2 free and nothing known of any, it would only follow the
noise at the border."""
UNKNOWN_SIGMA = {"k3": 0.3}
"""Standard errors of parameters that are fixed until a block demands them: as large as those of lenses that have been measured."""


GUESSED = 0.2
"""Standard error of a camera constant, in units of it, beyond which nothing gave the value: a tag is good to 5 %"""


def is_guessed(camera: Camera) -> bool:
    """Whether nothing gave the camera constant: no tag told a focal length."""
    return camera.covariance is not None and camera.covariance[0][0] > (GUESSED * camera.c) ** 2


def camera_covariance(camera: Camera) -> np.ndarray:
    """(17, 17) in the order of INTERIOR: that of the camera, the nominal one for a camera from EXIF, else zero (fixed)."""
    if camera.covariance is not None:
        return np.array(padded(camera.covariance))
    # A camera without covariance that is not nominal was given by a person as it is: that is a decision, not an estimate.
    if camera.source != "exif":
        return np.zeros((len(INTERIOR), len(INTERIOR)))
    unit = {"c": camera.c, "x0": float(camera.width), "y0": float(camera.width)}
    return np.diag([(NOMINAL_SIGMA.get(name, 0.0) * unit.get(name, 1.0)) ** 2 for name in INTERIOR])


def interior_prior(cameras: list[Camera], choice: InteriorChoice, fix_nominal: bool = False) -> Interior:
    """Known and unknown interior parameters; `cameras` in the order of the network.

    `fix_nominal`: c, x0 and y0 from EXIF keep their values and are considered parameters. Over flat ground without control they
    cannot be separated from flying height and position of the photographs, and would absorb every small error (a rolling shutter)
    with far too small formal standard errors.
    """
    value = np.array([camera.interior for camera in cameras])
    lens = np.array([LENS_CODES[camera.lens.kind] for camera in cameras])
    free, weight = np.zeros(value.shape, bool), np.zeros((*value.shape, value.shape[1]))
    considered = np.zeros(value.shape, bool)
    named = np.isin(INTERIOR, () if choice.kind == "fixed" else choice.parameters)
    if choice.kind != "weighted":
        # What a lens has no parameter for cannot be estimated: its derivatives are zero.
        own = np.array([np.isin(INTERIOR, lens_parameters(camera.lens.kind)) for camera in cameras])
        return Interior(value, weight, named & own, considered, lens)
    for i, camera in enumerate(cameras):
        covariance = camera_covariance(camera)
        # A zero variance says that the calibration did not estimate the parameter: there is nothing to weight it with.
        free[i] = named & (np.diag(covariance) > 0)
        chosen = np.ix_(free[i], free[i])
        # The covariance of the chosen part, not part of the inverse: parameters that are not chosen are fixed, but their
        # uncertainty stays.
        weight[i][chosen] = _inverse(covariance[chosen])
        considered[i, :3] = free[i, :3] & (fix_nominal and camera.source == "exif")
    return Interior(value, weight, free, considered, lens)


def given_sigmas(interior: Interior, parameters: tuple[int, ...] = (0,)) -> np.ndarray:
    """(C, k) prior standard errors of the interior `parameters` (numbers in INTERIOR); where none is given, the nominal one for the
    camera constant and inf for the others."""
    value = interior.value
    sigma = np.full(value.shape, np.inf)
    sigma[:, 0] = NOMINAL_SIGMA["c"] * value[:, 0]
    for k, own in enumerate(interior.weight):
        known = np.flatnonzero(np.diag(own) > 0)
        # Through the correlation matrix, as in `_inverse`.
        scale = 1.0 / np.sqrt(np.diag(own)[known])
        covariance = np.linalg.pinv(own[np.ix_(known, known)] * scale[:, None] * scale, hermitian=True)
        sigma[k, known] = np.sqrt(np.diag(covariance)) * scale
    return sigma[:, list(parameters)]


def _inverse(covariance: np.ndarray) -> np.ndarray:
    """Inverse by way of the correlation matrix: c in pixels and p1 as a number differ by many powers of ten."""
    scale = 1.0 / np.sqrt(np.diag(covariance))
    return np.linalg.pinv(covariance * scale[:, None] * scale, rcond=1e-12, hermitian=True) * scale[:, None] * scale
