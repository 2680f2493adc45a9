"""Pairs of a block: which are chosen, why others are not, and how precise their rows are."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tiny_block import block, photos, tie_points

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.orientation import JointCovariance
from orthomill.tasks.densification.surface_grid import pair_bounds
from orthomill.tasks.epipolar import row_precision
from orthomill.tasks.epipolar.pair_choice import PairChoice
from orthomill.tasks.epipolar.parallax import (
    NEAREST,
    common_measurements,
    kept_ties,
    row_residuals,
    summary,
    tie_places,
    with_measured_ties,
)
from orthomill.tasks.epipolar.report.epipolar_report import report
from orthomill.tasks.epipolar.row_precision import common_points, row_change, row_sigma, row_sigmas
from orthomill.tasks.epipolar.selection import Candidate, Places, best_pairs, choose_pairs, why_not
from orthomill.tasks.geometry.normal_case import epipolar_view
from orthomill.tasks.geometry.view import view_of


def strip_of(count):
    """A strip of `count` photographs, made of copies of one."""
    one = block()
    photos_ = tuple(
        one.photos[0].model_copy(
            update={"photo": f"s{i:03d}", "centre": (110.0 * i, 0.0, 450.0), "omega_phi_kappa": (0.0, 0.0, 0.0)}
        )
        for i in range(count)
    )
    return one.model_copy(update={"photos": photos_, "of_photo": {p.photo: "tiny" for p in photos_}})


def test_a_block_of_two_strips():
    pairs = choose_pairs(block(), PairChoice(), 0.08)
    names = {p.name for p in pairs.pairs}
    assert {"a1-a2", "a2-a3", "b1-b2", "b2-b3", "a1-b1", "a3-b3"} <= names
    assert 7 <= len(names) <= 10
    assert all(p.right_centre[0] - p.left_centre[0] > 0 or p.right_centre[1] > p.left_centre[1] for p in pairs.pairs)
    reasons = dict(pairs.not_used)
    assert "overlap" in reasons["b1-a3"] or "overlap" in reasons.get("a1-a3", "")
    assert not names & set(reasons)


def test_pairs_grow_linearly_with_the_strip():
    counts = [len(choose_pairs(strip_of(n), PairChoice(), 0.05).pairs) for n in (10, 20, 40)]
    assert counts[2] - counts[1] == 2 * (counts[1] - counts[0])
    assert counts[0] <= 20


def test_every_photograph_gets_a_pair():
    star = [Candidate(0, i, 0.5, 0.5 + i / 100, 0, 1) for i in range(1, 6)]
    assert len(best_pairs(star, np.eye(6)[:, :3], [Places()] * 6, PairChoice(per_photo=2))) == 5


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"overlap": 0.2}, "overlap of 20%"),
        ({"base_height": 0.05}, "below 0.1"),
        ({"base_height": 1.5}, "above 1.2"),
        ({"convergence": 60.0}, "60 degrees"),
        ({"scale": 2.0}, "factor 2.0"),
    ],
)
def test_reasons(change, word):
    good = {"first": 0, "second": 1, "overlap": 0.6, "base_height": 0.5, "convergence": 2.0, "scale": 1.0}
    assert why_not(Candidate(**good), PairChoice()) is None
    assert word in why_not(Candidate(**{**good, **change}), PairChoice())


def test_a_photograph_that_shows_the_horizon_is_named_and_the_others_are_paired():
    one = block()
    first = one.photos[0].model_copy(update={"omega_phi_kappa": (75.0, 0.0, 0.0)})
    pairs = choose_pairs(one.model_copy(update={"photos": (first, *one.photos[1:])}), PairChoice(), 0.08)
    assert "horizon" in dict(pairs.not_used)[first.photo]
    assert len(pairs.pairs) >= 4 and all(first.photo not in (p.left, p.right) for p in pairs.pairs)


def test_a_pair_whose_epipolar_images_show_the_horizon_is_left_out_with_the_reason():
    """About an object on the ground photographs see the ground, and the corners of their common images the sky: one such pair
    ended the surface of the whole block."""
    one = block()
    turned = ((52.0, 0.0, 40.0), (60.0, 0.0, -40.0))
    tilted = tuple(photo.model_copy(update={"omega_phi_kappa": turned[number % 2]}) for number, photo in enumerate(one.photos))
    choice = PairChoice(convergence=90.0, scale=9.0, overlap=0.05)
    pairs = choose_pairs(one.model_copy(update={"photos": tilted}), choice, 0.08)
    reasons = dict(pairs.not_used)
    assert any("corners of its epipolar images show the horizon" in reason for reason in reasons.values()), reasons
    assert all(np.isfinite(pair_bounds(pair, 0.0, 60.0)).all() for pair in pairs.pairs)


def test_a_pair_whose_base_points_along_the_view_gives_its_place_to_the_next_best():
    """Of a camera that climbs the images of a pair would be stretched to many times the photographs' pixels."""
    one = block()
    low = one.photos[0]
    high = one.photos[1]
    x, y, z = low.centre
    flying = z - one.ground_mean
    climbed = high.model_copy(update={"centre": (x + 0.28 * flying, y, z + 0.45 * flying)})
    climbing = one.model_copy(update={"photos": (low, climbed, *one.photos[2:])})
    pairs = choose_pairs(climbing, PairChoice(per_photo=1, per_place=1), 0.08)
    name = next(name for name in dict(pairs.not_used) if set(name.split("-")) == {low.photo, high.photo})
    assert "base points along the view" in dict(pairs.not_used)[name]
    assert any(low.photo in (pair.left, pair.right) for pair in pairs.pairs)
    named = [one_name for one_name, _ in pairs.not_used]
    assert len(named) == len(set(named))


