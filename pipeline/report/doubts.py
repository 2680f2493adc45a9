"""What a user must know before believing a result: the gravest warnings of all stages, for the end of a run."""

from collections.abc import Iterator
from dataclasses import dataclass

from orthomill.pipeline.engine.run_facts import StageTitle
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.stage_report import report_table


@dataclass(frozen=True)
class Doubt:
    """One grave warning, and the section of the report where it stands."""

    section: str
    sentence: str


def doubts(store: ReadableStore, stages: tuple[StageTitle, ...]) -> Iterator[Doubt]:
    """The grave warnings of the stages that have a report, in their order."""
    for kind, title in stages:
        table = report_table(kind)
        if store.has_table(table):
            yield from (Doubt(title, sentence) for sentence in store.table(table).doubts)
