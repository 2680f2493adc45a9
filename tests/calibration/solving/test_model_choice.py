"""Which lens model is taken, from the residuals of photographs that took no part, and the doubt that this leaves."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from board_corners import easy_calibration

from orthomill.tasks.adjustment.boards.board_network import PARAMETERS
from orthomill.tasks.calibration.solving.lens_doubt import doubted
from orthomill.tasks.calibration.solving.lens_models import MODELS, WIDE_MODELS, LensModel, in_model
from orthomill.tasks.calibration.solving.model_choice import HeldOut, Judged, as_good, choice
from orthomill.tasks.calibration.solving.solving import solve

NOTHING = np.zeros(17)


def check(rms: float | None, scatter: float = 0.0) -> HeldOut | None:
    """A check of twelve photographs; `scatter` px^2 of theirs, the same in all models but for its sign."""
    if rms is None:
        return None
    by_photo = rms**2 + scatter * np.cos(np.arange(12) * np.pi)
    return HeldOut(rms, rms, NOTHING, NOTHING, by_photo)


def judged(*rms: float | None) -> dict[LensModel, HeldOut | None]:
    # Every model scatters in its own way, so that gains have a scatter.
    scatter = (0.0, 0.004, -0.004, 0.002)
    return {model: check(value, own) for model, value, own in zip(MODELS, rms, scatter, strict=True)}


@pytest.mark.parametrize(
    ("rms", "model"),
    [
        ((0.2, 0.2, 0.2, 0.2), 0),
        ((0.2, 0.1501, 0.21, 0.15), 1),
        ((0.2, 0.152, 0.21, 0.15), 1),
        ((0.2, 0.19, 0.21, 0.15), 3),
        ((0.5, 0.9, 1.2, 1.5), 0),
        ((0.2, None, 0.15, None), 2),
        ((None, None, None, None), 0),
    ],
)
def test_the_simplest_model_is_taken_than_which_none_is_better_beyond_its_scatter(rms, model):
    assert choice(judged(*rms)) == MODELS[model]


def test_one_photograph_decides_nothing():
    plain = check(0.2)
    gain = replace(plain, by_photo=plain.by_photo - 0.03 * (np.arange(12) == 4))
    assert choice({MODELS[0]: plain, MODELS[3]: gain}) == MODELS[0]
    assert choice({MODELS[0]: plain, MODELS[3]: check(0.1)}) == MODELS[3]


def test_sixteen_parameters_for_a_hundredth_are_not_taken():
    wide = WIDE_MODELS[3]
    found = {MODELS[0]: check(0.206, 0.01), wide: check(0.203, -0.01)}
    assert choice(found) == MODELS[0] and as_good(found)[wide] == 0.0


def test_what_other_models_would_have_given_is_in_the_standard_errors():
    _, result = easy_calibration()
    other = replace(result, state=result.state.with_interior(c=float(result.state.interior[0]) + 12.0))
    chosen, wide = LensModel("brown", result.network.free), LensModel("fisheye", ("c", "x0", "y0", "k1"))
    alone = doubted({chosen: Judged(result, check(0.2))}, chosen)
    assert np.array_equal(alone.covariance, result.covariance)
    both = doubted({chosen: Judged(result, check(0.2)), wide: Judged(other, check(0.2))}, chosen)
    assert both.interior_covariance[0, 0] == pytest.approx(result.interior_covariance[0, 0] + 0.5 * 12.0**2)
    worse = doubted({chosen: Judged(result, check(0.2, 0.001)), wide: Judged(other, check(0.5))}, chosen)
    assert np.array_equal(worse.covariance, result.covariance), "a model that does not keep up leaves no doubt"
    assert doubted({chosen: Judged(result, None)}, chosen).sigma0 == result.sigma0


def test_a_model_says_of_a_parameter_as_much_as_it_determines_it():
    """One that knows c three times less well differs by 12 px: a third of that is doubt."""
    _, result = easy_calibration()
    covariance = result.interior_covariance.copy()
    covariance[0, 0] *= 9.0
    state = result.state.with_interior(c=float(result.state.interior[0]) + 12.0)
    loose = SimpleNamespace(state=state, interior_covariance=covariance)
    chosen, wide = LensModel("brown", result.network.free), LensModel("fisheye", ("c", "x0", "y0", "k1"))
    both = doubted({chosen: Judged(result, check(0.2)), wide: Judged(loose, check(0.2))}, chosen)
    assert both.interior_covariance[0, 0] == pytest.approx(result.interior_covariance[0, 0] + 0.5 * 4.0**2)


def test_parameters_that_the_lens_lacks_are_as_uncertain_as_its_rivals_say():
    """Five parameters against eight that held-out photographs cannot tell from them: the true decentring lies within its doubt."""
    target, full = easy_calibration()
    start = in_model(full.state, full.corners, MODELS[0])
    plain = solve(target, (start,), full.corners, MODELS[0].free)
    alike = {MODELS[0]: Judged(plain, check(0.2)), MODELS[3]: Judged(full, check(0.2))}
    sigma = np.sqrt(np.diag(doubted(alike, MODELS[0]).interior_covariance))
    p1, p2 = PARAMETERS.index("p1"), PARAMETERS.index("p2")
    assert sigma[p1] == pytest.approx(np.sqrt(0.5) * abs(full.state.interior[p1]), rel=0.2)
    assert sigma[p2] == pytest.approx(np.sqrt(0.5) * abs(full.state.interior[p2]), rel=0.2)
    unknown = {model: replace(one, check=None) for model, one in alike.items()}
    assert np.sqrt(doubted(unknown, MODELS[0]).interior_covariance[p1, p1]) == pytest.approx(sigma[p1]), "nobody held any out"
    known = {**alike, MODELS[3]: Judged(full, check(0.5))}
    assert not doubted(known, MODELS[0]).interior_covariance[p1].any(), "held-out photographs deny decentring"


def test_what_lenses_are_bounds_the_doubt_of_what_boards_hardly_show():
    """Eight parameters with corners that tell nothing of k3: its doubt is that of any lens, 0.3."""
    _, full = easy_calibration()
    k3, small = PARAMETERS.index("k3"), LensModel("brown", MODELS[1].free)
    covariance = full.interior_covariance.copy()
    covariance[k3], covariance[:, k3] = 0.0, 0.0
    covariance[k3, k3] = 1e4
    loose = full.with_interior_covariance(covariance)
    both = doubted({small: Judged(full, check(0.2)), MODELS[3]: Judged(loose, check(0.2))}, small)
    assert np.sqrt(2.0 * both.interior_covariance[k3, k3]) == pytest.approx(0.3, rel=0.5)


@pytest.mark.parametrize("seed", range(6))
def test_square_pixels_are_told_without_a_standard_error(seed):
    """A model with the affinity beside one without: what rounding leaves of it is no standard error."""
    _, full = easy_calibration()
    other = LensModel("brown", (*full.network.free, "affinity"))
    free = [PARAMETERS.index(name) for name in other.free]
    root = np.random.default_rng(seed).normal(0.0, 1.0, (len(free), len(free))) * 10.0 ** np.linspace(0, -5, len(free))[:, None]
    covariance = np.zeros_like(full.interior_covariance)
    covariance[np.ix_(free, free)] = root @ root.T
    alike = {MODELS[0]: Judged(full, check(0.2)), other: Judged(full.with_interior_covariance(covariance), check(0.2))}
    told = doubted(alike, MODELS[0]).interior_covariance
    assert not told[PARAMETERS.index("affinity")].any() and told[0, 0] > 0.0
