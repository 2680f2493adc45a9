"""The contract between a stage and the engine.

A stage is a pydantic model: its fields are its settings. `plan()` yields raster specifications, jobs and exports. It may ask the
view for a table or a raster that does not exist yet; the view then raises `NotYet`, the engine runs what was yielded so far and
plans the stage again when the thing exists. Planning is therefore repeatable: the same answers give the same jobs.
"""

from collections.abc import Iterator
from typing import ClassVar, Protocol, TypeVar

from orthomill.schemas.job import Export, Job, Table
from orthomill.schemas.project import Photographs, Project
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import Settings

T = TypeVar("T")


class NotYet(Exception):
    """A table or raster that planning asked for has not been made yet. Never shown to a user."""


class ProjectView(Protocol):
    """What a stage may know while it plans."""

    project: Project

    def table(self, table: Table[T]) -> T:
        """The value of a finished table. Raises NotYet."""

    def raster(self, name: str) -> RasterSpec:
        """The specification of a raster that some stage has planned. Raises NotYet."""

    def image_files(self, source: Photographs, simulated_folder: str = "photographs") -> tuple[str, ...]:
        """The image files of a source in order of name, as regions want them (relative to the project's root).

        For simulated photographs these are the files that are exported to `simulated_folder` of the run. Raises NotYet until
        the stage that exports them is planned, WorkflowError when there are none.
        """

    def run_file(self, path: str) -> str:
        """The path, as regions want it, of a file that an `Export` makes in the run's folder."""

    def has_stage(self, kind: str) -> bool:
        """Whether the workflow contains a stage."""


class Stage(Settings):
    """One link of the chain. Its `kind` is its folder, its YAML name, its Dask prefix, its store group."""

    title: ClassVar[str]
    """What the stage does, in a few words, for reports and progress lines."""

    kind: str

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """Yields what exists, what is to be done and what is to be exported. Holds no numerics."""
        raise NotImplementedError
