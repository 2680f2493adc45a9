"""The short version of the matching benchmark: its measures against hand-made errors, and what must hold on a small part."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.matching import matching_published
from benchmarks.matching.dissertation_pair import CLEAN, NOISY, GroundTexture, ground_texture
from benchmarks.matching.matching_experiment import Experiment, Score, score
from benchmarks.matching.matching_peers import semi_global_opencv
from benchmarks.matching.matching_readings import reading, with_contrast
from benchmarks.matching.matching_surfaces import QUICK_WINDOW, dense_page
from benchmarks.matching.matching_windows import SIZES, STRATEGIES, differences, measured, settings_of, sizings, strategies
from benchmarks.matching.matching_workers import workers_page
from benchmarks.matching.published_recipe import published
from orthomill.tasks.matching.least_squares.least_squares_settings import Ellipse, Square


@pytest.fixture(scope="module")
def texture() -> GroundTexture:
    return ground_texture()


@pytest.fixture(scope="module")
def experiment(texture) -> Experiment:
    return Experiment.quick(texture)


def test_fgdc_measures_are_the_published_ones():
    found = score(np.array([[0.51, 1.11, 2.02]]))
    assert (found.horizontal, found.vertical) == pytest.approx((1.98, 3.96), abs=0.005)


def test_blunders_count_by_any_axis_and_only_when_returned():
    errors = np.array([[0.0, 0.0, 0.2], [0.15, 0.0, 0.0], [0.0, 0.0, -0.22], [np.nan] * 3])
    found = score(errors, np.array([True, True, True, False]))
    assert (found.returned, found.blunders, found.correct, found.assigned) == (75.0, 2, 25.0, 75.0)


def test_published_tables_agree_with_themselves():
    for rows in (
        matching_published.SQUARES,
        matching_published.ELLIPSES,
        matching_published.ACROSS,
        matching_published.DYNAMIC_SQUARES,
        matching_published.DYNAMIC_ELLIPSES,
    ):
        for name, row in rows.items():
            assert row.returned - 100 * row.blunders / matching_published.TESTED == pytest.approx(row.correct, abs=0.03), name


def test_the_start_list_has_the_published_errors_and_is_the_same_again(experiment, texture):
    errors = experiment.starts - experiment.truth
    assert errors.std(axis=0) == pytest.approx([1.5, 0.5], rel=0.1)
    assert np.array_equal(Experiment.quick(texture).starts, experiment.starts)


def test_bands_together_are_the_experiment(experiment):
    bands = list(experiment.bands())
    assert np.array_equal(np.sort(np.concatenate([band.rows for band in bands])), np.arange(len(experiment.points)))
    for band in bands:
        assert (band.points >= 60).all() and (band.points < np.array(band.crop.left.shape[::-1]) - 60).all()


def test_the_tables_have_all_48_settings_of_three_shapes():
    settings = settings_of(dict.fromkeys(matching_published.ASSIGNED))
    names = [(setting.name, setting.shape) for setting in settings if not setting.limited]
    assert len(names) == len(set(names)) == 3 * 48


def test_calibrated_methods_give_the_published_shares_windows(experiment):
    assert len(sizings(experiment)) == 33


@pytest.mark.slow
def test_the_48_settings_on_a_small_part(experiment):
    found = {(s.name, s.shape): result for s, result in measured(experiment).items() if not s.limited}
    for name, share in matching_published.ASSIGNED.items():
        if name[0] == "E":
            assert found[name, "square"].assigned == pytest.approx(share, abs=1.0), name
    returned = [found[size, "square"].returned for size in SIZES]
    assert returned[0] < 95 and max(returned) > 98


@pytest.mark.parametrize("radiometry", [CLEAN, NOISY], ids=["clean", "noise"])
def test_the_cascade_beats_the_published_recipe(experiment, radiometry):
    found = strategies(experiment, radiometry)
    best, printed = found["cascade 27 (1.2 px) -> 27 -> 17 (0.6 px)"], found["published recipe, square 27"]
    assert set(found) == set(STRATEGIES)
    assert best.correct > 97.0 and best.correct > printed.correct
    assert best.blunder_share < 0.5


def test_dense_surfaces_are_more_precise_than_semi_global_matching(texture):
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in dense_page(texture, QUICK_WINDOW)[2:]]
    precision = {(row[0], row[1]): float(row[6]) for row in rows}
    for pair in ("clean", "noise"):
        assert precision["pyramid, window 15", pair] * 2 < precision["cv2.StereoSGBM, 3-way, block 5", pair]


def test_semi_global_peer_finds_a_known_shift():
    left = np.random.default_rng(1).integers(1, 255, (60, 200)).astype(np.uint8)
    right = np.roll(left, -9, axis=1)
    found = semi_global_opencv(left, right, 2, 30)
    assert np.nanmedian(found[:, 60:190]) == pytest.approx(9.0, abs=0.1)


def test_readings_differ_in_the_gradients_alone():
    for shape in (Square(), Ellipse()):
        printed, other = published(9, shape, limited=False), reading(9, shape, "whole_pixels")
        assert other.formulation.gradients == "whole_pixels" != printed.formulation.gradients
        assert other.model_copy(update={"formulation": printed.formulation}) == printed


def test_more_contrast_keeps_the_local_mean_and_the_largest_difference_is_found():
    image = ground_texture().pixels[:400, :400]
    assert np.array_equal(with_contrast(image, 1.0), image)
    darker = with_contrast((image // 4 + 90).astype(np.uint8), 2.0).astype(float)
    assert 1.6 * (image // 4).std() < darker.std() < 2.0 * (image // 4).std()
    assert darker.mean() == pytest.approx((image // 4 + 90).mean(), abs=1.0)
    rows = {
        size: Score(100, 100.0, row.returned, 100 * row.blunders / matching_published.TESTED, row.correct, (0.0, 0.0, 0.0))
        for size, row in matching_published.SQUARES.items()
    }
    rows[11] = replace(rows[11], returned=rows[11].returned - 3.0)
    assert differences(rows, matching_published.SQUARES)["returned"] == (11, pytest.approx(-3.0))


def test_two_workers_find_what_one_finds(texture):
    rows = [line.split("|") for line in workers_page(texture, QUICK_WINDOW)[3:]]
    assert rows and all(row[4].strip() == "yes" for row in rows)
