"""The workflow file: found, read, checked as a whole, and written back with every default filled in.

Reading takes three steps: text to plain data with line numbers (yaml_lines), plain data to models (tagged unions over `kind`, of
the project's schema and the catalogue passed in), and the checks that span several settings (workflow_checks). A step that fails
for one part of the file does not prevent the others from being checked: all mistakes are reported together.
"""

import os
from dataclasses import dataclass
from functools import reduce
from operator import or_
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, TypeAdapter, ValidationError

from orthomill.pipeline.storage.file_names import shown
from orthomill.pipeline.storage.photographs.folder_listing import image_files
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.pipeline.workflow.mistakes import Mistakes, nearest, renamed_sentences, stage_kind
from orthomill.pipeline.workflow.workflow_checks import Kinds, check_crs, check_files, check_sources, check_stages, kind_of
from orthomill.pipeline.workflow.workflow_text import workflow_text
from orthomill.pipeline.workflow.yaml_lines import SIZE_LIMIT, Document, YamlError, read_yaml
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.project import Project
from orthomill.schemas.settings import RenamedSettings
from orthomill.schemas.stage_contract import Stage

__all__ = ["LoadedWorkflow", "image_files", "load_workflow", "project_root", "resolve_workflow", "write_workflow"]

_SUFFIXES = (".yaml", ".yml")
_PLACEHOLDERS = {"project": "unknown", "crs": "unknown", "photographs": {"kind": "folder", "path": "."}}
"""For required fields with mistakes of their own, so that the rest of the project can still be checked."""


@dataclass(frozen=True)
class LoadedWorkflow:
    """A workflow without mistakes. All its paths are relative to `root`."""

    project: Project
    stages: tuple[Stage, ...]
    path: Path
    root: Path
    text: str
    notes: tuple[str, ...] = ()
    """what is to be changed in the file although it works: one sentence each, with its place"""

    @property
    def run_folder(self) -> Path:
        """Where the results go."""
        return self.root / "runs" / self.project.project


def resolve_workflow(name_or_path: str, cwd: Path) -> Path:
    """The file of a workflow: "volos" is workflows/volos.yaml below `cwd`; anything with a suffix or a slash is a path.

    Raises WorkflowError with the nearest names when there is none.
    """
    # A name with a slash or a suffix is a path: "volos" must mean the project even where a folder of that name exists.
    if "/" in name_or_path or name_or_path.endswith(_SUFFIXES):
        candidates = [cwd / name_or_path]
    else:
        candidates = [cwd / "workflows" / f"{name_or_path}{suffix}" for suffix in _SUFFIXES]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    raise WorkflowError(_not_found(candidates[0]))


def _not_found(path: Path) -> str:
    folder = path.parent
    files = sorted(file for file in folder.iterdir() if file.suffix in _SUFFIXES) if folder.is_dir() else []
    if not files:
        return (
            f"There is no workflow {shown(path)}, and {shown(folder)} contains no workflow files; "
            "write one with 'orthomill init NAME --photos DIR'."
        )
    names = [file.stem for file in files]
    near = nearest(path.stem, names)
    meant = f"; did you mean '{near}'?" if near else "."
    return f"There is no workflow {shown(path)}{meant} Workflows here: {', '.join(names)}."


def project_root(path: Path) -> Path:
    """The folder that all paths of a workflow are relative to.

    The parent of the folder `workflows` that contains the file; for the workflow as run, in runs/<project>, the parent of `runs`;
    otherwise the file's own folder.
    """
    # The workflow as run is in runs/<project>/ and has the same root: running it again must find the same photographs.
    folder = Path(os.path.abspath(path)).parent
    if folder.name == "workflows":
        return folder.parent
    return folder.parent.parent if folder.parent.name == "runs" else folder


def load_workflow(path: Path, catalogue: tuple[type[Stage], ...]) -> LoadedWorkflow:
    """Read and check a workflow file. Raises WorkflowError with all its mistakes, one a line."""
    root, text = project_root(path), _read_text(path)
    try:
        document = read_yaml(text)
    except YamlError as error:
        raise WorkflowError(f"{_name(path, root)}:{error.line}: {error.sentence}.") from None
    mistakes, renamed = Mistakes(_name(path, root), document), RenamedSettings()
    for place, line, first in document.repeated:
        mistakes.add(place, f"is already set in line {first}; set it once.", line)
    project = _project(document, mistakes, root, renamed)
    kinds = _kinds(document, catalogue)
    stages = _stages(document, catalogue, mistakes, root, renamed)
    check_stages(kinds, catalogue, mistakes)
    check_sources(project, kinds, catalogue, mistakes)
    # Raised only here, after all checks: a user who corrects one mistake at a time runs the command as often.
    mistakes.raise_if_any()
    return LoadedWorkflow(project, stages, Path(path), root, text, renamed_sentences(renamed, mistakes))


