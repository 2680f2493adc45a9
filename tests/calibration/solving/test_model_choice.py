"""Which distortion model is taken, from the residuals of photographs that took no part."""

import numpy as np
import pytest

from orthomill.tasks.calibration.solving.lens_models import MODELS
from orthomill.tasks.calibration.solving.model_choice import HeldOut, choice


def judged(*rms: float | None):
    none = np.zeros(10)
    return {model: None if value is None else HeldOut(value, value, none, none) for model, value in zip(MODELS, rms, strict=True)}


@pytest.mark.parametrize(
    ("rms", "model"),
    [
        ((0.2, 0.2, 0.2, 0.2), 3),
        ((0.2, 0.1501, 0.21, 0.15), 3),
        ((0.2, 0.15, 0.21, 0.152), 1),
        ((0.5, 0.9, 1.2, 1.5), 0),
        ((0.2, None, 0.15, None), 2),
        ((None, None, None, None), 0),
    ],
)
def test_the_largest_of_equally_good_models_is_taken(rms, model):
    assert choice(judged(*rms)) == MODELS[model]
