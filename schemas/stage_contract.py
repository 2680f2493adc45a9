"""The contract between a stage and the engine.

A stage is a pydantic model: its fields are its settings. `plan()` yields raster specifications, jobs and exports. It may ask the
view for a table or a raster that does not exist yet; the view then raises `NotYet`, the engine runs what was yielded so far and
plans the stage again when the table or raster exists. Planning must therefore be repeatable: the same answers give the same jobs.
"""

from collections.abc import Iterator
from typing import ClassVar, Literal, Protocol, TypeVar

from orthomill.schemas.job import Export, Job, Table
from orthomill.schemas.project import MaskFiles, Photographs, Project
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import Settings

T = TypeVar("T")
Outline = tuple[tuple[float, float], ...]
"""corners (x, y) on the map, m"""


InspectionPart = Literal["cameras", "ties", "surface", "filling", "orthoimage"]
"""cameras and their places; ties, where the photographs have to say where the ground is; the judgement of the surface; a surface of
our own for its holes; an orthoimage on it"""


# Not an OrthomillError: a handler of errors for users must not intercept this signal to the engine.
class NotYet(Exception):
    """A table or raster that planning asked for does not exist yet. Never shown to a user."""


# A protocol, so that stages depend on no engine and tests can plan a stage with a few given tables.
class ProjectView(Protocol):
    """What a stage may know while it plans."""

    project: Project

    def table(self, table: Table[T]) -> T:
        """The value of a finished table. Raises NotYet."""

    def raster(self, name: str) -> RasterSpec:
        """The specification of a raster that some stage has planned. Raises NotYet."""

    def image_files(self, source: Photographs | MaskFiles, simulated_folder: str = "photographs") -> tuple[str, ...]:
        """The image files of a source in order of name, relative to the project's root, as in regions.

        For simulated photographs these are the files that are exported to `simulated_folder` of the run. Raises NotYet until
        the stage that exports them is planned, WorkflowError when there are none.
        """

    def run_file(self, path: str) -> str:
        """The path, relative to the project's root, of a file that an `Export` writes in the run's folder."""

    def has_stage(self, kind: str) -> bool:
        """Whether the workflow contains a stage."""


class Stage(Settings):
    """One stage of the workflow. Its `kind` is its folder, its name in YAML, its prefix in Dask and its group in the store."""

    title: ClassVar[str]
    """The subject of the stage as a noun phrase, for reports and progress lines."""
    provides: ClassVar[frozenset[str]] = frozenset()
    """The kinds of photographs, positions and control in the project that come from it."""
    for_own_photographs: ClassVar[bool] = True
    """Whether a project with photographs of its own runs it at first: it needs neither known truth nor a reference."""

    inspects: ClassVar[InspectionPart | None] = None
    """Its part where what somebody made is judged by photographs (`orthomill check`, `accept`); None: it takes none."""

    kind: str

    def remarks(self, view: ProjectView) -> Iterator[str]:
        """What the user should know of the project's files before anything runs, in sentences; from tables that depend on nothing
        but headers and texts. The report has them as well."""
        return iter(())

    def outlines(self, view: ProjectView) -> Iterator[tuple[str, Outline]]:
        """What the photographs show of the ground, by name, for whoever draws a map; of stages that know it. Raises NotYet."""
        return iter(())

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """Yields raster specifications, jobs and exports. Contains no numerics."""
        raise NotImplementedError
