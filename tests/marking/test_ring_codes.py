"""Dots with a code on a ring: decoded as they were drawn, and not where there are none."""

import cv2
import numpy as np
import pytest

from benchmarks.marking.drawn_targets import drawn, word_segments
from orthomill.tasks.targets.coded_targets import coded_targets
from orthomill.tasks.targets.photo_targets import photo_targets
from orthomill.tasks.targets.ring_code_words import least_rotation, word_numbers
from orthomill.tasks.targets.ring_coded_dots import ring_coded_dots


def as_photograph(picture):
    return np.clip(picture, 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("segments", "count", "first"), [(12, 147, 0b000001000001), (14, 516, 0b00000010000001)])
def test_words_are_those_of_the_patent(segments, count, first):
    numbers = word_numbers(segments)
    assert len(numbers) == count and numbers[first] == 1 and sorted(numbers) == list(numbers)
    for word in list(numbers)[::7]:
        bits = word_segments(word, segments)
        assert bits.sum() % 2 == 0 and (bits & np.roll(bits, segments // 2)).any()
        assert {least_rotation(np.roll(bits, turn)) for turn in range(segments)} == {word}


@pytest.mark.parametrize("kind", ["ring12", "ring14"])
def test_codes_that_lean_and_are_blurred_have_their_number_and_centre(kind):
    rng = np.random.default_rng(8)
    ratios = []
    for number in rng.integers(1, len(word_numbers(int(kind[4:]))) + 1, 12):
        picture, centre = drawn(kind, rng, int(number))
        for found in ring_coded_dots(as_photograph(picture)):
            assert found.name == f"{kind}-{number}"
            ratios.append((found.place - centre) / found.sigma)
    # Small ones, with dots of 4 to 6 px, may fit two grids: then they are none.
    assert len(ratios) >= 10
    assert np.sqrt(np.mean(np.square(ratios))) < 1.6


def test_white_codes_on_black_are_the_same_and_mirrored_ones_are_not():
    picture, centre = drawn("ring12", np.random.default_rng(1), 8)
    plain, white = as_photograph(picture), as_photograph(255 - picture)
    assert [one.name for one in ring_coded_dots(white)] == [one.name for one in ring_coded_dots(plain)] == ["ring12-8"]
    (one,) = (one for one in photo_targets(picture) if np.hypot(*(centre - one.place)) < 12)
    assert one.kind == "coded", "its dot is no circle beside it"
    assert [one.name for one in ring_coded_dots(np.ascontiguousarray(plain[:, ::-1]))] != ["ring12-8"]


def test_a_number_that_shows_twice_is_no_point():
    picture = as_photograph(drawn("ring14", np.random.default_rng(2), 30)[0])
    assert coded_targets(np.hstack([picture, picture])) == []
    assert [one.name for one in coded_targets(picture)] == ["ring14-30"]


def test_a_covered_segment_or_a_line_through_the_border_hides_the_code():
    picture, centre = drawn("ring12", np.random.default_rng(1), 8)
    plain = as_photograph(picture)
    (found,) = ring_coded_dots(plain)
    # A stripe of a middle grey over a part of the ring, and a dark one across the border.
    for grey, reach in ((130, 0.85), (20, 1.2)):
        covered = plain.copy()
        col, row = np.round(centre - np.array([0.0, reach * found.radius])).astype(int)
        cv2.rectangle(covered, (col - 7, row - 2), (col + 7, row + 2), grey, -1)
        assert ring_coded_dots(covered) == []


def test_dots_rings_and_spots_are_no_codes():
    rng = np.random.default_rng(4)
    for number in range(60):
        ground = cv2.GaussianBlur(rng.normal(0, 1, (160, 160)).astype(np.float32), (0, 0), rng.uniform(0.8, 6.0))
        image = as_photograph(128 + 70 * ground / ground.std())
        for _ in range(6):
            place = tuple(int(n) for n in rng.integers(30, 130, 2))
            cv2.circle(image, place, int(rng.integers(5, 25)), int(rng.integers(0, 255)), -1 if number % 2 else 4, cv2.LINE_AA)
        assert ring_coded_dots(cv2.GaussianBlur(image, (0, 0), 0.8)) == []


def test_ground_without_light_and_shadow_has_no_targets():
    assert photo_targets(np.full((90, 90), 120.0, np.float32)) == ()
    faint = 120.0 + 2.0 * np.sin(np.arange(90) / 3.0).astype(np.float32)
    assert photo_targets(faint[:, None] + faint[None]) == ()
