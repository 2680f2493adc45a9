"""Why a run with a profile of acceptance ends without being held against it."""

from orthomill.pipeline.storage.depots.kept_at import noted
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow


def unjudged(loaded: LoadedWorkflow, until: str | None) -> str:
    """A sentence where products are still to be made or lie elsewhere; empty for a run that can be judged as it ended."""
    profile, name = loaded.project.acceptance.kind, loaded.project.project
    kinds = [stage.kind for stage in loaded.stages]
    missing = kinds[kinds.index(until) + 1 :] if until in kinds else []
    if missing:
        return (
            f"Acceptance by {profile} was not judged: the run ended with {until}, and a delivery needs what follows "
            f"({', '.join(missing)}); run all of it: orthomill run {name}."
        )
    if address := noted(loaded.run_folder):
        return (
            f"Acceptance by {profile} was not judged: the products are kept in {address} and would all be read for that; "
            f"where this is meant: orthomill accept {name}."
        )
    return ""