def test_a_pair_without_common_ground_at_its_mean_height_is_listed_with_the_reason(monkeypatch):
    """Photographs of an object from all sides overlap on the level plane under it, but not where their pair looks."""
    first = choose_pairs(block(), PairChoice(), 0.08).pairs[0].name
    corners = row_precision.common_corners
    nowhere = np.zeros((0, 2))
    monkeypatch.setattr(row_precision, "common_corners", lambda pair, one: nowhere if pair.name == first else corners(pair, one))
    pairs = choose_pairs(block(), PairChoice(), 0.08)
    assert dict(pairs.not_used)[first] == "they show no common ground at its mean height"
    assert pairs.pairs and first not in {pair.name for pair in pairs.pairs}


def test_rows_are_predicted_for_ground_that_both_photographs_show():
    one = block()
    askew = tuple(photo.model_copy(update={"omega_phi_kappa": (0.0, 0.0, 40.0)}) for photo in one.photos)
    turned = one.model_copy(update={"photos": askew})
    for pair in choose_pairs(turned, PairChoice(), 0.08).pairs:
        places, parallax = common_points(pair, turned), (pair.parallax_low + pair.parallax_high) / 2
        for side, name, xy in (("left", pair.left, places), ("right", pair.right, places - [parallax, 0.0])):
            view = view_of(turned.of(name), turned.camera_of(name))
            pixels = epipolar_view(pair, side, view).to_photo(xy * [1, -1] + [getattr(pair, f"{side}_col0"), pair.row0])
            assert view.contains(pixels, margin=-2.0).all(), "curved borders are a pixel off their hull"
        assert len(places) > 20


def test_no_useful_pair_is_one_sentence():
    with pytest.raises(GeometryError, match="No pair of photographs is useful"):
        choose_pairs(block(), PairChoice(overlap=0.95), 0.08)
    with pytest.raises(GeometryError, match="share ground"):
        choose_pairs(strip_of(1), PairChoice(), 0.08)


def test_photographs_along_a_street_are_told_once_with_what_to_do():
    one = strip_of(7)
    level = tuple(photo.model_copy(update={"omega_phi_kappa": (90.0, 0.0, 0.0)}) for photo in one.photos)
    with pytest.raises(GeometryError) as told:
        choose_pairs(one.model_copy(update={"photos": level}), PairChoice(), 0.08)
    assert str(told.value).count("shows the horizon") == 1 and "and 2 more: shows the horizon" in str(told.value)
    assert "grid: {kind: plane}" in str(told.value)


def test_tie_points_of_a_pair():
    ties, pair = tie_points(), choose_pairs(block(), PairChoice(), 0.08).pairs[0]
    names = photos().names
    left, right = common_measurements(ties, names.index(pair.left), names.index(pair.right))
    assert len(left) > 30 and (ties.track[left] == ties.track[right]).all()
    assert np.abs(row_residuals(pair, block(), ties, names)).max() < 1e-7
    noisy = summary(row_residuals(pair, block(), tie_points(0.2), names))
    assert noisy.rms == pytest.approx(0.2 * np.sqrt(2), rel=0.25)
    assert summary(np.array([])).points == 0


def test_row_change_against_numbers():
    """The partials of the row against differences of a moved photograph."""
    pair = choose_pairs(block(), PairChoice(), 0.08).pairs[0]
    photo = block().of(pair.left)
    xy = np.array([[40.0, 60.0], [-90.0, 120.0]])
    parallax = (pair.parallax_low + pair.parallax_high) / 2
    rays = np.column_stack([xy, np.full(2, -pair.c)]) @ np.array(pair.rotation)
    ground = np.array(photo.centre) + rays * pair.base / parallax
    epipolar = epipolar_view(pair, "left", view_of(photo, block().camera_of(pair.left)))
    for k, step in enumerate([1e-3] * 3 + [1e-6] * 3):
        centre, angles = np.array(photo.centre), np.array(photo.omega_phi_kappa)
        if k < 3:
            centre[k] += step
        else:
            angles[k - 3] += np.degrees(step)
        moved = photo.model_copy(update={"centre": tuple(centre), "omega_phi_kappa": tuple(angles)})
        observed = view_of(moved, block().camera_of(pair.left)).project(ground)
        by_number = (epipolar.from_photo(observed)[:, 1] - (pair.row0 - xy[:, 1])) / step
        np.testing.assert_allclose(np.abs(row_change(pair, photo, xy, parallax)[:, k]), np.abs(by_number), rtol=2e-3, atol=1e-3)


