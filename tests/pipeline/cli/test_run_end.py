"""The last words of a run at the terminal: few, and none twice."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from orthomill.pipeline.cli.progress.run_end import FAILURES_SHOWN, RunEnd, tell
from orthomill.pipeline.engine.run_facts import Failure, RunFacts, StageRun
from orthomill.pipeline.report.first_page import first_page

STAGES = (("photos", "Photographs"),)


def told(failed: int) -> list[str]:
    failures = tuple(Failure("photos", f"photos/{number}", "The picture is damaged.") for number in range(failed))
    stage = StageRun("photos", jobs=40, done=10, failed=failed)
    facts = RunFacts(
        "site", "EPSG:2100", "0.1.0", "2026-11-21T10:00:00", finished="2026-11-21T11:00:00", stages=(stage,), failures=failures
    )
    out = Console(file=io.StringIO(), width=200)
    tell(RunEnd(facts, Path("runs/site"), first_page({}, STAGES, facts, Path("runs/site"))), out, out)
    return out.file.getvalue().splitlines()


@pytest.mark.parametrize("failed", [1, FAILURES_SHOWN])
def test_failed_jobs_are_told_once(failed):
    lines = told(failed)
    assert sum(line.startswith("failed photos/") for line in lines) == failed
    (verdict,) = (line for line in lines if "omplete" in line)
    assert verdict.startswith("Not complete: ") and verdict.endswith("mend what failed and run the project again.")


def test_a_card_of_damaged_photographs_is_no_page_of_sentences():
    lines = told(30)
    assert sum(line.startswith("failed photos/") for line in lines) == FAILURES_SHOWN
    assert f"... and {30 - FAILURES_SHOWN} more failed; they are in the report." in lines
