"""The findings that put a whole project in doubt."""

from types import SimpleNamespace

import pytest

from orthomill.schemas.findings.camera_findings import ConstantContradicted
from orthomill.schemas.findings.contradiction_findings import ConstantOfItsOwn, OffsetAdjusted
from orthomill.schemas.findings.datum_findings import AxesExchanged, BlockBent, NoDatum
from orthomill.tasks.orientation.report.block_doubts import GRAVE, block_doubts


def test_every_grave_finding_has_a_sentence():
    assert len(set(GRAVE)) == len(GRAVE) and all("sentence" in vars(kind) for kind in GRAVE)


def test_the_gravest_comes_first_and_a_block_without_findings_has_no_doubts():
    exchanged, nothing = AxesExchanged.model_construct(), NoDatum.model_construct()
    assert GRAVE.index(type(nothing)) < GRAVE.index(type(exchanged))
    facts = SimpleNamespace(control=SimpleNamespace(findings=()), precision=SimpleNamespace(findings=()))
    assert list(block_doubts(facts)) == []


def test_a_guessed_constant_that_the_block_found_is_no_doubt():
    found = ConstantContradicted(camera="cam", given_px=800.0, adjusted_px=1597.4, sigma_px=12.3, fixed=False, guessed=True)
    for finding, count in (
        (found, 0),
        (found.model_copy(update={"fixed": True}), 1),
        (found.model_copy(update={"guessed": False}), 1),
    ):
        facts = SimpleNamespace(control=SimpleNamespace(findings=()), precision=SimpleNamespace(findings=(finding,)))
        assert len(list(block_doubts(facts))) == count


@pytest.mark.parametrize(
    ("change", "doubts"),
    [({}, 0), ({"offset": (None, None, 15.1)}, 1), ({"zoom": 1.1}, 1), ({"against": "control"}, 1), ({"stated": None}, 1)],
)
def test_an_offset_as_large_as_stated_puts_nothing_in_doubt(change, doubts):
    known = {"photos": ("a", "b"), "against": "others", "offset": (0.2, 1.16, None), "sigma": (0.1, 0.1, None)}
    found = OffsetAdjusted(**(known | {"tilt_deg": 0.1, "moved_m": 0.4, "stated": (3.0, 3.0, 5.0)} | change))
    facts = SimpleNamespace(control=SimpleNamespace(findings=()), precision=SimpleNamespace(findings=(found,)))
    assert len(list(block_doubts(facts))) == doubts


def test_a_camera_constant_that_no_tag_tells_comes_before_the_bend_that_is_left():
    zoom = ConstantOfItsOwn(photos=("a", "b"), camera="cam", c_px=702.0, others_px=468.0)
    assert GRAVE.index(ConstantOfItsOwn) < GRAVE.index(OffsetAdjusted) < GRAVE.index(BlockBent)
    facts = SimpleNamespace(control=SimpleNamespace(findings=()), precision=SimpleNamespace(findings=(zoom,)))
    (told,) = block_doubts(facts)
    assert "1.5 times the camera constant" in told