def test_row_sigma_without_covariance_is_sigma0():
    bare = block().model_copy(update={"photos": tuple(p.model_copy(update={"covariance": None}) for p in block().photos)})
    pair = choose_pairs(block(), PairChoice(), 0.08).pairs[0]
    assert row_sigma(pair, bare) == 0.3
    assert 0.01 < pair.row_sigma < 0.3


def test_the_prediction_is_the_mean_over_the_common_ground():
    pair = choose_pairs(block(), PairChoice(), 0.08).pairs[0]
    every = row_sigmas(pair, block(), common_points(pair, block()))
    assert every.min() < pair.row_sigma_predicted < every.max()
    assert pair.row_sigma == pair.row_sigma_predicted == pytest.approx(np.sqrt((every**2).mean()))


@settings(max_examples=8, deadline=None)
@given(noise=st.floats(0.02, 2.0), share=st.floats(0.0, 0.15))
def test_tie_points_measure_the_rows_of_their_pair(noise, share):
    """Both measurements of a point have the noise; a few wrong points count little."""
    pairs, ties = choose_pairs(block(), PairChoice(), 0.08), tie_points(noise)
    wrong = np.random.default_rng(1).random(len(ties)) < share
    found = with_measured_ties(pairs, block(), replace(ties, row=ties.row + 30.0 * wrong), photos().names)
    for pair, predicted in zip(found.pairs, pairs.pairs, strict=True):
        assert 0.7 < pair.row_sigma / (np.sqrt(2) * noise) < 2.2
        assert pair == predicted.model_copy(update={"row_sigma": pair.row_sigma})


def test_a_pair_is_searched_to_twice_the_parallax_of_its_nearest_tie_point():
    """Of a photograph taken low the heights that suit the others reach its lens."""
    pairs, ties = choose_pairs(block(), PairChoice(), 0.08), tie_points(0.1)
    deep = pairs.model_copy(
        update={"pairs": tuple(p.model_copy(update={"parallax_high": 20.0 * p.parallax_high}) for p in pairs.pairs)}
    )
    for pair, wide in zip(with_measured_ties(deep, block(), ties, photos().names).pairs, deep.pairs, strict=True):
        left, right = tie_places(pair, block(), kept_ties(ties), photos().names)
        parallax = left[:, 0] - right[:, 0] - (pair.left_col0 - pair.right_col0)
        assert pair.parallax_high == pytest.approx(NEAREST * parallax.max()) and pair.parallax_high < wide.parallax_high


def test_rows_without_tie_points_are_predicted():
    pairs, ties = choose_pairs(block(), PairChoice(), 0.08), tie_points(0.5)
    assert with_measured_ties(pairs, block(), ties.take(np.zeros(0, int)), photos().names) == pairs
    rejected = replace(ties, used=np.zeros(len(ties), bool))
    assert with_measured_ties(pairs, block(), rejected, photos().names) == pairs
    surveyed = replace(ties, track=-1 - ties.track)
    assert with_measured_ties(pairs, block(), surveyed, photos().names) == pairs


def test_report_warns_in_sentences():
    pairs = choose_pairs(block(), PairChoice(), 0.08)
    quiet = report(block(), pairs, tie_points(0.1), photos())
    assert not quiet.warnings
    loud = report(block(), pairs, tie_points(2.0), photos())
    assert any("lie off their row" in sentence for sentence in loud.warnings)
    weak = pairs.model_copy(update={"pairs": tuple(p.model_copy(update={"row_sigma_predicted": 2.5}) for p in pairs.pairs)})
    nothing = tie_points(0.1).take(np.zeros(0, int))
    assert any("2.50 px" in sentence for sentence in report(block(), weak, nothing, photos()).warnings)
    assert {f.name: f.value for f in quiet.figures}["pairs"] == len(pairs.pairs)
    assert {f.name: f.value for f in report(block(), weak, nothing, photos()).figures}["row_band"] == 2.5


def test_what_moves_both_photographs_alike_moves_no_row():
    pair = choose_pairs(block(), PairChoice(), 0.08).pairs[0]
    shift = tuple(map(tuple, np.diag([100.0, 100.0, 100.0, 0.0, 0.0, 0.0])))
    photos = tuple(p.model_copy(update={"covariance": shift}) for p in block().photos)
    joint = (JointCovariance(first=pair.right, second=pair.left, covariance=shift),)
    assert row_sigma(pair, block().model_copy(update={"photos": photos, "joint": joint})) < 1e-6
    assert row_sigma(pair, block().model_copy(update={"photos": photos})) > 1.0
