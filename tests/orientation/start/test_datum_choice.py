"""The datum of a model: exact where it is observed, robust, and named where it is weak or missing."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import small_network
from surveyed_model import GRID, GROUND, NOTHING, SCALE, SITE, TURN, block, in_model

from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.start.georeference import choose_datum, with_datum


def choose(model, known, looking="auto", shift=False, origin=None):
    return choose_datum(model, known, np.radians(5.0), looking, shift, origin)


def placed(datum, points):
    return datum.similarity.apply(in_model(points)) + datum.origin - SITE


def codes(datum):
    return [finding.code for finding in datum.findings]


def test_positions_all_over_the_block_define_the_datum():
    datum = choose(*block())
    np.testing.assert_allclose(placed(datum, GRID), GRID, atol=1e-6)
    assert not datum.free and datum.up is None and datum.findings == ()
    assert (
        datum.sentence == "GNSS: the datum is defined by 6 GNSS positions of the projection centres, each with its standard errors."
    )
    assert (datum.origin == np.round(datum.origin)).all()


def test_control_and_positions_are_named_together():
    datum = choose(*block(control=GROUND))
    assert datum.sentence.startswith("Control: the datum is defined by 5 ground control points and 6 GNSS positions")


def test_control_wins_over_positions_that_are_all_elsewhere():
    """Five points of control agree; six positions agree among themselves 500 m away."""
    model, known = block(control=GROUND)
    datum = choose(model, replace(known, position=known.position + np.array([500.0, 0, 0])))
    assert datum.positions_aside.all() and not datum.control_aside.any()
    np.testing.assert_allclose(placed(datum, GROUND), GROUND, atol=1e-6)


def test_a_single_position_elsewhere_is_set_aside():
    model, known = block()
    position = known.position.copy()
    position[2] += [0, 300.0, 0]
    datum = choose(model, replace(known, position=position))
    assert datum.positions_aside.tolist() == [False, False, True, False, False, False]
    assert "5 GNSS positions" in datum.sentence


def test_a_common_error_of_the_positions_is_removed_where_it_is_to_be_adjusted():
    model, known = block(control=GROUND)
    known = replace(known, position=known.position + np.array([3.0, -2.0, 8.0]))
    np.testing.assert_allclose(placed(choose(model, known, shift=True), GROUND), GROUND, atol=1e-6)
    assert np.abs(placed(choose(model, known), GROUND) - GROUND).max() > 1e-3


def test_positions_on_one_line_need_the_up_direction():
    strip = np.array([[20.0 * i, 0.1 * (i % 2), 100.0] for i in range(6)])
    datum = choose(*block(strip))
    (finding,) = datum.findings
    assert finding.code == "tilt_unobserved" and finding.basis == "down" and finding.sigma_deg == pytest.approx(5.0, abs=0.2)
    assert "the tilt about their common line rests on the assumption that the photographs look straight down" in datum.sentence
    np.testing.assert_allclose(datum.up, np.tile([0, 0, 1.0], (6, 1)))
    rotation = datum.similarity.rotation @ TURN
    assert np.degrees(np.arccos(rotation[2, 2])) < 3.0, "as level as the photographs look down on average"


@pytest.mark.parametrize(("off_deg", "held"), [(45.0, False), (5.0, True)])
def test_positions_that_show_where_photographs_look_need_no_assumption_of_it(off_deg, held):
    model, known = block(GRID * [1.0, 0.25, 1.0])
    known = replace(known, position_sigma=np.full((6, 3), 0.5))
    away = rotation_matrix(np.radians(off_deg), 0.0, 0.0)
    datum = choose(replace(model, rotation=model.rotation @ TURN @ away @ TURN.T), known)
    (finding,) = datum.findings
    assert 1.0 < finding.tilt_sigma_deg < 1.5
    assert (finding.basis == "down" and finding.sigma_deg < finding.tilt_sigma_deg) == held == (datum.up is not None)
    if not held:
        assert "look elsewhere than could be assumed" in finding.sentence and "rests" not in datum.sentence
        np.testing.assert_allclose((datum.similarity.rotation @ TURN)[2], [0, 0, 1], atol=1e-6)


def test_attitudes_come_before_assumptions():
    strip = np.array([[20.0 * i, 0.1 * (i % 2), 100.0] for i in range(6)])
    model, known = block(strip, tilt=0.3)
    up = np.einsum("pij,j->pi", model.rotation, TURN @ [0, 0, 1.0])
    datum = choose(model, replace(known, up=up))
    assert datum.findings[0].basis == "attitude"
    np.testing.assert_allclose((datum.similarity.rotation @ TURN)[2], [0, 0, 1], atol=1e-6)


@pytest.mark.parametrize(
    ("position", "codes_"), [(NOTHING, ["no_datum"]), (np.tile(SITE, (6, 1)), ["no_datum", "positions_crowded"])]
)
def test_without_positions_the_network_is_free(position, codes_):
    model, known = block()
    datum = choose(model, replace(known, position=position))
    assert datum.free and codes(datum) == codes_ and "place, direction and scale are arbitrary" in datum.sentence
    assert "of arbitrary scale" in datum.system, "files must not say that the block lies in the project's system"
    heights = datum.similarity.apply(model.centre)[:, 2].mean() - np.median(datum.similarity.apply(model.point)[:, 2])
    assert heights == pytest.approx(100.0, abs=0.5)


@pytest.mark.parametrize(("error", "shown"), [(1.0, True), (400.0, False)])
def test_crowded_positions_show_an_approximate_scale_where_they_agree_with_the_block(error, shown):
    """Positions stated to 2 km, good to 1 m among themselves or not at all."""
    model, known = block()
    position = known.position + np.random.default_rng(5).normal(0.0, error, known.position.shape)
    datum = choose(model, replace(known, position=position, position_sigma=np.full((6, 3), 2000.0)))
    finding = datum.findings[0]
    assert datum.free and codes(datum) == ["no_datum", "positions_crowded"] and finding.scaled == shown
    assert ("in metres" in datum.system) == ("the positions show the scale to" in datum.sentence) == shown
    if shown:
        assert abs(datum.similarity.scale * SCALE - 1.0) < 3.0 * finding.scale_share < 0.1


def test_control_on_a_small_object_defines_the_datum_that_a_telephone_cannot():
    """An object of two metres: positions that are stated to 6 m, three times the walk round it, and control good to 1 cm."""
    small = 0.02
    model, known = block(small * GRID, small * GROUND)
    noise = np.random.default_rng(7).normal(0.0, 1.0, known.position.shape)
    known = replace(
        known, position=known.position + noise, position_sigma=np.full((6, 3), 6.0), control_sigma=np.full((5, 3), 0.01)
    )
    datum = choose(model, known)
    assert not datum.free and datum.sentence.startswith("Control: the datum is defined by 5 ground control points")
    np.testing.assert_allclose(placed(datum, small * GROUND), small * GROUND, atol=0.01)
    # Control that lies within its own standard errors as well says no more than the positions.
    assert codes(choose(model, replace(known, control_sigma=np.full((5, 3), 2.0)))) == ["no_datum", "positions_crowded"]


def test_a_measured_distance_gives_a_free_network_its_scale():
    model, known = block(control=GROUND)
    length = float(np.linalg.norm(GROUND[1] - GROUND[0]))
    known = replace(known, position=NOTHING, control=np.full((5, 3), np.nan), distances=((0, 1, length, 0.01),))
    datum = choose(model, known)
    assert datum.free and datum.similarity.scale == pytest.approx(1 / SCALE)
    assert "in metres" in datum.system
    assert datum.findings[0].scaled and "1 measured distance gives the scale" in datum.sentence


def test_a_free_network_of_given_orientations_keeps_their_system():
    model, known = block()
    datum = choose(model, replace(known, position=NOTHING), origin=SITE)
    assert datum.similarity.scale == 1.0 and (datum.similarity.rotation == np.eye(3)).all() and (datum.origin == SITE).all()
    assert "those of the given orientation" in datum.sentence and datum.system is None


def test_control_with_x_and_y_exchanged_is_recognised():
    model, known = block(control=GROUND)
    known = replace(known, position=NOTHING, control=(known.control - SITE)[:, [1, 0, 2]] + SITE)
    datum = choose(model, known)
    (finding,) = datum.findings
    assert finding.code == "axes_exchanged" and finding.exchanged_m < 0.01 < 1.0 < finding.given_m
    assert datum.free and datum.control_aside.all()


def test_photographs_of_a_ceiling_look_upwards():
    """The control is right, and the cameras below it."""
    model, known = block(np.array(GRID) * [1, 1, -1], control=GROUND)
    model = replace(model, rotation=np.diag([1.0, -1.0, -1.0]) @ model.rotation)
    assert codes(choose(model, replace(known, position=NOTHING))) == ["looks_upward"]


def test_control_on_one_line_is_one_sided():
    line = np.array([[10.0 * i, 0.5 * (i % 2), 0.0] for i in range(6)])
    datum = choose(*block(control=line))
    assert codes(datum) == ["control_on_a_line"]


def test_positions_that_do_not_fit_the_shape_are_reported():
    """A model stretched by a fifth along the strip: every position is many standard errors off."""
    model, known = block()
    stretched = in_model(GRID * [1.25, 1.0, 1.0])
    datum = choose(replace(model, centre=stretched), replace(known, position_sigma=np.full((6, 3), 0.02)))
    assert "datum_misfit" in codes(datum) and next(f.ratio for f in datum.findings if f.code == "datum_misfit") > 10


@pytest.mark.parametrize(("blur", "misfit"), [(0.0, True), (8.0 * SCALE, False)])
def test_control_misses_the_model_by_the_errors_of_its_marks_too(blur, misfit):
    """Coordinates to 2 cm, marks that place them in the model to 8 m: no contradiction between control and block."""
    model, known = block(control=GROUND)
    marks = in_model(GROUND + np.random.default_rng(2).normal(0.0, 8.0, GROUND.shape))
    datum = choose(model, replace(known, position=NOTHING, control_model=marks, blur=np.full(5, blur)))
    assert ("datum_misfit" in codes(datum)) is misfit


def test_points_with_poor_marks_weigh_less_in_the_datum():
    model, known = block(control=GROUND)
    marks, blur = in_model(GROUND), np.zeros(5)
    marks[1] += in_model(np.array([[3.0, -4.0, 5.0]]))[0]
    known = replace(known, position=NOTHING, control_model=marks)
    blur[1] = 8.0 * SCALE
    apart = [np.abs(placed(choose(model, one), GROUND) - GROUND).max() for one in (known, replace(known, blur=blur))]
    assert apart[1] < 0.02 < apart[0]


@pytest.fixture(scope="module")
def network():
    return small_network(photos=4, points=10, free=True)[0]


def four(control_sigma=0.02):
    model, known = block(GRID[:4], control=GROUND[:2])
    return model, replace(known, control_sigma=np.full((2, 3), control_sigma))


def test_weights_follow_from_the_standard_errors(network):
    model, known = four()
    out = with_datum(network, known, choose(model, known), 8)
    np.testing.assert_allclose(out.centre_weight, 1 / 0.3**2)
    np.testing.assert_allclose(out.point_weight[8:], 1 / 0.02**2)
    assert not out.point_weight[:8].any() and out.named.tolist() == [8, 9]
    np.testing.assert_allclose(out.point[8:] + choose(model, known).origin, known.control, atol=1e-9)


def test_what_is_set_aside_or_unknown_has_no_weight(network):
    model, known = four()
    position = known.position.copy()
    position[1] = np.nan
    known = replace(known, position=position)
    datum = replace(
        choose(model, known), positions_aside=np.array([True, False, False, False]), control_aside=np.array([False, True])
    )
    out = with_datum(network, known, datum, 8)
    assert out.centre_weight.any(axis=1).tolist() == [False, False, True, True] and np.isfinite(out.centre).all()
    assert out.point_weight[8:].any(axis=1).tolist() == [True, False]


def test_a_free_network_takes_no_observations(network):
    model, known = four()
    out = with_datum(network, known, choose(model, replace(known, position=NOTHING[:4], control=np.full((2, 3), np.nan))), 8)
    assert out.free and not out.centre_weight.any() and not out.point_weight.any() and out.named.tolist() == [8, 9]
