"""What is said of a planned block, word for word where words matter; and what is said where little is known."""

import re
import time
from pathlib import Path

import numpy as np
import pytest

from orthomill.pipeline.storage.image_files import read_header
from orthomill.schemas.camera import Cameras
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.flight_outlook import expected_of
from orthomill.tasks.orientation.planned.flight_sentences import expected_flight
from orthomill.tasks.orientation.planned.object_views import UNKNOWN_VIEWS, views_of_object
from orthomill.tasks.orientation.planned.planned_block import planned_block
from tests.support.scenes.planned_flights import CAMERA, GPS, HEIGHT, RTK, serpentine

ORIGIN = np.array([400000.0, 5000000.0, 250.0])
ABOVE = np.array([0.0, 0.0, HEIGHT])
SHARED = Path(__file__).parents[4] / "shared" / "data"


def photos(places: np.ndarray, headings=None, sigma=GPS, **given) -> Photos:
    """Photographs at places, half a minute apart, 100 m above the place of take-off."""
    known = {"fix": "fixed" if sigma == RTK else None, "position_sigma": sigma, "relative_height": HEIGHT, **given}
    return Photos(
        photos=tuple(
            Photo(
                name=f"p{i:04}",
                path=f"p{i:04}.jpg",
                width=4000,
                height=3000,
                bands=3,
                dtype="uint8",
                camera="cam",
                position=tuple(place),
                attitude=None if headings is None else (0.0, 0.0, float(headings[i])),
                **known,
            )
            for i, place in enumerate(np.asarray(places, float) + ORIGIN)
        )
    )


def said(photos: Photos, control: np.ndarray | None = None):
    cameras = Cameras(cameras={"cam": CAMERA}, of_photo={photo.name: "cam" for photo in photos.photos})
    return expected_flight(photos, cameras, control)


def lengths(sentence: str) -> list[float]:
    """All lengths of a sentence, m."""
    return [float(n) * (1.0 if unit == "m" else 0.001) for n, unit in re.findall(r"([\d.]+) (m|mm)\b", sentence)]


def test_a_nadir_grid_can_bend_and_five_points_stop_it():
    found = said(photos(*serpentine(4, 6)))
    assert found.pattern == (
        "Flight: a grid of 4 strips, looking straight down, about 100 m above the ground (by the heights above the place of "
        "take-off), overlap 70 % along and 60 % across on flat ground; a pixel is 33 mm on the ground."
    )
    assert found.bend and found.bend.startswith("The ground may come out bent, as a dome or a bowl, by ")
    assert "its views are parallel, all are from one height, the camera is known from tags only" in found.bend
    assert "five control points, at the corners and in the middle, bring heights from " in found.bend
    before, after = lengths(found.bend.split("heights")[1])[:2]
    assert after < 0.1 * before
    assert found.accuracy and found.accuracy.endswith("most of it common to the whole flight; by a simulated adjustment.")


def test_corrected_positions_are_worth_what_they_say():
    plain, corrected = said(photos(*serpentine(4, 6))), said(photos(*serpentine(4, 6), sigma=RTK))
    assert lengths(corrected.accuracy)[0] < 0.05 < 1.0 < lengths(plain.accuracy)[0]
    assert "positions have no corrections" not in corrected.bend and "common" not in corrected.accuracy


def test_control_that_exists_counts():
    places, headings = serpentine(4, 6)
    control = np.array([(60, 75, 0), (5, 5, 0), (115, 5, 0), (5, 145, 0), (115, 145, 0)]) + ORIGIN
    with_it = said(photos(places, headings), control)
    assert lengths(with_it.accuracy)[1] < 0.2 and "there is no control" not in with_it.bend
    assert "control point" not in with_it.bend.partition("What helps")[2]


def test_a_height_that_no_tag_tells_is_said_to_be_guessed():
    found = said(photos(*serpentine(4, 6, forward=0.75), relative_height=None))
    assert (
        "about 100 m above the ground (guessed from an overlap of 75 % along the flight, for the tags do not tell it)"
        in found.pattern
    )
    assert "% along and" not in found.pattern


def test_oblique_views_tell_the_height():
    angle = np.arange(24) * 15.0
    circle = np.column_stack([70 * np.cos(np.radians(angle)), 70 * np.sin(np.radians(angle)), np.full(24, HEIGHT)])
    shot = photos(circle, relative_height=None)
    lean = np.degrees(np.arctan2(70, HEIGHT))
    views = []
    for photo, a in zip(shot.photos, np.radians(angle), strict=True):
        # Looks inwards: against the direction from the middle.
        inwards = np.array([-np.cos(a) * 70, -np.sin(a) * 70, -HEIGHT]) / np.hypot(70, HEIGHT)
        omega, phi = np.degrees(np.arctan2(inwards[1], -inwards[2])), np.degrees(np.arcsin(-inwards[0]))
        views.append(photo.model_copy(update={"attitude": (float(omega), float(phi), 0.0)}))
    found = said(Photos(photos=tuple(views)))
    assert found.pattern.startswith(
        f"Flight: a circle, looking {lean:.0f} degrees off the vertical, about 100 m above the ground (where the views meet)"
    )
    assert "its views are parallel" not in found.bend


