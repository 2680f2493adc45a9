"""The project that a command names, in the folder where the user stands."""

from pathlib import Path

from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow, load_workflow, resolve_workflow
from orthomill.tasks.catalogue import STAGES


def load_project(name: str) -> LoadedWorkflow:
    """The workflow of a project. Raises WorkflowError for one that does not exist or has mistakes."""
    return load_workflow(resolve_workflow(name, Path.cwd()), STAGES)
