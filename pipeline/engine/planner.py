"""Asks the stages for their jobs, as far as they can be planned at the moment.

A stage that asks for a table which is not finished, or reads what no job writes yet, is suspended and asked again later. What it
yielded before is in the graph already, so nothing waits for a whole stage to be planned or done.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

from orthomill.pipeline.engine.graph import Graph, NoWriter
from orthomill.pipeline.engine.planned.planned_jobs import PlannedJob
from orthomill.pipeline.export.file_parts import in_parts
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Export, Job, Table
from orthomill.schemas.project import MaskFiles, PhotoFiles, Photographs, Project
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.stage_contract import NotYet, Stage

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".tif", ".tiff", ".png")


@dataclass
class Planner:
    """The planning state of one run. `is_done` says whether a job's result is valid; `list_images` lists the user's photographs."""

    project: Project
    stages: tuple[Stage, ...]
    graph: Graph
    store: Store
    is_done: Callable[[tuple[str, str, int, int]], bool]
    list_images: Callable[[PhotoFiles | MaskFiles], tuple[str, ...]]

    def __post_init__(self) -> None:
        self.complete: set[str] = set()
        self.waiting_for: dict[str, str] = {}
        self._expected: dict[str, Any] = {}
        self._asking = ""
        """the stage that is being planned"""

    @contextmanager
    def expecting(self, tables: dict[str, Any]) -> Iterator[None]:
        """Inside, tables that no job has written yet have these values, by path."""
        self._expected = tables
        try:
            yield
        finally:
            self._expected = {}

    @property
    def open_stages(self) -> tuple[Stage, ...]:
        """Stages of which not all jobs are planned."""
        return tuple(stage for stage in self.stages if stage.kind not in self.complete)

    def advance(self) -> Iterator[PlannedJob]:
        """Plan all that can be planned now: the new jobs one after the other, in an order in which they can run.

        Raises WorkflowError when a stage needs what no stage of the workflow produces.
        """
        for stage in self.open_stages:
            try:
                yield from self._jobs_of(stage)
            except NotYet as missing:  # what was yielded before is in the graph and can run
                self.waiting_for[stage.kind] = str(missing)
            except NoWriter as missing:
                self._wait_or_refuse(stage.kind, missing.what)
            else:
                self.complete.add(stage.kind)
                self.waiting_for.pop(stage.kind, None)

    def _jobs_of(self, stage: Stage) -> Iterator[PlannedJob]:
        """What a stage plans and the graph did not hold yet."""
        items = stage.plan(self)
        while True:
            self._asking = stage.kind
            if (item := next(items, None)) is None:
                return
            if isinstance(item, RasterSpec):
                self.graph.add_raster(item)
            else:
                # All parts of a file are in the graph, and what joins them, before anybody looks at the first.
                yield from list(self._added(item))

    def _added(self, item: Job | Export) -> Iterator[PlannedJob]:
        """What the graph did not hold yet; a large GeoTIFF is several jobs."""
        whole = self.project.sheets_above * 1e9
        for one in in_parts(item, self.graph.specs, whole) if isinstance(item, Export) else (item,):
            if planned := self.graph.add(one):
                yield planned

    def _wait_or_refuse(self, kind: str, what: str) -> None:
        """An earlier stage may still plan a job that writes it; once all of them are planned completely, none will."""
        earlier = self.stages[: [stage.kind for stage in self.stages].index(kind)]
        if all(stage.kind in self.complete for stage in earlier):
            # By convention the name of a raster or table begins with the stage that writes it.
            producer = what.split()[2].split("/")[0]
            raise WorkflowError(
                f"The stage '{kind}' needs {what}, which no stage of this workflow produces; add the stage '{producer}' before it."
            )
        self.waiting_for[kind] = what

    # What a stage may ask while it plans (orthomill.schemas.stage_contract.ProjectView)

    def table(self, table: Table[Any]) -> Any:
        key = self.graph.writer_of_table(table.path)
        if key is None:
            raise NoWriter(f"the table {table.path}", "")
        # The truth of a simulation must not be seen while planning either, where no job would show that it was read.
        self.graph.check_table_reader(self._asking, table.path)
        if not self.is_done(key):
            if table.path in self._expected:
                return self._expected[table.path]
            raise NotYet(f"the table {table.path}")
        return self.store.table(table)

    def raster(self, name: str) -> RasterSpec:
        if name not in self.graph.specs:
            raise NoWriter(f"the raster {name}", "")
        return self.graph.specs[name]

    def image_files(self, source: Photographs | MaskFiles, simulated_folder: str = "photographs") -> tuple[str, ...]:
        if source.kind != "simulated":
            return self.list_images(source)
        makers = [stage.kind for stage in self.stages if source.kind in stage.provides]
        if not makers:
            raise WorkflowError("The photographs are simulated, but the workflow has no stage that simulates them; add it first.")
        if not set(makers) <= self.complete:
            raise NotYet("the simulated photographs")
        files = self.graph.exported_files(simulated_folder)
        return tuple(path for path in files if PurePosixPath(path).suffix.lower() in IMAGE_SUFFIXES)

    def run_file(self, path: str) -> str:
        return f"{self.graph.run_folder}/{path}"

    def has_stage(self, kind: str) -> bool:
        return any(stage.kind == kind for stage in self.stages)
