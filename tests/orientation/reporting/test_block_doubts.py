"""The findings that put a whole project in doubt."""

from types import SimpleNamespace

import pytest

from orthomill.schemas.findings.camera_findings import ConstantContradicted
from orthomill.schemas.findings.contradiction_findings import ConstantOfItsOwn, OffsetAdjusted, UnitContradicted
from orthomill.schemas.findings.control_findings import HeightsAllZero
from orthomill.schemas.findings.datum_findings import AxesExchanged, BlockBent, NoDatum
from orthomill.schemas.findings.observation_findings import MarksInAnotherFrame
from orthomill.schemas.observations import Control, ControlPoint
from orthomill.tasks.orientation.report.block_doubts import GRAVE, block_doubts

NO_CONTROL = Control()


def facts_of(*findings, control=NO_CONTROL, **factors):
    """A block of which the adjustment found so much, and enlarged standard errors by `factors`."""
    precision = {"findings": findings, "position_factor": 1.0, "control_factor": 1.0, "groups": ()} | factors
    return SimpleNamespace(control=control, precision=SimpleNamespace(**precision))


def test_every_grave_finding_has_a_sentence():
    assert len(set(GRAVE)) == len(GRAVE) and all("sentence" in vars(kind) for kind in GRAVE)


def test_the_gravest_comes_first_and_a_block_without_findings_has_no_doubts():
    exchanged, nothing = AxesExchanged.model_construct(), NoDatum.model_construct()
    assert GRAVE.index(type(nothing)) < GRAVE.index(type(exchanged))
    facts = facts_of()
    assert list(block_doubts(facts)) == []


def test_a_guessed_constant_that_the_block_found_is_no_doubt():
    found = ConstantContradicted(camera="cam", given_px=800.0, adjusted_px=1597.4, sigma_px=12.3, fixed=False, guessed=True)
    for finding, count in (
        (found, 0),
        (found.model_copy(update={"fixed": True}), 1),
        (found.model_copy(update={"guessed": False}), 1),
    ):
        facts = facts_of(finding)
        assert len(list(block_doubts(facts))) == count


@pytest.mark.parametrize(
    ("change", "doubts"),
    [({}, 0), ({"offset": (None, None, 15.1)}, 1), ({"zoom": 1.1}, 1), ({"against": "control"}, 1), ({"stated": None}, 1)],
)
def test_an_offset_as_large_as_stated_puts_nothing_in_doubt(change, doubts):
    known = {"photos": ("a", "b"), "against": "others", "offset": (0.2, 1.16, None), "sigma": (0.1, 0.1, None)}
    found = OffsetAdjusted(**(known | {"tilt_deg": 0.1, "moved_m": 0.4, "stated": (3.0, 3.0, 5.0)} | change))
    facts = facts_of(found)
    assert len(list(block_doubts(facts))) == doubts


def test_a_camera_constant_that_no_tag_tells_comes_before_the_bend_that_is_left():
    zoom = ConstantOfItsOwn(photos=("a", "b"), camera="cam", c_px=702.0, others_px=468.0)
    assert GRAVE.index(ConstantOfItsOwn) < GRAVE.index(OffsetAdjusted) < GRAVE.index(BlockBent)
    facts = facts_of(zoom)
    (told,) = block_doubts(facts)
    assert "1.5 times the camera constant" in told


def test_control_that_the_block_contradicts_is_a_doubt_and_scatter_is_none():
    measured = {"a": (1.0, 1.0, 0.5)}
    point = ControlPoint(name="1", role="control", xyz=(0.0, 0.0, 0.0), sigma=(0.03, 0.03, 0.03), measurements=measured)
    control = Control(points=(point,))
    assert not list(block_doubts(facts_of(control=control, control_factor=2.0)))
    (told,) = block_doubts(facts_of(control=control, control_factor=23.0))
    assert "good to 0.69 m, not the 0.03 m stated" in told
    feet = UnitContradicted(unit="feet", heights_only=True, given_m=300.0, fits_m=0.1)
    assert not any("worse than stated" in told for told in block_doubts(facts_of(feet, control=control, control_factor=23.0)))


def test_how_all_marks_were_read_comes_before_what_was_left_out_of_them():
    left_out = Control(findings=(HeightsAllZero(points=5),))
    read = MarksInAnotherFrame(
        counted="from the lower left corner", change="...", factor=1.0, given_px=300.0, found_px=1.0, points=4
    )
    bent = UnitContradicted(unit="feet", heights_only=True, given_m=300.0, fits_m=0.1)
    assert "are counted from the lower left corner" in next(block_doubts(facts_of(read, control=left_out)))
    assert "height 0" in next(block_doubts(facts_of(bent, control=left_out)))


def test_positions_that_the_block_contradicts_are_a_doubt():
    (told,) = block_doubts(facts_of(position_factor=8.2))
    assert "8.2 times" in told
