"""Weaknesses of a calibration: each is found where it is planted, and its sentence gives the figure and what to do."""

import re
from dataclasses import replace

import numpy as np
import pytest
from bent_boards import bent_photographs
from board_corners import EASY, corners_of, easy_calibration

from orthomill.tasks.adjustment.boards.board_network import PARAMETERS
from orthomill.tasks.calibration.board_tables import PhotoSearch
from orthomill.tasks.calibration.diagnosis.advice import (
    CELLS,
    LIMITING,
    Advice,
    PhotoGeometry,
    Weakness,
    frame_cells,
    geometry,
    geometry_advice,
    result_advice,
    search_advice,
)
from orthomill.tasks.calibration.report.advice_sentences import advice_sentence
from orthomill.tasks.calibration.solving.arranging import arrangement_of
from orthomill.tasks.calibration.solving.lens_models import MODELS
from orthomill.tasks.calibration.solving.model_choice import HeldOut, held_out
from orthomill.tasks.calibration.solving.solving import CalibrationTarget, solve

GOOD = PhotoGeometry(tilt_median=25.0, tilt_largest=35.0, turned=90.0, directions=4, coverage=0.9)


def codes(advice: list[Advice]) -> list[Weakness]:
    return [one.code for one in advice]


def of_shape(**changes: float) -> list[Advice]:
    """The advice on a geometry that differs from a good one, without that on correlations."""
    _, result = easy_calibration()
    return [one for one in geometry_advice(result, replace(GOOD, **changes)) if one.code is not Weakness.STRONG_CORRELATION]


def search(**changes) -> PhotoSearch:
    return PhotoSearch(**{"photo": "a", "boards": 1, "blur": 1.0, "overexposed": 0.0, **changes})


@pytest.fixture(scope="module")
def flat():
    """Photographs that look straight down and are not turned."""
    target, found = corners_of(replace(EASY, tilt=(1.0, 4.0), turned=False, photos=6))
    return target, arrangement_of(found, target).result


def test_good_photographs_raise_no_advice_on_their_geometry():
    target, result = easy_calibration()
    assert not set(codes(geometry_advice(result, geometry(result, target)))) - {
        Weakness.LITTLE_COVERAGE,
        Weakness.STRONG_CORRELATION,
    }


def test_poor_photographs_say_why(flat):
    target, result = flat
    found = geometry_advice(result, geometry(result, target))
    assert {Weakness.NO_TILT, Weakness.NOT_TURNED, Weakness.STRONG_CORRELATION} <= set(codes(found))
    strong = next(one for one in found if one.code is Weakness.STRONG_CORRELATION)
    assert "c and Z0" in strong.names and min(strong.values) > 0.9 and len(strong.names) == len(strong.values)


def test_the_geometry_of_the_photographs_is_that_of_the_scene(flat):
    target, result = flat
    shape = geometry(result, target)
    assert shape.tilt_largest < 4.5 and shape.turned < 30.0 and shape.directions == 0
    target, result = easy_calibration()
    shape = geometry(result, target)
    assert 24.0 < shape.tilt_median < shape.tilt_largest < 41.0 and shape.turned > 150.0 and shape.directions >= 3


def test_kappa_is_compared_on_the_circle(flat):
    target, result = flat
    turn = np.radians([179.0, -179.0, 180.0, 180.0, 180.0, 180.0])
    rotation = np.array([[[np.cos(t), np.sin(t), 0], [-np.sin(t), np.cos(t), 0], [0, 0, 1]] for t in turn])
    shape = geometry(replace(result, state=replace(result.state, rotation=rotation)), target)
    assert shape.turned == pytest.approx(2.0) and shape.tilt_largest == 0.0


