"""Planning in steps: what can be planned is planned, the rest waits, and what can never be planned is refused."""

from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
import pytest
from toy_stages import PROJECT, SIZE, Size, SmoothStage, SourceStage, SumStage

from orthomill.pipeline.engine.graph import Graph
from orthomill.pipeline.engine.planner import Planner
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Export, Job, Raster, Table, TextFile
from orthomill.schemas.project import PhotoFolder, SimulatedPhotos
from orthomill.schemas.raster import RasterSpec, Window, tiles_of
from orthomill.schemas.stage_contract import NotYet, Stage

FOLDER = PhotoFolder(kind="folder", path="photos")
SIMULATED = SimulatedPhotos(kind="simulated")


def planner_of(root: Path, *stages: Stage, done: set | None = None) -> Planner:
    store, finished = Store(root), done if done is not None else set()
    return Planner(PROJECT, stages, Graph(root, "runs/toy"), store, finished.__contains__, lambda source: (source.path,))


def stages_of(jobs) -> set[str]:
    return {planned.key[0] for planned in jobs}


def test_planning_goes_as_far_as_the_tables_that_exist(tmp_path):
    done: set = set()
    planner = planner_of(tmp_path, SourceStage(), SmoothStage(), SumStage(), done=done)
    assert [planned.key for planned in planner.advance()] == [("source", "size", 0, 0)]
    assert planner.waiting_for == {
        "source": "the table source/size.json",
        "smooth": "the raster source/numbers",
        "sum": "the raster smooth/numbers",
    }
    planner.store.write_table(SIZE, Size(rows=200, cols=150))
    done.add(("source", "size", 0, 0))
    assert stages_of(planner.advance()) == {"source", "smooth", "sum"}
    assert not planner.waiting_for and not planner.open_stages


def test_a_complete_stage_is_not_asked_again(tmp_path):
    planner = planner_of(tmp_path, OnceStage())
    list(planner.advance())
    assert planner.complete == {"once"} and not list(planner.advance())
    assert OnceStage.asked == 1


def large(window: Window) -> np.ndarray:
    """(H, W) of zeros."""
    return np.zeros(window.shape, np.float32)


class LargeStage(Stage):
    """A raster of 5000 x 4000 px as GeoTIFF."""

    title: ClassVar[str] = "Large"
    kind: Literal["large"] = "large"

    def plan(self, view):
        spec = RasterSpec(name="large/z", shape=(5000, 4000), dtype="float32", chunk=1000)
        yield spec
        for tile in tiles_of(spec.shape, 1000):
            writes, params = {"z": Raster("large/z", tile.window)}, {"window": tile.window}
            yield Job(stage="large", item="z", function=large, reads={}, writes=writes, params=params, row=tile.row, col=tile.col)
        yield Export("large", "file", "products/z.tif", "cog", {"z": "large/z"})


def test_a_large_geotiff_is_planned_in_parts_that_wait_for_their_own_tiles(tmp_path):
    planned = {one.key: one for one in planner_of(tmp_path, LargeStage()).advance()}
    upper, lower = (planned["large", "file-parts", row, 0] for row in (0, 1))
    assert upper.job.window == Window(0, 0, 4096, 4000) and lower.job.window == Window(4096, 0, 904, 4000)
    assert set(lower.dependencies) == {("large", "z", 4, col) for col in range(4)}
    whole = planned["large", "file", 0, 0]
    assert whole.job.files == (upper.job.path, lower.job.path) and {upper.key, lower.key} <= set(whole.dependencies)
    assert list(planned)[-1] == whole.key


class OnceStage(Stage):
    """Counts how often it is planned."""

    title: ClassVar[str] = "Once"
    asked: ClassVar[int] = 0
    kind: Literal["once"] = "once"

    def plan(self, view):
        OnceStage.asked += 1
        yield from ()


@pytest.mark.parametrize(
    ("stages", "sentence"),
    [
        (
            (SmoothStage(),),
            "'smooth' needs the raster source/numbers, which no stage of this workflow produces; add the stage 'source'",
        ),
        ((SumStage(),), "'sum' needs the raster smooth/numbers.* add the stage 'smooth' before it"),
    ],
)
def test_what_no_stage_produces_is_refused(tmp_path, stages, sentence):
    with pytest.raises(WorkflowError, match=sentence):
        list(planner_of(tmp_path, *stages).advance())


def test_a_stage_waits_as_long_as_an_earlier_one_is_not_planned_completely(tmp_path):
    planner = planner_of(tmp_path, SourceStage(), SumStage())
    list(planner.advance())
    assert planner.waiting_for["sum"] == "the raster smooth/numbers"


def test_photographs_on_disk_are_listed_and_simulated_ones_are_waited_for(tmp_path):
    planner = planner_of(tmp_path, SourceStage())
    assert planner.image_files(FOLDER) == ("photos",)
    with pytest.raises(WorkflowError, match="has no stage that simulates them; add it first"):
        planner.image_files(SIMULATED)


class SimulationStage(Stage):
    """Stands for the stage that renders photographs."""

    title: ClassVar[str] = "Simulated photographs"
    provides: ClassVar[frozenset[str]] = frozenset({"simulated"})
    kind: Literal["simulation"] = "simulation"

    def plan(self, view):
        yield from ()


def test_simulated_photographs_are_the_images_among_the_exports(tmp_path):
    planner = planner_of(tmp_path, SimulationStage())
    with pytest.raises(NotYet):
        planner.image_files(SIMULATED)
    list(planner.advance())
    for name in ("b.TIF", "a.jpg", "notes.txt"):
        planner.graph.add(Export("simulation", name, f"photographs/{name}", "tiff"))
    assert planner.image_files(SIMULATED) == ("runs/toy/photographs/a.jpg", "runs/toy/photographs/b.TIF")
    assert planner.run_file("photographs/a.jpg") == "runs/toy/photographs/a.jpg"


def test_the_view_knows_the_stages_of_the_workflow(tmp_path):
    planner = planner_of(tmp_path, SourceStage(), SumStage())
    assert planner.has_stage("sum") and not planner.has_stage("smooth")


class TextStage(Stage):
    """Reads a file of the user."""

    title: ClassVar[str] = "Text"
    kind: Literal["text"] = "text"

    def plan(self, view):
        yield Job(
            stage="text",
            item="read",
            function=read_text,
            reads={"text": TextFile("points.csv")},
            writes={"size": Table("text/size.json", Size)},
        )


def read_text(text: str) -> Size:
    return Size(rows=len(text), cols=0)


def test_a_missing_file_of_the_user_ends_planning_with_its_name(tmp_path):
    with pytest.raises(WorkflowError, match=r"points\.csv cannot be read"):
        list(planner_of(tmp_path, TextStage()).advance())
