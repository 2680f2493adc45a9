"""The project that a command names, in the folder where the user stands."""

from pathlib import Path

from rich.markup import escape

from orthomill.pipeline.cli.terminal import err
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow, load_workflow, resolve_workflow
from orthomill.tasks.catalogue import STAGES


def load_project(name: str) -> LoadedWorkflow:
    """The workflow of a project; what is to be changed in it is said. Raises WorkflowError for one that does not exist or has
    mistakes."""
    loaded = load_workflow(resolve_workflow(name, Path.cwd()), STAGES)
    for note in loaded.notes:
        err.print(f"[yellow]note:[/yellow] {escape(note)}", soft_wrap=True)
    return loaded
