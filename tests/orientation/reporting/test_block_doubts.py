"""The findings that put a whole project in doubt."""

from types import SimpleNamespace

from orthomill.schemas.findings.block_findings import AxesExchanged, NoDatum
from orthomill.tasks.orientation.reporting.block_doubts import GRAVE, block_doubts
from orthomill.tasks.orientation.reporting.finding_sentences import finding_sentence


def test_every_grave_finding_has_a_sentence():
    assert len(set(GRAVE)) == len(GRAVE) and set(GRAVE) <= set(finding_sentence.registry)


def test_the_gravest_comes_first_and_a_block_without_findings_has_no_doubts():
    exchanged, nothing = AxesExchanged.model_construct(), NoDatum.model_construct()
    assert GRAVE.index(type(nothing)) < GRAVE.index(type(exchanged))
    facts = SimpleNamespace(control=SimpleNamespace(findings=()), precision=SimpleNamespace(findings=()))
    assert list(block_doubts(facts)) == []
