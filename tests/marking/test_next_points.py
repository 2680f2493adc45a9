"""Where another point helps: against the block that has one there."""

import json
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest

from benchmarks.marking.simulated_marks import simulated_block, simulated_marks
from orthomill.pipeline.serving.marking.field_files import GEOJSON, GPX, next_point_files
from orthomill.schemas.marks import Mark, MarkedPoint, Marks, NextPoint
from orthomill.tasks.marking.belief import Belief
from orthomill.tasks.marking.next_points import SURVEYED, next_points, seen_places
from orthomill.tasks.marking.target_points import belief_views

BLOCK = simulated_block(2, 5, seed=8, position_sigma=1.0)


def surveyed(belief: Belief, xyz) -> MarkedPoint:
    """A point there, marked wherever it is seen."""
    marks = {}
    for view in belief_views(belief):
        pixel = view.project(np.array([xyz]))[0]
        if view.contains(pixel[None], 120.0)[0]:
            marks[view.name] = Mark(col=float(pixel[0]), row=float(pixel[1]), sigma=0.5)
    return MarkedPoint(name="new", xyz=xyz, sigma=SURVEYED, marks=marks)


def test_what_a_point_gains_is_what_the_block_with_it_has():
    first = next_points(BLOCK.belief, Marks())[0]
    point = surveyed(BLOCK.belief, first.xyz)
    assert len(point.marks) == first.photographs
    after = next_points(BLOCK.belief, Marks(points=(point,)))[0]
    # Its marks also check each other, which the plan leaves out.
    assert after.before == pytest.approx(first.after, rel=0.05) and after.before <= first.after
    assert first.after < first.before


def test_points_are_asked_for_until_a_check_point_is_left():
    found = next_points(BLOCK.belief, simulated_marks(BLOCK, 1, points=2))
    assert [one.role for one in found] == ["control", "control", "control", "check"]
    assert all(one.after <= one.before for one in found)
    assert all(later.before == pytest.approx(one.after) for one, later in pairwise(found))
    # The second one lies elsewhere: the first has said what there is to say of its place.
    assert np.linalg.norm(np.subtract(found[0].xyz, found[1].xyz)) > 5.0


def test_no_place_is_asked_for_twice():
    found = [one for one in next_points(BLOCK.belief, Marks(), 12) if one.role == "control"]
    assert len({one.xyz for one in found}) == len(found) == 12


def test_all_places_are_seen_by_two():
    places = seen_places(BLOCK.belief)
    assert len(places.place) > 20 and places.seen.min() >= 2 and len(places.moves) == 3 * len(places.place)


def test_the_field_gets_degrees():
    found = (
        NextPoint("control", (500000.0, 5000000.0, 300.0), 7, 0.2, 0.1),
        NextPoint("check", (500100.0, 5000000.0, 300.0), 5, 0.1, 0.1),
    )
    files = next_point_files(found, "EPSG:32632+4979")
    features = json.loads(files[GEOJSON])["features"]
    assert features[0]["geometry"]["coordinates"] == pytest.approx((9.0, 45.1535), abs=1e-3)
    assert "falls from 0.200 to 0.100 m" in features[0]["properties"]["sentence"]
    points = list(ElementTree.fromstring(files[GPX]))
    assert [point.attrib["lat"][:5] for point in points] == ["45.15", "45.15"]
    assert points[1][0].text == "check2"
