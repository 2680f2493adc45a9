"""Correlated image errors of a whole block: estimated, included in the camera's standard errors, and reported."""

from dataclasses import replace

import numpy as np
from orienting import orient, sentences
from simulated_block import turned_upright, two_strips

from orthomill.tasks.adjustment.model.interior_settings import FreeInterior
from orthomill.tasks.adjustment.testing.error_fields import TERMS, field_basis

RMS = 1.0


def displaced(block, seed, rms=RMS):
    """The block whose photographs each carry a smooth field of `rms` px, at tie points and at control."""
    camera, names = block.cameras.cameras["cam"], [view.name for view in block.views]
    coefficients = rms / np.sqrt(TERMS) * np.random.default_rng(seed).standard_normal((len(names), 2, TERMS))
    size = np.array([camera.width, camera.height])

    def moved(photo, col, row):
        xy = (np.column_stack([col, row]) - (size - 1) / 2) * [1.0, -1.0]
        shift = np.einsum("mkt,mt->mk", coefficients[photo], field_basis(xy, np.tile(size, (len(xy), 1))))
        return col + shift[:, 0], row - shift[:, 1]

    def marks(point):
        """Its measurements as the photographs show them."""
        for photo, (col, row, sigma) in point.measurements.items():
            there = moved([names.index(photo)], np.array([col]), np.array([row]))
            yield photo, (float(there[0][0]), float(there[1][0]), sigma)

    points = tuple(point.model_copy(update={"measurements": dict(marks(point))}) for point in block.control.points)
    ties = block.tie_points
    col, row = moved(ties.photo, ties.col, ties.row)
    control = block.control.model_copy(update={"points": points})
    return replace(block, control=control, tie_points=replace(ties, col=col, row=row))


def test_fields_reach_the_standard_errors_of_the_camera_and_are_reported():
    block = displaced(two_strips(5, gnss=5.0, control=0), 5)
    out = orient(block, interior=FreeInterior(kind="free"))
    camera, precision = out["block"].cameras["cam"], out["precision"]
    sigma, white = np.sqrt(camera.covariance[0][0]), precision.white_sigma["cam"][0]
    assert np.isclose(precision.common_px, RMS, rtol=0.4)
    assert precision.common_share < 0.5
    assert sigma > 2 * white
    assert abs(camera.c - block.views[0].camera.c) < 3 * sigma
    told = [text for text in sentences(precision) if text.startswith("Correlated image errors")]
    assert len(told) == 1 and "mostly different in each" in told[0]


def test_positions_and_control_are_not_blamed_for_fields():
    """Their standard errors are true: neither are they enlarged, nor do rays outvote them."""
    block = displaced(two_strips(5), 5)
    out = orient(block, interior=FreeInterior(kind="free"))
    camera, precision = out["block"].cameras["cam"], out["precision"]
    assert precision.position_factor == precision.control_factor == 1.0
    assert abs(camera.c - block.views[0].camera.c) < 3 * np.sqrt(camera.covariance[0][0])


def test_fields_of_hundredths_of_a_pixel_are_no_warning():
    """Whatever they do to the standard error of a constant that is known to a tenth of a permille."""
    out = orient(displaced(two_strips(5, sigma=0.01, stated_sigma=0.01), 5, 0.03), interior=FreeInterior(kind="free"))
    camera, precision = out["block"].cameras["cam"], out["precision"]
    sigma = np.sqrt(camera.covariance[0][0])
    assert precision.common_px is not None and sigma < 1e-3 * camera.c
    assert not any(text.startswith("Correlated image errors") for text in sentences(precision))


def test_cameras_of_turned_photographs_have_their_white_standard_errors():
    block = displaced(two_strips(5, tracks=700), 5)
    plain, out = (orient(one, interior=FreeInterior(kind="free")) for one in (block, turned_upright(block, {"s0_1": 6})))
    white = out["precision"].white_sigma
    assert set(white) == set(out["block"].cameras) and len(white) == 2
    upright, turned = (np.array(white[out["block"].of_photo[name]]) for name in ("s0_0", "s0_1"))
    assert np.allclose(upright, plain["precision"].white_sigma["cam"], rtol=1e-3)
    assert np.allclose(turned[:8], upright[[0, 2, 1, 3, 4, 5, 7, 6]]), "x0 and y0, p1 and p2 change places"


def test_white_noise_shows_no_correlation(volos_like):
    precision = volos_like[1]["precision"]
    assert precision.common_px is None and precision.common_share is None and precision.white_sigma == {}


def test_fields_do_not_contradict_a_right_constant():
    """Taken for white noise they do: 1511 px, for 1597."""
    block = displaced(two_strips(1, gnss=3.0, control=0), 1, 2.0)
    out = orient(block)
    assert "constant_contradicted" not in [finding.code for finding in out["precision"].findings]
    assert abs(out["block"].cameras["cam"].c / block.views[0].camera.c - 1.0) < 0.01
