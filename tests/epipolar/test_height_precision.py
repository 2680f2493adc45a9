"""The standard errors of heights by the orientation, against many perturbed orientations and closed forms."""

import numpy as np
import pytest
from tiny_block import FLYING, block

from orthomill.schemas.orientation import Block, JointCovariance
from orthomill.tasks.epipolar.height_precision import height_sigmas
from orthomill.tasks.epipolar.pair_choice import PairChoice
from orthomill.tasks.epipolar.row_precision import border_points, joint_covariance
from orthomill.tasks.epipolar.selection import choose_pairs
from orthomill.tasks.geometry.intersection import intersect_rays
from orthomill.tasks.geometry.normal_case import intersect_pair
from orthomill.tasks.geometry.view import block_view


def covariance(*variances: float) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, np.diag(variances).tolist()))


def with_covariances(diagonal: tuple[float, ...], joint: float = 0.0) -> Block:
    """The tiny block with one covariance for all photographs, correlated by `joint` between any two of them."""
    one = block()
    photos = tuple(photo.model_copy(update={"covariance": covariance(*diagonal)}) for photo in one.photos)
    shared = covariance(*(joint * v for v in diagonal))
    pairs = tuple(
        JointCovariance(first=a.photo, second=b.photo, covariance=shared) for i, a in enumerate(photos) for b in photos[i + 1 :]
    )
    return one.model_copy(update={"photos": photos, "joint": pairs if joint else ()})


def pair_of(known: Block):
    return next(p for p in choose_pairs(known, PairChoice(), 0.08).pairs if p.name == "a1-a2")


def test_without_a_covariance_nothing_is_said():
    bare = block().model_copy(update={"photos": tuple(p.model_copy(update={"covariance": None}) for p in block().photos)})
    assert height_sigmas(pair_of(block()), bare) == ()


def test_a_common_error_of_the_datum_is_the_error_of_the_heights():
    """Both photographs move together by 0.3 m in height: so do all points."""
    known = with_covariances((0.0, 0.0, 0.09, 0.0, 0.0, 0.0), joint=1.0)
    assert height_sigmas(pair_of(known), known) == pytest.approx((0.3,) * 9, rel=1e-4)


def test_corners_behind_a_photograph_take_the_largest_of_what_is_shown():
    """Epipolar images are wider than their photographs: where these are turned far, a corner lies behind one of them."""
    known = with_covariances((0.1,) * 3 + (1e-4,) * 3)
    pair = pair_of(known)
    middle = np.array(height_sigmas(pair, known))[4]
    beyond = 50 * pair.left_cols
    wide = {"rows": pair.rows + 2 * beyond, "left_cols": pair.left_cols + 2 * beyond}
    wide |= {"row0": pair.row0 + beyond, "left_col0": pair.left_col0 + beyond}
    sigma = np.array(height_sigmas(pair.model_copy(update=wide), known))
    assert sigma.shape == (9,) and np.isfinite(sigma).all() and sigma[4] == pytest.approx(middle, rel=0.1)
    assert np.count_nonzero(sigma == sigma.max()) > 1, "places that no photograph shows"


def test_a_common_shift_in_plan_changes_no_height():
    known = with_covariances((0.09, 0.09, 0.0, 0.0, 0.0, 0.0), joint=1.0)
    assert max(height_sigmas(pair_of(known), known)) < 1e-3


def test_errors_of_the_base_scale_with_height_over_base():
    """Independent errors of 0.1 m of both centres along the base change the depth by H / B times their difference."""
    known = with_covariances((0.01, 0.0, 0.0, 0.0, 0.0, 0.0))
    pair = pair_of(known)
    middle = height_sigmas(pair, known)[4]
    assert middle == pytest.approx(FLYING / pair.base * 0.1 * np.sqrt(2), rel=0.08)


def test_the_prediction_is_the_spread_of_perturbed_orientations():
    """Orientations drawn from the covariance, the same pixels intersected again: their heights scatter as predicted."""
    known = block()
    pair, rng = pair_of(known), np.random.default_rng(8)
    xy = border_points(pair)
    pixels = np.column_stack([xy[:, 0] + pair.left_col0, pair.row0 - xy[:, 1]])
    ground = intersect_pair(pair, pixels, np.full(9, (pair.parallax_low + pair.parallax_high) / 2))
    views = [block_view(known, name) for name in (pair.left, pair.right)]
    observed = [view.project(ground) for view in views]
    heights = []
    for _ in range(300):
        drawn = _perturbed(known, rng)
        rays = np.stack([block_view(drawn, v.name).rays(at) for v, at in zip(views, observed, strict=True)])
        centres = np.stack([np.broadcast_to(block_view(drawn, v.name).centre, (9, 3)) for v in views])
        heights.append(intersect_rays(centres, rays)[0][:, 2])
    spread = np.std(heights, axis=0)
    assert height_sigmas(pair, known) == pytest.approx(spread, rel=0.25)


def _perturbed(known: Block, rng: np.random.Generator) -> Block:
    photos = []
    for photo in known.photos:
        error = rng.multivariate_normal(np.zeros(6), np.array(photo.covariance))
        photos.append(
            photo.model_copy(
                update={
                    "centre": tuple(np.array(photo.centre) + error[:3]),
                    "omega_phi_kappa": tuple(np.array(photo.omega_phi_kappa) + np.degrees(error[3:])),
                }
            )
        )
    return known.model_copy(update={"photos": tuple(photos)})


def test_the_joint_covariance_is_symmetric_and_holds_every_part():
    known = with_covariances((0.01, 0.02, 0.03, 1e-9, 2e-9, 3e-9), joint=0.5)
    pair = pair_of(known)
    photos = known.of(pair.left), known.of(pair.right)
    total = joint_covariance(known, photos, ("tiny",))
    assert total.shape == (29, 29) and np.array_equal(total, total.T)
    assert np.array_equal(np.diag(total)[:6], [0.01, 0.02, 0.03, 1e-9, 2e-9, 3e-9])
    assert np.allclose(total[:6, 6:12], 0.5 * total[:6, :6]) and not total[12:].any()


def test_the_joint_covariance_turns_with_the_order_of_the_photographs():
    known = block()
    cross = tuple(map(tuple, np.arange(36.0).reshape(6, 6).tolist()))
    known = known.model_copy(update={"joint": (JointCovariance(first="a1", second="a2", covariance=cross),)})
    forth = joint_covariance(known, (known.of("a1"), known.of("a2")), ("tiny",))[:6, 6:12]
    back = joint_covariance(known, (known.of("a2"), known.of("a1")), ("tiny",))[:6, 6:12]
    assert np.array_equal(forth, np.array(cross)) and np.array_equal(back, forth.T)


@pytest.mark.parametrize(("source", "counts"), [("block", True), ("calibration", False)])
def test_an_interior_orientation_counts_where_the_block_adjusted_it(source, counts):
    known = block()
    camera = known.cameras["tiny"].model_copy(update={"source": source, "covariance": covariance(*([1.0] * 17))})
    known = known.model_copy(update={"cameras": {"tiny": camera}})
    total = joint_covariance(known, (known.of("a1"), known.of("a2")), ("tiny",))
    assert (np.diag(total)[12:] == float(counts)).all()
