"""The remaining time: jobs count by their kind, compiling counts once, and what is not planned yet counts as other runs took it."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.watching.recorded_run import Ended, LaidOut, Planned, RunLog, read_log, write_log
from benchmarks.watching.remaining_time import FROM, LAST, RUNS, WITHIN, estimates, first_and_second
from orthomill.pipeline.forecast.known_costs import Expectations, Expected
from orthomill.pipeline.watching.cost_model import (
    EXPECTED_ERROR,
    MEASURED_ERROR,
    PARALLEL,
    STILL,
    UNPLANNED_ERROR,
    WEIGHT,
    CostModel,
    FamilyCost,
)

TILES, LATER = ("source", "tile"), ("later", "work")


class Clock:
    """A clock that stands still unless it is told to go on."""

    now = 0.0

    def __call__(self):
        return self.now


def model_of(expected=None, workers=1, here=False, clock=None, cold=False, tiles=16):
    """A model of a source of sixteen tiles, planned, and of a later stage, which is not."""
    model = CostModel(("source", "later"), workers, Expectations(expected or {}, here), cold, clock or Clock())
    for number in range(tiles):
        model.count(TILES, closes=number + 1 == tiles)
    return model


def test_nothing_is_said_before_anything_is_measured():
    assert model_of({LATER: Expected(3.0, 1.0)}).remaining() is None


def test_the_first_job_of_every_worker_does_not_spoil_the_mean():
    cost = FamilyCost(planned=100)
    for seconds, worker in ((90.0, "a"), (1.0, "a"), (91.0, "b"), (1.0, "b"), (1.0, "a")):
        cost.add(seconds, worker)
    assert cost.mean == pytest.approx(1.0) and cost.spent == pytest.approx(184.0)


def test_no_mean_is_told_while_every_job_may_have_compiled():
    cost = FamilyCost(planned=100)
    cost.add(90.0, "a")
    cost.add(91.0, "b")
    assert cost.mean is None


def test_what_is_not_planned_counts_as_expected():
    model = model_of({TILES: Expected(16.0, 2.0), LATER: Expected(10.0, 3.0)})
    for _ in range(4):
        model.took(TILES, 2.0, "a")
    left = model.remaining()
    assert left.done == pytest.approx(8.0) and left.left == pytest.approx(12 * 2.0 + 30.0)
    assert left.expected == pytest.approx(30.0 + 24.0 * WEIGHT / (WEIGHT + 3))
    pace = PARALLEL
    assert left.seconds == pytest.approx(54.0 / pace)
    uncertain = UNPLANNED_ERROR * 30.0 + EXPECTED_ERROR * (left.expected - 30.0)
    assert left.error == pytest.approx((MEASURED_ERROR * (54.0 - left.expected) + uncertain) / pace)


def test_a_stage_that_has_announced_its_rasters_counts_by_how_large_they_are():
    expected = Expectations({LATER: Expected(10.0, 3.0)}, False, {"later": 5.0})
    model = CostModel(("source", "later"), 1, expected, clock=Clock())
    model.count(TILES, closes=True)
    model.took(TILES, 2.0, "a")
    assert model.remaining().left == pytest.approx(30.0)
    before = model.remaining().error
    model.laid_out("later", 2.0)
    model.laid_out("later", 10.0)
    assert model.remaining().left == pytest.approx(60.0)
    assert model.remaining().error < 2 * before, "how large it will be is known now"
    model.laid_out("later", 1.0)
    assert model.remaining().left == pytest.approx(60.0), "smaller rasters beside it change nothing"


def test_jobs_with_more_data_are_expected_to_take_longer():
    model = CostModel(("source",), 1, Expectations({}, here=False), clock=Clock())
    for effort in (1.0, 1.0, 1.0, 5.0):
        model.count(TILES, effort)
    for _ in range(2):
        model.took(TILES, 2.0, "a")
    assert model.remaining().left == pytest.approx(2.0 + 10.0)
    model.took(TILES, 2.0, "a")
    model.took(TILES, 10.0, "a", 5.0)
    assert model.remaining().left == 0.0 and model.costs()["source"]["tile"].effort == pytest.approx(8.0)


def test_a_machine_twice_as_slow_as_expected_is_expected_to_stay_so():
    far, near = (model_of({TILES: Expected(16.0, 1.0), LATER: Expected(10.0, 3.0)}, here=here) for here in (False, True))
    for model in (far, near):
        for _ in range(16):
            model.took(TILES, 2.0, "a")
    assert 30.0 < near.remaining().left < far.remaining().left < 60.0, "and less so where the machine is known"


def test_a_stage_that_is_planned_to_its_end_expects_nothing_more():
    model = model_of({("source", "other"): Expected(10.0, 3.0)})
    for _ in range(16):
        model.took(TILES, 1.0, "a")
    assert model.remaining().left == 0.0


def test_compiling_is_expected_of_functions_to_come_where_no_kernel_was_cached():
    expected = {TILES: Expected(16.0, 1.0, compiling=10.0), LATER: Expected(10.0, 1.0, compiling=20.0)}
    cold, warm = model_of(expected, cold=True), model_of(expected)
    for model, first in ((cold, 11.0), (warm, 1.0)):
        model.took(TILES, first, "a")
        for _ in range(15):
            model.took(TILES, 1.0, "a")
    assert warm.remaining().left == pytest.approx(10.0) and cold.remaining().left == pytest.approx(10.0 + 20.0)


def test_the_pace_of_a_machine_that_others_use_is_measured():
    clock = Clock()
    model = model_of(clock=clock, tiles=200)
    for _ in range(100):
        clock.now += 4.0
        model.took(TILES, 1.0, "a", wall=4.0)
    assert model.remaining().seconds == pytest.approx(100 * 4.0, rel=0.15)


def test_a_job_that_runs_for_long_counts_before_it_ends():
    clock = Clock()
    model = model_of(clock=clock)
    for _ in range(4):
        clock.now += 1.0
        model.took(TILES, 1.0, "a")
    said = [model.remaining().seconds for clock.now in (4.0, 6.0, 9.0)]
    assert said == sorted(said, reverse=True) and said[-1] > STILL * said[0]


def test_jobs_that_failed_tell_nothing_and_leave_nothing_behind():
    model = model_of(tiles=3)
    model.took(TILES, 2.0, "a")
    model.took(TILES, None, "")
    model.took(TILES, 2.0, "a")
    assert model.remaining().left == 0.0 and model.remaining().done == pytest.approx(4.0)


def test_what_is_kept_for_the_next_run_is_without_compiling_and_of_whole_functions():
    model = model_of({LATER: Expected(1.0, 1.0, compiling=20.0)}, cold=True, tiles=4)
    model.count(LATER)
    model.count(("later", "more"))
    for seconds in (9.0, 1.0, 1.0, 1.0):
        model.took(TILES, seconds, "a")
    model.took(LATER, 21.0, "a")
    kept = model.costs()
    assert kept["source"]["tile"].seconds == pytest.approx(4.0)
    assert kept["later"]["work"].seconds == pytest.approx(2.1), "a tenth at least"
    assert "more" not in kept["later"], "it has not been done"


@settings(deadline=None, max_examples=50)
@given(seconds=st.lists(st.floats(0.01, 50.0), min_size=1, max_size=30), workers=st.integers(1, 4))
def test_the_remaining_time_is_never_negative_and_ends_at_none(seconds, workers):
    clock, model = Clock(), CostModel(("source",), workers, Expectations({}, here=False))
    for number in range(len(seconds)):
        model.count(TILES, closes=number + 1 == len(seconds))
    for number, one in enumerate(seconds):
        clock.now += one
        model.took(TILES, one, str(number % workers))
        assert model.remaining().seconds >= 0.0
    assert model.remaining().left == 0.0 and model.remaining().share == 1.0


def test_a_share_that_was_shown_waits_where_a_stage_turns_out_larger():
    clock = Clock()
    model = model_of({TILES: Expected(16.0, 0.0)}, clock=clock)
    shares, seconds = [], []
    for number in range(16):
        clock.now += 1.0
        model.took(TILES, 1.0, "a")
        if number == 11:
            for _ in range(40):
                model.count(LATER)
        told = model.shown()
        shares.append(told.share)
        seconds.append(told.seconds)
    assert shares == sorted(shares) and seconds[11] > 3 * seconds[10], "the time grows, the share waits"
    assert model.remaining().share == shares[-1] > 12 / 56


def test_a_share_is_what_is_surely_done():
    model = model_of()
    for _ in range(8):
        model.took(TILES, 1.0, "a")
    left = model.remaining()
    assert left.share == pytest.approx(8.0 / (8.0 + 8.0 * (1 + left.error / left.seconds))) and left.share < 0.5


def test_a_log_is_read_as_it_was_written(tmp_path):
    begun = (LaidOut("source", 4.0), Planned(TILES, 2, 2.5), Ended(TILES, "0", 1.5, 1.51, 1.25))
    log = RunLog(34.5, (*begun, Planned(LATER, 1, 1.0), Ended(LATER, "1", 0.5, 2.0, 1.0)))
    write_log(tmp_path / "log", log)
    assert read_log(tmp_path / "log") == log and log.whole == 2.0


@pytest.mark.parametrize("name", ["brighton, after brighton_before", "volos, after volos_cold", "volos_second, after volos"])
def test_second_runs_are_estimated_within_thirty_per_cent_from_the_first_minute_on(name):
    names = name.replace(", after", "").split()
    logs = {one: read_log(RUNS / f"{one}.json.gz") for one in names}
    log, known = next((log, known) for judged, log, known in first_and_second(logs) if judged == name)
    judged = [one for one in estimates(log, known) if one.time >= FROM and one.left >= LAST]
    assert judged and all(abs(one.off) <= WITHIN for one in judged)
