"""What is said of outputs that show little: what, where, what to do."""

import numpy as np
import pytest

from orthomill.schemas.solid.census import MeshCensus
from orthomill.schemas.solid.frames import CylinderFrame, FlatFrame
from orthomill.tasks.colouring.blending.colour_sums import ColourSums
from orthomill.tasks.projection.frames.seen_planes import degrees_before
from orthomill.tasks.projection.report.output_doubts import output_doubts
from orthomill.tasks.projection.report.output_totals import OutputFacts, OutputTotals
from orthomill.tasks.projection.tiles.output_colours import ProjectionTile

FRONT = FlatFrame(
    name="front",
    rows=30,
    cols=40,
    corner=(-2.0, 0.0, 3.0),
    right=(1.0, 0.0, 0.0),
    up=(0.0, 0.0, 1.0),
    normal=(0.0, -1.0, 0.0),
    pixel=0.1,
)
CENSUS = MeshCensus(
    vertices=9, triangles=8, read=8, median_edge=1.0, origin=(0.0, 0.0, 0.0), low=(-2.0, 0.0, 0.0), high=(2.0, 0.0, 3.0)
)


def said(surface=1200, coloured=0, backs=0, before=45.0, cut=False, only=None) -> str:
    none = ColourSums(seen=(0, 0, 0, 0), rejected=0, values=0, difference_sum=0.0, difference_count=0, shares={})
    tile = ProjectionTile(pixels=1200, surface=surface, colours=none, coloured=coloured, backs=backs, zone=0, sights={})
    totals = OutputTotals(OutputFacts(FRONT, 1, 0.1, before, cut, only), (tile,))
    return " ".join(output_doubts(CENSUS, [totals]))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"before": 4.2}, "The plane of 'front' is seen edge-on, at most 4 degrees from its front: only 0 % of its surface"),
        ({"before": -31.0}, "edge-on, from its back, by 31 degrees and more"),
        ({"coloured": 240}, "Only 20 % of the surface in 'front' is seen by a photograph"),
        ({"backs": 900}, "75 % of the surface in 'front' shows its back"),
        ({"surface": 0}, "its plane, cylinder or view passes it by; the surface reaches from (-2, 0, 0) to (2, 0, 3)"),
        ({"only": "b"}, "b sees nothing of the surface in 'front', which is empty. Name another photograph."),
        ({"surface": 0, "cut": True}, "its section removes all that would be in the picture"),
    ],
)
def test_an_output_that_shows_little_is_a_sentence(given, words):
    assert words in said(**given)


def test_an_output_with_colours_is_not_doubted():
    assert said(coloured=1100, before=3.0) == ""
    assert said(coloured=100, only="b") == "", "one photograph has holes where it sees nothing"


def test_degrees_before_a_plane_are_those_of_the_best_photograph_and_place():
    assert degrees_before(FRONT, [(0.0, -5.0, 1.5), (0.0, 9.0, 1.5)]) == pytest.approx(90.0)
    assert degrees_before(FRONT, [(9.0, -1.0, 3.0)]) == pytest.approx(np.degrees(np.arctan(1 / 7))), "from the near corner"
    assert degrees_before(FRONT, [(0.0, 5.0, 1.5)]) < -60.0
    column = CylinderFrame(
        name="c",
        rows=4,
        cols=4,
        foot=(0.0, 0.0, 0.0),
        axis=(0.0, 0.0, 1.0),
        middle=(1.0, 0.0, 0.0),
        radius=1.0,
        reach=0.5,
        top=2.0,
        outside=True,
        pixel=0.1,
    )
    assert degrees_before(column, [(0.0, 5.0, 1.5)]) == 90.0