@pytest.mark.parametrize("count", [0, 1])
def test_without_two_places_nothing_is_foreseen(count):
    few = photos(np.tile(ABOVE, (count, 1)))
    assert said(few).lines == (
        (f"Flight: unknown without positions; pattern, overlap and accuracy cannot be foreseen. {UNKNOWN_VIEWS}",)
        if not count
        else ("Flight: all positions are one place, so that pattern, overlap and accuracy cannot be foreseen.",)
    )


def test_positions_in_one_place_are_told_as_such():
    one = photos(np.tile((0, 0, HEIGHT), (12, 1)))
    assert "all positions are one place" in said(one).pattern
    assert "all positions are one place" in said(photos(np.arange(36).reshape(12, 3) * (0.0, 0.0, 1.0))).pattern


def test_a_drone_that_hovers_is_in_one_place():
    hovering = np.random.default_rng(1).normal(0, 0.5, (12, 3)) + ABOVE
    assert "all positions are one place" in said(photos(hovering)).pattern


def test_a_walk_about_a_tree_with_a_phone_tells_nothing_of_a_flight():
    """Its positions scatter by less than they are uncertain: a height guessed from their distances would be a guess from errors."""
    walk = np.random.default_rng(1).normal(0, 3.0, (23, 3)) + ABOVE
    found = said(photos(walk, sigma=(8.0, 8.0, 12.0), relative_height=None))
    assert "closer together than their standard errors" in found.pattern
    assert found.bend is None and found.accuracy is None
    assert "about" in said(photos(10 * walk, sigma=(8.0, 8.0, 12.0), relative_height=None)).pattern


def test_level_photographs_show_no_flat_ground():
    level = photos(np.arange(8)[:, None] * (5.0, 0.0, 0.0))
    walls = Photos(photos=tuple(photo.model_copy(update={"attitude": (90.0, 0.0, 0.0)}) for photo in level.photos))
    assert said(walls).lines == (
        "The photographs look 90 degrees off the vertical, at walls and not at the ground: what their block lets expect is not "
        "foreseen. The photographs show one wall: its surface and orthoimage are made on its plane (grid: {kind: plane}; "
        "docs/guide.md, 'A facade from its photographs alone'); measured distances or control points give the scale.",
    )


@pytest.mark.parametrize(("inwards", "lean"), [(1.0, 90.0), (1.0, 50.0), (-1.0, 90.0), (1.0, 10.0)])
def test_views_from_all_sides_that_meet_show_an_object(inwards, lean):
    """Not a panorama from one place, and not the vertical views of an orbit."""
    angle = np.radians(np.arange(12) * 30.0)
    outwards = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(12)])
    axes = np.column_stack([-inwards * np.sin(np.radians(lean)) * outwards[:, :2], np.full(12, -np.cos(np.radians(lean)))])
    told = views_of_object(5.0 * outwards, axes)
    if inwards > 0.0 and lean > 25.0:
        assert told and told.startswith("The views meet at an object from all sides") and "mesh of another program" in told
    else:
        assert told is None


def test_photographs_that_do_not_overlap_are_told_as_such():
    found = said(photos(np.array([(0, 0, HEIGHT), (0, 1000, HEIGHT), (0, 2000, HEIGHT)])))
    assert found.accuracy == "Expected accuracy: unknown; the photographs hardly overlap."


def test_a_thousand_photographs_take_seconds_and_the_part_is_told():
    said(photos(*serpentine(2, 4)))  # kernels are loaded
    many = photos(*serpentine(25, 40))
    started = time.process_time()
    found = said(many)
    assert time.process_time() - started < 5.0
    assert "a grid of 25 strips" in found.pattern and "by the 60 photographs in the middle" in found.accuracy


def test_photographs_without_positions_do_not_matter_to_the_rest():
    placed = photos(*serpentine(4, 6))
    lost = tuple(photo.model_copy(update={"position": None}) for photo in placed.photos[:2])
    block = planned_block(
        Photos(photos=(*lost, *placed.photos[2:])), Cameras(cameras={"cam": CAMERA}, of_photo=dict.fromkeys(placed.names, "cam"))
    )
    assert block is not None and len(block.centre) == 22


def test_without_a_place_on_the_earth_one_line_says_so():
    assert expected_of((), None).lines == (
        f"No positions in the tags: pattern, overlap and accuracy of the flight cannot be foreseen. {UNKNOWN_VIEWS}",
    )


@pytest.mark.parametrize(
    ("folder", "crs", "words"),
    [
        (
            "brighton",
            "EPSG:32615",
            ("a grid of 3 strips", "about 40 m above", "positions have no corrections", "five control points"),
        ),
        (
            "rtk_yard",
            "EPSG:32632",
            ("a grid of 2 strips", "about 44 m above", "overlap 90 % along and 71 % across", "control points"),
        ),
    ],
)
def test_real_flights(folder, crs, words):
    files = sorted((SHARED / folder).glob("*.JPG"))
    if not files:
        pytest.skip(f"{folder} is not beside the repository")
    text = " ".join(expected_of(tuple(map(read_header, files)), crs).lines)
    assert all(word in text for word in words), text
