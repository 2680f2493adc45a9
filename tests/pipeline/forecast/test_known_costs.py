"""What runs leave for the next ones, and what a project may expect of them."""

import pytest

from orthomill.pipeline.forecast.known_costs import (
    FunctionCost,
    RunCosts,
    expectations,
    expected_costs,
    measured_at_release,
    read_costs,
    write_costs,
)

TEN = RunCosts(10.0, 512, {"surface": {"tile": FunctionCost(100, 20.0), "join": FunctionCost(1, 3.0)}})


def test_tiles_grow_in_number_and_jobs_on_the_whole_block_in_time():
    expected = expected_costs([TEN], {}, megapixels=20.0, tile=512)
    assert (expected["surface", "tile"].jobs, expected["surface", "tile"].seconds) == pytest.approx((200.0, 0.2))
    assert (expected["surface", "join"].jobs, expected["surface", "join"].seconds) == pytest.approx((1.0, 6.0))


def test_tiles_of_twice_the_side_are_a_quarter_as_many_and_take_four_times_as_long():
    expected = expected_costs([TEN], {}, megapixels=10.0, tile=1024)
    assert (expected["surface", "tile"].jobs, expected["surface", "tile"].seconds) == pytest.approx((25.0, 0.8))


def test_a_run_without_a_stage_says_nothing_of_it_but_one_without_a_function_does():
    without = RunCosts(10.0, 512, {"surface": {"join": FunctionCost(1, 5.0)}})
    elsewhere = RunCosts(10.0, 512, {"other": {"tile": FunctionCost(1, 1.0)}})
    expected = expected_costs([TEN, without, elsewhere], {}, megapixels=10.0, tile=512)["surface", "tile"]
    assert (expected.jobs, expected.seconds) == pytest.approx((50.0, 0.2))


def test_the_last_run_of_a_project_counts_more_than_all_others(tmp_path):
    mine, other = tmp_path / "runs" / "mine", tmp_path / "runs" / "other"
    for folder in (mine, other):
        (folder / "jobs").mkdir(parents=True)
    assert not expectations(mine, 10.0, 512).here and ("densification", "make_surface") in expectations(mine, 10.0, 512).of
    write_costs(other, RunCosts(10.0, 512, {"surface": {"tile": FunctionCost(100, 90.0)}}))
    assert expectations(mine, 10.0, 512).of["surface", "tile"].seconds == pytest.approx(0.9)
    write_costs(mine, TEN)
    found = expectations(mine, 10.0, 512)
    assert found.here and found.of["surface", "tile"].seconds == pytest.approx(0.2)


def test_a_run_keeps_what_an_earlier_one_took_where_it_did_nothing_itself(tmp_path):
    (tmp_path / "jobs").mkdir()
    write_costs(tmp_path, TEN)
    write_costs(tmp_path, RunCosts(10.0, 512, {"surface": {"join": FunctionCost(1, 4.0)}, "more": {}}))
    kept = read_costs(tmp_path)
    assert kept.stages["surface"] == {"tile": FunctionCost(100, 20.0), "join": FunctionCost(1, 4.0)}
    write_costs(tmp_path, RunCosts(12.0, 512, {"surface": {"join": FunctionCost(1, 4.0)}}))
    assert "tile" not in read_costs(tmp_path).stages["surface"], "of other photographs"


def test_costs_that_cannot_be_read_are_as_good_as_none(tmp_path):
    (tmp_path / "jobs").mkdir()
    (tmp_path / "jobs" / "costs.json").write_text('{"megapixels": "many"}')
    assert read_costs(tmp_path) is None


def test_the_blocks_measured_at_release_have_all_stages_of_a_map():
    runs, compiling = measured_at_release()
    assert {"photos", "tie_points", "orientation", "epipolar", "densification", "dsm_check", "texture"} <= set(
        runs["brighton"].stages
    )
    assert compiling["texture", "texture_tile"] > 1.0
