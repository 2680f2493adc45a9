"""What the stage plans for every kind of reference: jobs, their fit to their functions, and figures of the references."""

import numpy as np
import pytest
from box_scene import block as box_block
from memory_runner import MemoryProject
from pydantic import ValidationError
from village_pair import level_pair

from orthomill.pipeline.engine.job_signature import misfit
from orthomill.schemas.epipolar import PAIRS, EpipolarPairs
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Job, MapFile, Raster
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.raster import MapGrid, RasterSpec
from orthomill.schemas.surface import CORRECTED, HEIGHT, ORTHO, SURFACE, Surface
from orthomill.schemas.truth import TRUTH_GRID
from orthomill.tasks.evaluation.stage import EvaluationStage

GRID = MapGrid(west=0.0, north=60.0, cell=1.0, rows=60, cols=90)
ORTHO_GRID = MapGrid(west=0.0, north=60.0, cell=0.5, rows=120, cols=180)
EVERYTHING = ("simulation", "orientation", "epipolar", "densification", "dsm_check", "texture")
FILES = {"kind": "file", "dsm": "dsm.tif", "ortho": "ortho.tif"}


class View(MemoryProject):
    """A project whose workflow has the stages `stages`."""

    stages: tuple[str, ...] = EVERYTHING

    def has_stage(self, kind):
        return kind in self.stages


def jobs(reference=None, stages=EVERYTHING, **settings_) -> list[Job]:
    view = View(32)
    view.stages = stages
    view.tables = {
        BLOCK.path: box_block(),
        TRUTH_GRID.path: GRID,
        SURFACE.path: Surface(grid=GRID, height_low=0.0, height_high=20.0),
        PAIRS.path: EpipolarPairs(pairs=(level_pair(),)),
    }
    view.specs[ORTHO] = RasterSpec(name=ORTHO, shape=(120, 180, 4), dtype="uint8", chunk=32, transform=ORTHO_GRID.transform)
    stage = EvaluationStage(**({"reference": reference} if reference else {}), **settings_)
    return [thing for thing in stage.plan(view) if isinstance(thing, Job)]


def items(planned: list[Job]) -> dict[str, int]:
    found = [job.item for job in planned]
    return {item: found.count(item) for item in dict.fromkeys(found)}


@pytest.mark.parametrize("reference", [None, FILES, {"kind": "none"}])
def test_every_job_fits_its_function(reference):
    assert [misfit(job) for job in jobs(reference) if misfit(job)] == []
    assert len({job.key for job in jobs(reference)}) == len(jobs(reference))


def test_against_the_truth_everything_is_compared():
    """60 x 90 cells and 120 x 180 pixels in tiles of 32."""
    planned = items(jobs())
    assert planned["heights"] == planned["heights_before_check"] == 2 * 3 and planned["ortho"] == planned["grey_sums"] == 4 * 6
    assert planned["check"] == 2 * 3 and planned["check_summary"] == 1
    assert planned["orientation"] == planned["grey_fit"] == planned["ortho_summary"] == planned["report"] == 1


def test_against_a_file_there_is_no_orientation_to_compare():
    planned = items(jobs(FILES))
    assert "orientation" not in planned and "check" not in planned and planned["heights"] == 6 and planned["ortho"] == 24


@pytest.mark.parametrize(("given", "compared", "left"), [("dsm", "heights", "ortho"), ("ortho", "ortho", "heights")])
def test_only_the_file_that_is_named_is_compared(given, compared, left):
    planned = items(jobs({"kind": "file", given: f"{given}.tif"}))
    assert compared in planned and left not in planned


def test_files_are_read_on_the_cells_that_are_judged():
    for job in jobs(FILES):
        region = job.reads.get("reference")
        if isinstance(region, MapFile):
            own = job.reads["height" if job.item.startswith("heights") else "ortho"]
            assert isinstance(own, Raster) and own.window == region.window
            assert (region.path, region.bands) == (("dsm.tif", 1) if region.grid == GRID else ("ortho.tif", 3))


def test_the_checked_surface_is_judged_and_the_measured_one_beside_it():
    sources = {job.item: job.reads["height"].name for job in jobs() if "height" in job.reads}
    assert sources == {"heights": CORRECTED, "heights_before_check": HEIGHT}
    alone = [job for job in jobs(stages=tuple(s for s in EVERYTHING if s != "dsm_check")) if "height" in job.reads]
    assert {job.reads["height"].name for job in alone} == {HEIGHT}


def test_stages_that_are_not_in_the_workflow_are_left_out():
    assert set(items(jobs(stages=("simulation",)))) == {"report"}
    assert "orientation" not in items(jobs(stages=("simulation", "densification")))


def test_parallax_sigma_reaches_the_summary():
    (summary,) = (job for job in jobs(parallax_sigma=0.3) if job.item == "heights_summary")
    assert summary.params["parallax_sigma"] == 0.3 and "pairs" in summary.reads
    (without,) = (job for job in jobs(stages=("simulation", "densification")) if job.item == "heights_summary")
    assert "pairs" not in without.reads


def test_the_report_waits_for_what_is_compared():
    (report,) = (job for job in jobs() if job.item == "report")
    assert set(report.reads) == {"orientation", "heights", "heights_before_check", "check", "ortho"}
    assert report.params["facts"].parts == tuple(report.reads) and report.params["facts"].reference == "truth"


def test_windows_of_the_truth_cover_the_cells_and_their_halo():
    for job in jobs():
        if "place" in job.params:
            place = job.params["place"]
            assert place.source_window == place.source_window.clipped(GRID.shape)
            cols, rows = place.source_pixels()
            inside = (cols + place.source_window.col >= 0) & (cols + place.source_window.col <= GRID.cols - 1)
            assert (cols[inside] >= 0).all() and (cols[inside] <= place.source_window.width - 1).all()
            assert rows.shape == (place.window.height,)


def test_jobs_name_their_working_memory():
    scratch = {job.item: job.scratch for job in jobs()}
    assert scratch["ortho"] > scratch["grey_sums"] > 0 and scratch["heights"] > 0
    assert np.all([job.scratch >= 0 for job in jobs()])


def test_a_truth_without_a_simulation_is_one_sentence():
    with pytest.raises(WorkflowError, match="no stage 'simulation'"):
        jobs(stages=("densification",))


@pytest.mark.parametrize(
    "wrong", [{"parallax_sigma": 0.0}, {"reference": {"kind": "survey"}}, {"reference": {"kind": "truth", "dsm": "x"}}]
)
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ValidationError):
        EvaluationStage(**wrong)
