"""What the records of metadata are told of a run by the engine."""

from pathlib import Path

from orthomill.pipeline.engine.run_facts import read_facts
from orthomill.pipeline.export.metadata.delivered_run import RunRecord
from orthomill.schemas.errors import StoreError


def run_record(folder: Path) -> RunRecord:
    """Of a finished run in `folder`. Raises StoreError before it is finished."""
    facts = read_facts(folder)
    if facts is None or facts.finished is None:
        raise StoreError(f"{folder.name} is not finished; metadata are those of a finished run: orthomill run {folder.name}")
    stages = tuple((stage.kind, stage.seconds, stage.jobs) for stage in facts.stages)
    return RunRecord(facts.project, facts.crs, facts.version, facts.started, facts.finished, facts.workflow, stages)
