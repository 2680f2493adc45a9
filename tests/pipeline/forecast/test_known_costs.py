"""What runs leave for the next ones, and what a project may expect of them."""

import pytest

from orthomill.pipeline.engine.planned.planned_jobs import PlannedJob
from orthomill.pipeline.forecast.known_costs import (
    FunctionCost,
    RunCosts,
    effort_of,
    expectations,
    expected_costs,
    expected_from,
    family_of,
    largest_grids,
    measured_at_release,
    read_costs,
    write_costs,
)
from orthomill.pipeline.records.records import Fingerprint
from orthomill.schemas.job import Export, Job
from orthomill.schemas.raster import RasterSpec

FILE = "export cog height"
PRINT = Fingerprint(settings="s", code="c", inputs="i")
TEN = RunCosts(
    10.0,
    512,
    {"surface": {"tile": FunctionCost(100, 20.0, 200.0), "join": FunctionCost(1, 3.0, 1.0), FILE: FunctionCost(1, 2.0, 40.0)}},
    {"surface": 5.0},
)


def cost(jobs, seconds):
    """Of jobs without rasters."""
    return FunctionCost(jobs, seconds, float(jobs))


def run_of(stages, megapixels=10.0):
    return RunCosts(megapixels, 512, stages, {})


def test_tiles_grow_in_number_and_what_works_on_the_whole_block_in_time():
    expected = expected_costs([TEN], {}, megapixels=20.0, tile=512)
    tile, join, file = (expected["surface", name] for name in ("tile", "join", FILE))
    assert (tile.jobs, tile.effort, tile.seconds) == pytest.approx((200.0, 400.0, 0.1))
    assert join.jobs == 1.0 and join.effort * join.seconds == pytest.approx(6.0)
    assert (file.jobs, file.effort, file.seconds) == pytest.approx((1.0, 80.0, 0.05)), "as long for a megabyte as before"


def test_tiles_of_twice_the_side_are_a_quarter_as_many_and_take_as_long_in_all():
    tile = expected_costs([TEN], {}, megapixels=10.0, tile=1024)["surface", "tile"]
    assert (tile.jobs, tile.effort, tile.effort * tile.seconds) == pytest.approx((25.0, 100.0, 20.0))


@pytest.mark.parametrize(("megabytes", "effort"), [(0.0, 1.0), (0.5, 1.0), (9.0, 3.0)])
def test_a_job_with_nine_times_the_data_takes_three_times_as_long(megabytes, effort):
    job = Job(stage="surface", item="tiles", function=print, reads={}, writes={})
    assert effort_of(PlannedJob(job, (), PRINT, 0, 0, round(1e6 * megabytes))) == pytest.approx(effort)


def test_files_are_told_apart_by_what_they_hold_and_compare_by_their_size():
    heights = Export("surface", "dsm", "products/dsm.tif", "cog", {"height": "a", "precision": "b"})
    picture = Export("surface", "ortho", "products/ortho.tif", "cog", {"rgba": "c"})
    planned = [PlannedJob(export, (), PRINT, 0, 0, 9_000_000) for export in (heights, picture)]
    assert [family_of(one) for one in planned] == [("surface", "export cog height precision"), ("surface", "export cog rgba")]
    assert effort_of(planned[0]) == pytest.approx(9.0)
    for form in ("part", "sheet"):
        part = Export("surface", f"dsm-{form}s", "parts/0-0.tif", f"cog {form}", heights.rasters)
        assert family_of(PlannedJob(part, (), PRINT, 0, 0, 0)) == family_of(planned[0]), "it is made as a whole file is"


def test_the_largest_raster_of_a_stage_tells_its_size():
    shapes = {"surface/a": (1000, 2000), "surface/b/c": (3000, 1000, 4), "photos/x": (10, 10)}
    specs = [RasterSpec(name=name, shape=shape, dtype="uint8", chunk=64) for name, shape in shapes.items()]
    assert largest_grids(specs) == pytest.approx({"surface": 3.0, "photos": 1e-4})
    expected = expected_from(None, [TEN], {}, 20.0, 512, here=False)
    assert expected.grids == pytest.approx({"surface": 10.0})


def test_a_run_without_a_stage_says_nothing_of_it_but_one_without_a_function_does():
    without, elsewhere = run_of({"surface": {"join": cost(1, 5.0)}}), run_of({"other": {"tile": cost(1, 1.0)}})
    expected = expected_costs([TEN, without, elsewhere], {}, megapixels=10.0, tile=512)["surface", "tile"]
    assert (expected.jobs, expected.effort, expected.seconds) == pytest.approx((50.0, 100.0, 0.1))


def test_the_last_run_of_a_project_counts_more_than_all_others(tmp_path):
    mine, other = tmp_path / "runs" / "mine", tmp_path / "runs" / "other"
    for folder in (mine, other):
        (folder / "jobs").mkdir(parents=True)
    assert not expectations(mine, 10.0, 512).here and ("densification", "make_surface") in expectations(mine, 10.0, 512).of
    write_costs(other, run_of({"surface": {"tile": cost(100, 90.0)}}))
    assert expectations(mine, 10.0, 512).of["surface", "tile"].seconds == pytest.approx(0.9)
    write_costs(mine, TEN)
    found = expectations(mine, 10.0, 512)
    assert found.here and found.of["surface", "tile"].seconds == pytest.approx(0.1) and found.grids["surface"] == 5.0


def test_a_run_keeps_what_an_earlier_one_took_where_it_did_nothing_itself(tmp_path):
    (tmp_path / "jobs").mkdir()
    write_costs(tmp_path, TEN)
    write_costs(tmp_path, run_of({"surface": {"join": cost(1, 4.0)}, "more": {}}))
    kept = read_costs(tmp_path)
    assert kept.stages["surface"] == TEN.stages["surface"] | {"join": cost(1, 4.0)} and kept.grids == TEN.grids
    write_costs(tmp_path, run_of({"surface": {"join": cost(1, 4.0)}}, megapixels=12.0))
    assert "tile" not in read_costs(tmp_path).stages["surface"], "of other photographs"


def test_a_run_of_a_small_part_of_the_ground_is_not_mixed_with_the_one_of_all(tmp_path):
    (tmp_path / "jobs").mkdir()
    write_costs(tmp_path, TEN)
    write_costs(tmp_path, RunCosts(10.0, 512, {"surface": {"join": cost(1, 0.1)}}, {"surface": 0.05}))
    assert read_costs(tmp_path).stages == {"surface": {"join": cost(1, 0.1)}}


def test_costs_that_cannot_be_read_are_as_good_as_none(tmp_path):
    (tmp_path / "jobs").mkdir()
    (tmp_path / "jobs" / "costs.json").write_text('{"megapixels": "many"}')
    assert read_costs(tmp_path) is None


def test_a_file_among_the_runs_is_no_run(tmp_path):
    (tmp_path / "model.tif").write_text("put there by hand")
    assert expectations(tmp_path / "site", 12.0, 512) is not None


def test_the_blocks_measured_at_release_have_all_stages_of_a_map():
    runs, compiling = measured_at_release()
    assert {"photos", "tie_points", "orientation", "epipolar", "densification", "dsm_check", "texture"} <= set(
        runs["brighton"].stages
    )
    assert compiling["texture", "texture_tile"] > 1.0
