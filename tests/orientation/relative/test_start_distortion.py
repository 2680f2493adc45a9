"""The rough distortion of a wide lens: tried where matches fit no relative orientation, and taken only where it makes them fit.

On the four photographs of `uav_reference` (k1 = -0.26, overlaps of a third at the borders) it is the difference between attitudes
that are 9 degrees wrong and 0.3 degrees.
"""

import pytest

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.orientation import RelativeOrientation
from orthomill.tasks.orientation.relative.start_distortion import start_distortion

PAIRS = (("a", "b"), ("b", "c"), ("a", "c"))


def cameras(source="exif"):
    camera = Camera(name="wide", width=1368, height=912, c=912.0, source=source)
    return Cameras(cameras={"wide": camera}, of_photo=dict.fromkeys("abc", "wide"))


def relating(kept_by_k1, asked=None):
    """A way of relating pairs that keeps so many of 100 matches with each k1."""

    def relate(own, pairs):
        k1 = own.cameras["wide"].lens.k1
        if asked is not None:
            asked.append(k1)
        kept = kept_by_k1(k1)
        return [RelativeOrientation(left=i, right=j, matches=100, kept=kept, outcome="oriented") for i, j in pairs]

    return relate


def test_the_distortion_with_which_most_matches_fit_is_the_start():
    relate = relating(lambda k1: round(95 - 300 * abs(k1 + 0.14)))
    found = start_distortion(cameras(), relate(cameras(), list(PAIRS)), relate)
    assert found.k1 == {"wide": -0.15} and found.cameras.of("b").lens.k1 == -0.15


def test_nothing_is_tried_where_matches_fit():
    asked = []
    relate = relating(lambda k1: 97, asked)
    assert start_distortion(cameras(), relate(cameras(), list(PAIRS)), relate).k1 == {} and asked == [0.0]


def test_a_distortion_that_explains_little_more_is_not_taken():
    relate = relating(lambda k1: 80 + round(20 * abs(k1)))
    assert start_distortion(cameras(), relate(cameras(), list(PAIRS)), relate).k1 == {}


def test_a_camera_that_only_turned_gets_no_base_from_a_distortion():
    relate = relating(lambda k1: 99)
    turned = [pair.model_copy(update={"outcome": "taken from one place"}) for pair in relate(cameras(), list(PAIRS))]
    assert start_distortion(cameras(), turned, relate).k1 == {}


@pytest.mark.parametrize("source", ["file", "given", "chessboards"])
def test_calibrated_cameras_are_not_touched(source):
    relate = relating(lambda k1: round(95 - 300 * abs(k1 + 0.14)))
    assert start_distortion(cameras(source), relate(cameras(source), list(PAIRS)), relate).k1 == {}


def test_a_lens_that_would_fold_the_corners_back_is_not_tried():
    asked = []
    relate = relating(lambda k1: 50, asked)
    start_distortion(cameras(), relate(cameras(), list(PAIRS)), relate)
    assert min(asked) == -0.15, "the corner lies at 0.90 c, and k1 = -0.2 reaches 0.86 c"
