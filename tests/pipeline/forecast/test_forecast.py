"""Forecasts from other blocks: what the reference blocks took lies within what is foreseen for them from the other three."""

from dataclasses import replace

import pytest
from small_site import make_site
from toy_stages import SmoothStage, SourceStage, SumStage, run_in, session_in

from orthomill.pipeline.engine.foresight import photograph_pixels, plan_ahead
from orthomill.pipeline.engine.run_facts import RunFacts, StageRun, write_facts
from orthomill.pipeline.engine.running import session_of
from orthomill.pipeline.forecast.forecast import Amount, forecast, stage_forecast
from orthomill.pipeline.forecast.rates import Rate, rate_of, rates_here, rates_of_release
from orthomill.pipeline.workflow.workflow_checks import kind_of
from orthomill.pipeline.workflow.workflow_file import load_workflow
from orthomill.tasks.catalogue import STAGES

REFERENCE = rates_of_release()
RUN = StageRun("photos", jobs=40, done=40, seconds=9.0, peak_bytes=1000 * 2**20, cpu_seconds=8.0, written=6_000_000)
FACTS = RunFacts("a", "EPSG:2100", "1", "t", finished="t", pixels=2_000_000, tile=512, stages=(RUN,))


@pytest.fixture
def session(tmp_path):
    make_site(tmp_path)
    return session_of(load_workflow(tmp_path / "workflows" / "site.yaml", STAGES))


def test_a_rate_is_per_megapixel_and_for_the_tile_of_reference():
    assert rate_of(RUN, FACTS) == Rate(20.0, 3.0, 4.0, 1000.0)
    small = rate_of(RUN, replace(FACTS, tile=256))
    assert small.jobs == 5.0 and small.peak_mib == 2200.0 and small.megabytes == 3.0


def test_only_complete_runs_that_know_their_pixels_count(tmp_path):
    for name, facts in {
        "whole": FACTS,
        "interrupted": replace(FACTS, finished=None),
        "old": replace(FACTS, pixels=0),
        "own": FACTS,
    }.items():
        write_facts(tmp_path / name, facts)
    assert rates_here(tmp_path, but=tmp_path / "own") == {"photos": (Rate(20.0, 3.0, 4.0, 1000.0),)}
    assert rates_here(tmp_path / "nowhere", but=tmp_path) == {}


@pytest.mark.parametrize("stage", [stage for stage, rates in REFERENCE.items() if len(rates) == 4])
def test_each_reference_block_lies_within_the_forecast_from_the_others(stage):
    for number, own in enumerate(REFERENCE[stage]):
        others = REFERENCE[stage][:number] + REFERENCE[stage][number + 1 :]
        foreseen = stage_forecast(others, others, 50.0, 1.0)
        assert own.jobs * 50 <= foreseen.jobs.most and own.megabytes * 50 <= foreseen.megabytes.most
        assert own.seconds * 50 <= foreseen.seconds.most and own.peak_mib <= foreseen.peak_mib.most


def test_the_forecast_follows_pixels_tile_and_the_runs_of_this_machine(session):
    plan_ahead(session)
    assert photograph_pixels(session) == 3 * 640 * 360
    first = forecast(session)
    assert first and first.runs == 0 and set(first.stages) == {"photos", "calibration", "tie_points", "orientation"}
    rates = [rate.jobs for rate in REFERENCE["tie_points"]]
    assert first.stages["tie_points"].jobs.most == pytest.approx(2.2 * max(rates) * 0.6912 * 4 + 15), "tiles of 256 px"
    write_facts(session.root / "runs" / "another", FACTS)
    second = forecast(session)
    assert second and second.runs == 1
    assert second.stages["photos"].seconds == Amount(pytest.approx(4.0 * 0.6912), pytest.approx(8.8 * 0.6912))
    assert second.megabytes.about > 0 and second.seconds.most >= second.seconds.about


def test_of_every_stage_that_photographs_alone_need_something_is_known():
    """Nothing that a plan shows of a stage is a question mark."""
    assert {kind_of(stage) for stage in STAGES} <= set(REFERENCE)


def test_without_photographs_nothing_is_foreseen(tmp_path):
    run_in(tmp_path, SourceStage(), SmoothStage(), SumStage())
    assert forecast(session_in(tmp_path, SourceStage(), SmoothStage(), SumStage())) is None
