"""Runs stages without a project: photographs in, typed results out, everything between in a folder that is thrown away.

The jobs are those that a project runs, one after the other in this process, with the same results bit for bit. Rasters lie on
disk meanwhile, so that memory is bounded by the tile here as well.
"""

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import ConfigDict, PrivateAttr

from orthomill.pipeline.engine.one_thread import linear_algebra_on_one_thread
from orthomill.pipeline.engine.planned.planned_jobs import PlannedJob
from orthomill.pipeline.engine.runner import Finished, SequentialRunner
from orthomill.pipeline.engine.session import Session
from orthomill.pipeline.records.records import Record
from orthomill.pipeline.storage.photographs.file_kinds import is_image_name
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import OrthomillError, PhotoError
from orthomill.schemas.job import Export, Job, Raster, Table
from orthomill.schemas.memory import MIB
from orthomill.schemas.project import MaskFiles, Photographs, PhotoList, Project
from orthomill.schemas.raster import RasterSpec, tiles_of
from orthomill.schemas.stage_contract import ProjectView, Stage

Progress = Callable[[str, int, int], None]
"""Called with a stage, its finished and its planned jobs."""
MEMORY = 3000 * MIB


class GivenResults(Stage):
    """Hands tables and rasters of the caller to the stages after it, as if a stage had made them."""

    model_config = ConfigDict(arbitrary_types_allowed=True)
    title: ClassVar[str] = "Given results"
    kind: Literal["given"] = "given"
    _tables: dict[Table[Any], Any] = PrivateAttr(default_factory=dict)
    _rasters: list[tuple[RasterSpec, np.ndarray]] = PrivateAttr(default_factory=list)

    @classmethod
    def of(cls, tables: Mapping[Table[Any], Any], rasters: Sequence[tuple[RasterSpec, np.ndarray]] = ()) -> "GivenResults":
        """A stage that has these results, as if its jobs had made them."""
        stage = cls()
        stage._tables, stage._rasters = dict(tables), list(rasters)
        return stage

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        for table, value in self._tables.items():
            yield Job(
                stage=self.kind, item=table.path, function=_handed_over, reads={}, writes={"value": table}, params={"value": value}
            )
        for spec, values in self._rasters:
            yield spec
            for tile in tiles_of(spec.shape, spec.chunk):
                window = Raster(spec.name, tile.window)
                part = {"value": values[tile.window.slices]}
                yield Job(
                    stage=self.kind,
                    item=spec.name,
                    function=_handed_over,
                    reads={},
                    writes={"value": window},
                    params=part,
                    row=tile.row,
                    col=tile.col,
                )


def _handed_over(value: Any) -> Any:
    return value


class _Watcher:
    def __init__(self, progress: Progress | None) -> None:
        self._progress, self._planned, self._ended = progress, dict[str, int](), dict[str, int]()

    def planned(self, planned: PlannedJob) -> None:
        kind = planned.key[0]
        self._planned[kind] = self._planned.get(kind, 0) + 1

    def skipped(self, key: tuple[str, str, int, int]) -> None:
        """Nothing was there before."""

    def finished(self, finished: Finished, record: Record | None) -> None:
        kind = finished.key[0]
        self._ended[kind] = self._ended.get(kind, 0) + 1
        if self._progress:
            self._progress(kind, self._ended[kind], self._planned[kind])


@contextmanager
def temporary_run(project: Project, stages: tuple[Stage, ...], progress: Progress | None = None) -> Iterator[Store]:
    """The store that the stages have filled; it is gone when the context ends.

    Raises the first error of a job, as OrthomillError with its sentence.
    """
    with tempfile.TemporaryDirectory(prefix="orthomill-") as folder:
        session = Session(project, stages, Path(folder), _listed)
        with linear_algebra_on_one_thread():
            session.run(SequentialRunner(MEMORY), _Watcher(progress))
        if session.failures:
            raise OrthomillError(next(iter(session.failures.values())))
        yield session.store


def photo_list(photographs: str | Path | Sequence[str | Path]) -> PhotoList:
    """Photographs as absolute paths: of a folder, or named one by one. Raises PhotoError when there is none."""
    if isinstance(photographs, str | Path):
        folder = Path(photographs)
        found = [path for path in sorted(folder.iterdir()) if is_image_name(path.name)] if folder.is_dir() else [folder]
    else:
        found = [Path(path) for path in photographs]
    missing = [str(path) for path in found if not path.is_file()]
    if missing or not found:
        raise PhotoError(f"There is no photograph {', '.join(missing[:5]) or f'in {photographs}'}; correct the path.")
    return PhotoList(kind="list", paths=tuple(str(path.resolve()) for path in found))


def _listed(source: Photographs | MaskFiles) -> tuple[str, ...]:
    assert isinstance(source, PhotoList), "a temporary run has listed photographs"
    return source.paths
