"""Lenses that no polynomial follows: models that do are found, start from each other, and are judged by all corners."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from board_corners import easy_calibration

from orthomill.schemas.camera import LENSES, Camera, FisheyeLens
from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.calibration.diagnosis.advice import Advice, Weakness
from orthomill.tasks.calibration.diagnosis.model_failure import failure_advice, failures
from orthomill.tasks.calibration.solving.arranging import arrangement_of
from orthomill.tasks.calibration.solving.lens_models import MODELS, WIDE_MODELS, LensModel, in_model, model_of, with_affinity
from orthomill.tasks.calibration.solving.model_choice import HeldOut, Judged, choice, compare
from orthomill.tasks.calibration.solving.solving import CalibrationTarget
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View

WIDE = Camera(name="wide", width=1200, height=1200, c=400.0, x0=3.0, y0=-4.0, lens=FisheyeLens(k1=0.02, k2=-0.005))
TARGET = CalibrationTarget((1200, 1200), (8, 6), 0.05, 1)
FISHEYE = WIDE_MODELS[1]


@lru_cache(maxsize=1)
def wide_corners() -> tuple[np.ndarray, ...]:
    """Per photo the corners of one board, near, at all places of the frame, by a fisheye of 400 px, with 0.1 px of noise."""
    generator = np.random.default_rng(4)
    flat = np.column_stack([TARGET.local - TARGET.local.mean(axis=0), np.zeros(48)])
    found = []
    for photo in range(16):
        side, off = 2.4 * photo, 0.35 * (photo % 4)
        R = rotation_matrix(0.5 * np.sin(side), 0.5 * np.cos(side), 0.8 * photo)
        view = View("v", WIDE, R, 0.24 * R[2] + off * (np.cos(side) * R[0] + np.sin(side) * R[1]) * 0.5)
        xy = view.project(flat)
        if view.contains(xy, 5.0).all():
            found.append(TARGET.centred(xy + generator.normal(0, 0.1, xy.shape))[None])
    return tuple(found)


@lru_cache(maxsize=1)
def judged() -> dict[LensModel, Judged]:
    known = arrangement_of(list(wide_corners()), TARGET)
    return compare(known.result, known.start.corners, TARGET, (MODELS[0], *WIDE_MODELS[:3]))


def test_the_lens_that_took_the_photographs_is_chosen_and_estimated():
    found = judged()
    chosen = choice({model: one.check for model, one in found.items()})
    result = found[chosen].result
    assert chosen.lens in ("fisheye", "rational")
    assert found[FISHEYE].check.rms_all == pytest.approx(0.1 * np.sqrt(2), rel=0.1)
    assert found[FISHEYE].check.rms_all < 0.5 * found[MODELS[0]].check.rms_all
    sigma = np.sqrt(np.diag(found[FISHEYE].result.interior_covariance))
    assert (np.abs(found[FISHEYE].result.state.interior - WIDE.interior)[:3] < 4.0 * sigma[:3]).all()
    assert result.used.mean() > 0.99


@pytest.mark.parametrize("model", WIDE_MODELS[:3], ids=lambda model: model.lens)
def test_another_model_starts_with_nearly_the_same_curve(model):
    _, result = easy_calibration()
    start = in_model(result.state, result.corners, model)
    assert start.lens == model.lens and start.interior[1:3] == pytest.approx(result.state.interior[1:3])
    again = in_model(start, result.corners, MODELS[0])
    assert again.interior[0] == pytest.approx(result.state.interior[0], rel=5e-3)


def test_a_stated_lens_or_stated_parameters_limit_the_choice():
    assert model_of(None, ()) == (*MODELS, *WIDE_MODELS) and {model.lens for model in WIDE_MODELS} == set(LENSES) - {"brown"}
    assert model_of("fisheye", ()) == (FISHEYE,) and model_of(None, ("c", "k1")) == (LensModel("brown", ("c", "k1")),)
    assert with_affinity(MODELS[0]).free == (*MODELS[0].free, "affinity")


def with_checks(*figures: float) -> dict[LensModel, HeldOut | None]:
    none, models = np.zeros(17), (MODELS[0], MODELS[3], *WIDE_MODELS[:3])
    # Photographs differ from model to model by 2 % of a hundredth px^2.
    noise = 1e-4 * np.random.default_rng(2).standard_normal((5, 16))
    return {model: HeldOut(0.1, v, none, none, v**2 + own) for model, v, own in zip(models, figures, noise, strict=True)}


@pytest.mark.parametrize(
    ("figures", "lens", "free"),
    [
        ((1.0, 1.00001, 1.0, 1.0, 1.0), "brown", 5),
        ((5.0, 4.0, 0.3, 0.3, 0.3), "division", 4),
        ((5.0, 4.0, 0.4, 0.3, 0.29), "rational", 11),
    ],
)
def test_a_model_for_wide_lenses_is_taken_only_where_no_polynomial_fits_and_then_the_smallest(figures, lens, free):
    chosen = choice(with_checks(*figures))
    assert chosen.lens == lens and len(chosen.free) == free


def rejecting(result: BoardAdjustment, wrong: np.ndarray) -> BoardAdjustment:
    return replace(result, used=~wrong)


def test_rejected_corners_that_lie_together_are_a_failure_of_the_model_and_scattered_ones_are_not():
    _, result = easy_calibration()
    photos = [f"p{photo}" for photo in range(8)]
    radius = np.linalg.norm(result.corners.xy, axis=1)
    outer = radius > np.quantile(radius, 0.9)
    found = failure_advice(rejecting(result, outer), None, photos)
    assert Weakness.REJECTED_OUTSIDE in [one.code for one in found] and failures(found)
    assert found[0].value == pytest.approx(0.5, abs=0.02)
    scattered = np.zeros(len(radius), bool)
    scattered[np.random.default_rng(0).choice(len(radius), 30, replace=False)] = True
    assert failure_advice(rejecting(result, scattered), None, photos) == []
    image = (result.corners.photo == 2) & (result.corners.board == 1)
    (one,) = [one for one in failure_advice(rejecting(result, image), None, photos) if one.code is Weakness.REJECTED_TOGETHER]
    assert one.names == ("p2 (board 2)",) and not failures([one])
    worse = Advice(Weakness.ALL_WORSE, 2.4, values=(1.2,))
    assert not failures([worse]) and failures([one, worse]) == {Weakness.REJECTED_TOGETHER, Weakness.ALL_WORSE}


def test_corners_that_were_rejected_count_in_the_judgement():
    _, result = easy_calibration()
    none = np.zeros(17)
    (worse,) = failure_advice(result, HeldOut(0.42, 5.35, none, none), [])
    assert worse.code is Weakness.ALL_WORSE and (worse.value, worse.values) == (5.35, (0.42,))
    assert failure_advice(result, HeldOut(0.42, 0.45, none, none), []) == []