def _name(path: Path, root: Path) -> str:
    return Path(os.path.relpath(os.path.abspath(path), root)).as_posix()


def _read_text(path: Path) -> str:
    try:
        # Editors on Windows begin a file with a byte order mark, which YAML would take for a part of the first name.
        with open(path, encoding="utf-8-sig") as file:
            return file.read(SIZE_LIMIT + 1)
    except UnicodeDecodeError as error:
        raise WorkflowError(f"{shown(path)} is not UTF-8 text ({error.reason}); save it as UTF-8.") from error
    except OSError as error:
        raise WorkflowError(f"The workflow {shown(path)} cannot be read ({error.strerror}).") from error


def _project(document: Document, mistakes: Mistakes, root: Path, renamed: RenamedSettings) -> Project:
    if not isinstance(document.value, dict):
        names = ", ".join(Project.model_fields)
        mistakes.add((), f"a workflow is a mapping with the settings {names} and stages, but this file is not a mapping.")
        mistakes.raise_if_any()
    given = {name: value for name, value in document.value.items() if name != "stages"}
    try:
        project, wrong = Project.model_validate(given, context=renamed), frozenset[str]()
    except ValidationError as error:
        mistakes.add_all(error, Project, ())
        wrong = frozenset(str(detail["loc"][0]) for detail in error.errors())
        project = Project.model_validate(_PLACEHOLDERS | {name: value for name, value in given.items() if name not in wrong})
    _check_project(project, wrong, root, mistakes)
    return project


def _check_project(project: Project, wrong: frozenset[str], root: Path, mistakes: Mistakes) -> None:
    if "crs" not in wrong:
        check_crs(project.crs, project.photographs, root, mistakes)
    for name in ("photographs", "cameras", "positions", "control"):
        if name not in wrong:
            check_files(getattr(project, name), (name,), root, mistakes)


def _stages(
    document: Document, catalogue: tuple[type[Stage], ...], mistakes: Mistakes, root: Path, renamed: RenamedSettings
) -> tuple[Stage, ...]:
    items = document.value.get("stages")
    names = ", ".join(kind_of(stage) for stage in catalogue)
    if not isinstance(items, list) or not items:
        problem = "is missing" if "stages" not in document.value else "is empty" if not items else "is not a list"
        mistakes.add(
            ("stages",),
            f"{problem}; a workflow lists at least one stage, each as '- kind: <stage>' with its settings "
            f"below. The stages are: {names}.",
        )
        return ()
    union = stage_union(catalogue)
    stages = [_stage(index, item, union, mistakes, root, renamed) for index, item in enumerate(items)]
    return tuple(stage for stage in stages if stage is not None)


def stage_union(catalogue: tuple[type[Stage], ...]) -> Any:
    """The catalogue as a union over `kind`."""
    union = reduce(or_, catalogue)
    # pydantic refuses a discriminator on a union of one.
    return Annotated[union, Field(discriminator="kind")] if len(catalogue) > 1 else union


def _kinds(document: Document, catalogue: tuple[type[Stage], ...]) -> Kinds:
    """The known stages that the file lists, whether or not their settings are right."""
    items = document.value.get("stages")
    known = {kind_of(stage) for stage in catalogue}
    claims = [(index, stage_kind(document, index)) for index in range(len(items) if isinstance(items, list) else 0)]
    return Kinds(tuple((index, kind) for index, kind in claims if kind in known))


def _stage(index: int, item: Any, union: Any, mistakes: Mistakes, root: Path, renamed: RenamedSettings) -> Stage | None:
    try:
        stage: Stage = TypeAdapter(union).validate_python({"kind": item} if isinstance(item, str) else item, context=renamed)
    except ValidationError as error:
        mistakes.add_all(error, union, ("stages", index))
        return None
    check_files(stage, ("stages", index), root, mistakes)
    return stage


def write_workflow(loaded: LoadedWorkflow, path: Path) -> None:
    """Write the workflow as run: every default filled in, every line with its sentence. Loading it gives equal models.

    Raises StoreError when the file cannot be written.
    """
    head = f"# The workflow {loaded.path.name} as run, every default filled in. Running this file reproduces the run.\n\n"
    write_whole(path, (head + workflow_text(loaded.project, loaded.stages)).encode())
