"""The workflow of an inspection: photographs with the block of another program, and surveyed points with their marks in them.

`orthomill accept --dsm --ortho --photos --block --points --marks` runs it to the orientation, which takes the block as it is, and
then tests the products of the other program at the points as it would with a project of its own.
"""

from pathlib import Path

from pydantic import ValidationError

from orthomill.pipeline.cli.check_surface import CheckOptions, block_workflow, check_name, relative_to
from orthomill.pipeline.storage.file_names import shown
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.stage_contract import Stage


def inspection_workflow(
    product: Path,
    seen: tuple[Path | None, Path | None],
    given: tuple[Path | None, Path | None],
    crs: str | None,
    root: Path,
    catalogue: tuple[type[Stage], ...],
) -> LoadedWorkflow:
    """The workflow with results in runs/accept-<product> below `root`; seen: folder of the photographs, their block; given: the
    files of the points and of their marks. Raises WorkflowError with one sentence."""
    (photos, block), (points, marks) = seen, given
    if photos is None or block is None:
        raise WorkflowError(
            "--photos and --block belong together: an orientation made here would be tested with its own photographs."
        )
    if points is None:
        raise WorkflowError("Give the surveyed points with --points, and their marks in the photographs with --marks.")
    for path, what in ((points, "points"), (marks, "marks")):
        if path is not None and not path.is_file():
            raise WorkflowError(f"There are no {what} {shown(path)}; correct the path.")
    files = {"points": points, "measurements": marks} if marks else {"points": points}
    control = {"kind": "files", **{key: relative_to(path, root) for key, path in files.items()}}
    name = check_name(product).replace("check", "accept", 1)
    try:
        options = CheckOptions(photos=photos, block=block, crs=crs)
        return block_workflow(name, product, options, {"control": control}, root, catalogue)
    except ValidationError as error:
        raise WorkflowError("; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors()) + ".") from error