def test_cells_of_the_frame_are_counted_row_by_row():
    target, result = easy_calibration()
    width, height = target.size
    pixels = np.array([[0.0, 0.0], [width - 1.0, 0.0], [0.0, height - 1.0], [width - 1.0, height - 1.0], [width / 2, height / 2]])
    corners = replace(result.corners.take(np.arange(5)), xy=target.centred(pixels))
    few = replace(result, corners=corners, used=np.ones(5, dtype=bool))
    last = CELLS - 1
    assert frame_cells(few, target).tolist() == [0, last, CELLS * last, CELLS * last + last, CELLS * CELLS // 2 + CELLS // 2]


@pytest.mark.parametrize(
    ("changes", "code", "value"),
    [
        ({"tilt_largest": 9.9, "tilt_median": 4.0}, Weakness.NO_TILT, 9.9),
        ({"tilt_median": 9.9}, Weakness.LITTLE_TILT, 9.9),
        ({"directions": 2}, Weakness.ONE_SIDED_TILT, 2),
        ({"turned": 39.0}, Weakness.NOT_TURNED, 39.0),
        ({"coverage": 0.59}, Weakness.LITTLE_COVERAGE, 0.59),
    ],
)
def test_a_poor_geometry_is_named_with_its_figure(changes, code, value):
    assert of_shape() == []
    assert of_shape(**changes) == [Advice(code, value)]


def test_without_tilt_its_direction_is_not_mentioned():
    assert codes(of_shape(tilt_largest=3.0, tilt_median=2.0, directions=0)) == [Weakness.NO_TILT]


def test_a_calibration_without_a_check_says_so():
    target, result = easy_calibration()
    assert codes(result_advice(result, None, target)) == [Weakness.NOT_CHECKED]


def test_held_out_photographs_that_fit_worse_and_halves_that_differ_are_reported():
    target, result = easy_calibration()
    fine = held_out(result)
    assert fine is not None and result_advice(result, fine, target) == []
    worse = result_advice(result, replace(fine, rms=2.0 * result.rms), target)
    assert codes(worse) == [Weakness.HELD_OUT_WORSE] and worse[0].value == pytest.approx(2.0)
    moved = fine.difference.copy()
    moved[1] = 7.0 * fine.sigma[1]
    assert result_advice(result, replace(fine, difference=moved), target) == [
        Advice(Weakness.HALVES_DIFFER, pytest.approx(7.0), ("x0",))
    ]


def test_many_rejected_corners_and_a_large_sigma0_are_reported():
    target, result = easy_calibration()
    none = HeldOut(0.0, 0.0, np.zeros(10), np.ones(10))
    used = result.used.copy()
    used[: len(used) // 10] = False
    rejected = result_advice(replace(result, used=used), none, target)
    assert codes(rejected) == [Weakness.MANY_REJECTED] and rejected[0].value == pytest.approx(0.1, abs=0.01)
    assert codes(result_advice(replace(result, sigma0=1.6), none, target)) == [Weakness.LARGE_SIGMA0]
    large = replace(target, size=(10000, 8000))
    assert result_advice(replace(result, sigma0=1.6), none, large) == [], "a larger frame has larger residuals in px"


def test_a_board_with_larger_residuals_is_named_unless_there_are_only_two():
    target, result = easy_calibration()
    none = HeldOut(0.0, 0.0, np.zeros(10), np.ones(10))
    warped = np.where((result.corners.board == 1)[:, None], 4.0, 1.0) * result.residual
    assert result_advice(replace(result, residual=warped), none, target)[-1] == Advice(Weakness.UNEVEN_BOARDS, 2.5, ("2",))
    two = replace(result, residual=warped, network=replace(result.network, boards=2))
    assert Weakness.UNEVEN_BOARDS not in codes(result_advice(two, none, target))


def test_searches_with_blur_saturation_and_other_boards_are_reported():
    assert search_advice((search(), search(photo="b", blur=None))) == []
    found = search_advice(
        (
            search(blur=4.0, other=((8, 6), (8, 6))),
            search(photo="b", overexposed=0.4, larger=2, other=((8, 6),)),
            search(photo="c", other=((7, 4),)),
        )
    )
    assert found == [
        Advice(Weakness.BLURRED, names=("a",), values=(4.0,)),
        Advice(Weakness.OVEREXPOSED, names=("b",), values=(0.4,)),
        Advice(Weakness.LARGER_BOARDS, names=("b",)),
        Advice(Weakness.OTHER_BOARDS, 2, corners=(8, 6)),
    ], "a photograph counts once for a size, and a single photograph of a size is not mentioned"


@pytest.mark.parametrize(
    ("advice", "parts"),
    [
        (Advice(Weakness.NO_TILT, 3.14159), ["All photographs", "largest tilt 3.1 degrees", "tilt the camera"]),
        (Advice(Weakness.LITTLE_TILT, 8.26), ["Most photographs", "median tilt 8.3 degrees", "Z0 are correlated"]),
        (Advice(Weakness.ONE_SIDED_TILT), ["one side only", "all four sides"]),
        (Advice(Weakness.NOT_TURNED, 12.6), ["13 degrees at most", "turned by 90 degrees"]),
        (Advice(Weakness.LITTLE_COVERAGE, 0.253), ["25 % of the frame's 8 x 8 cells", "extrapolated", "in the corners"]),
        (
            Advice(Weakness.STRONG_CORRELATION, names=("c and Z0", "x0 and phi"), values=(0.95, 0.991)),
            ["c and Z0 (95 %), x0 and phi (99 %); add photographs"],
        ),
        (Advice(Weakness.NOT_CHECKED), ["too few photographs", "held-out"]),
        (Advice(Weakness.HELD_OUT_WORSE, 1.84), ["1.8 times worse", "standard errors", "too small"]),
        (Advice(Weakness.HALVES_DIFFER, 5.23, ("y0",)), ["differ in y0 by 5.2 of its formal standard errors"]),
        (Advice(Weakness.MANY_REJECTED, 0.124), ["12 % of the corners were rejected"]),
        (Advice(Weakness.LARGE_SIGMA0, 2.345), ["sigma0 is 2.35 px", "arrangement: space", "do not sign"]),
        (Advice(Weakness.UNEVEN_BOARDS, 2.5, ("2", "4")), ["board 2, 4", "more than 2.5 times"]),
        (Advice(Weakness.BLURRED, names=("a", "b"), values=(4.04, 3.0)), ["a (4.0 px), b (3.0 px)", "in focus"]),
        (Advice(Weakness.OVEREXPOSED, names=("b",), values=(0.4,)), ["b (40 %)", "expose less"]),
        (Advice(Weakness.LARGER_BOARDS, names=("a", "b")), ["more corners than stated", "in a, b;", "number of inner corners"]),
        (Advice(Weakness.OTHER_BOARDS, 3, corners=(8, 6)), ["8 x 6 inner corners", "in 3 photographs; is that the number?"]),
    ],
    ids=lambda part: part.code.value if isinstance(part, Advice) else "",
)
def test_every_weakness_has_a_sentence_with_its_figures(advice, parts):
    sentence = advice_sentence(advice)
    assert all(part in sentence for part in parts), sentence
    assert sentence.endswith((".", "?"))


def test_no_weakness_is_without_words():
    full = [Advice(code, 1.0, ("a",), (1.0,), (9, 6)) for code in Weakness]
    assert len({advice_sentence(one) for one in full}) == len(Weakness)


def test_a_bent_board_is_said_with_its_bend_and_a_flat_one_is_not():
    target = CalibrationTarget((1280, 960), (9, 6), 0.03, 1, bend=0.005)
    for sag, said in ((0.004, True), (0.0, False)):
        true, corners = bent_photographs(target, sag, 0)
        advice = result_advice(solve(target, (true,), corners, MODELS[0].free), None, target)
        bent = [advice_sentence(one) for one in advice if one.code is Weakness.BENT_BOARD]
        assert bool(bent) is said and all(re.match(r"Board 1 is bent by (3\.9|4\.0) mm", one) for one in bent)


def test_parameters_that_are_no_camera_are_told(monkeypatch):
    target, result = easy_calibration()
    weak = {Weakness.NOT_SQUARE, Weakness.CONSTANT_UNCERTAIN, Weakness.UNDETERMINED}
    assert not set(codes(result_advice(result, None, target))) & weak and weak < LIMITING
    interior, covariance = result.state.interior.copy(), 1e10 * result.interior_covariance
    affinity = PARAMETERS.index("affinity")
    interior[affinity], covariance[affinity, affinity] = 0.0355, 0.0006**2
    monkeypatch.setattr(type(result), "interior_covariance", property(lambda _: covariance))
    found = result_advice(replace(result, state=replace(result.state, interior=interior)), None, target)
    told = {one.code: advice_sentence(one) for one in found}
    assert "3.5 % off square (59 of its standard errors)" in told[Weakness.NOT_SQUARE]
    assert "has a standard error of" in told[Weakness.CONSTANT_UNCERTAIN] and "k1 " in told[Weakness.UNDETERMINED]
