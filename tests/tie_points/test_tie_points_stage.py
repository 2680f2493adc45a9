"""The plan of the stage: which jobs it yields, that they fit their functions, and what every setting changes in them."""

from types import SimpleNamespace

import pytest
from pydantic import ValidationError

from orthomill.pipeline.engine.job_signature import misfit
from orthomill.schemas.job import Job
from orthomill.schemas.photo import PHOTOS, Photo, Photos
from orthomill.schemas.stage_contract import NotYet
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching
from orthomill.tasks.tie_points.appearance import Candidates
from orthomill.tasks.tie_points.correlation_search import correlate_pair, tile_interest_points
from orthomill.tasks.tie_points.features import tile_features
from orthomill.tasks.tie_points.match_records import Links, MatchCounts
from orthomill.tasks.tie_points.pair_matching import match_pair
from orthomill.tasks.tie_points.plan.tie_point_tables import CANDIDATES, LINKS, MATCH_COUNTS
from orthomill.tasks.tie_points.search_settings import CorrelationSearch, GrowingSearch
from orthomill.tasks.tie_points.stage import FeatureSearch, TiePointsStage


def photos(count: int, **changes) -> Photos:
    facts = {"width": 4000, "height": 3000, "bands": 3, "dtype": "uint8", "camera": "c", "levels": 4, **changes}
    return Photos(
        photos=tuple(Photo(name=f"p{n}", path=f"p{n}.jpg", position=(60.0 * n, 0.0, 100.0), **facts) for n in range(count))
    )


class View:
    """Answers with the tables that are given; all others have not been made yet."""

    def __init__(self, *known, tile: int = 1024) -> None:
        self.project = SimpleNamespace(tile=tile)
        self.known = {table.path: value for table, value in known}

    def table(self, table):
        if table.path not in self.known:
            raise NotYet(table.path)
        return self.known[table.path]


def planned(stage: TiePointsStage, shown: Photos, *known) -> list[Job]:
    """The jobs until a table is missing."""
    jobs = []
    try:
        for job in stage.plan(View((PHOTOS, shown), *known)):
            jobs.append(job)
    except NotYet:
        pass
    return jobs


def of(jobs: list[Job], word: str) -> list[Job]:
    return [job for job in jobs if job.item.endswith(word)]


def whole(stage: TiePointsStage, shown: Photos | None = None) -> list[Job]:
    """All jobs of three photographs, of which the first two are linked."""
    counts, links = MatchCounts(matches=90, features=150), Links(pairs=((0, 1),), tracks=50, conflicts=0)
    return planned(stage, shown or photos(3), (MATCH_COUNTS, counts), (LINKS, links))


SEARCHES = [
    FeatureSearch(kind="features"),
    CorrelationSearch(kind="correlation"),
    GrowingSearch(kind="region_growing", step=12, window=21, seeds="control/seeds.csv"),
]


@pytest.mark.parametrize("search", SEARCHES, ids=lambda search: search.kind)
def test_all_jobs_fit_their_functions(search):
    jobs = whole(TiePointsStage(search=search))
    assert [misfit(job) for job in jobs if misfit(job)] == []
    assert len({job.key for job in jobs}) == len(jobs), "every job has a name of its own"


def test_jobs_by_appearance_fit_their_functions():
    unplaced = Photos(photos=tuple(photo.model_copy(update={"position": None}) for photo in photos(20).photos))
    jobs = planned(TiePointsStage(), unplaced)
    assert [misfit(job) for job in jobs if misfit(job)] == []
    assert len(of(jobs, "sample")) == len(of(jobs, "signature")) == 20 and len(of(jobs, "alike")) == 1
    assert not of(jobs, "matches"), "pairs are known when the signatures have been compared"
    more = planned(TiePointsStage(), unplaced, (CANDIDATES, Candidates(pairs=((0, 1), (4, 9)))))
    assert [job.item for job in of(more, "matches")] == ["p0+p1 matches", "p4+p9 matches"]


def test_planning_pauses_at_counts_and_tracks_and_repeats_itself():
    first = planned(TiePointsStage(), photos(3))
    second = planned(TiePointsStage(), photos(3), (MATCH_COUNTS, MatchCounts(matches=90, features=150)))
    again = whole(TiePointsStage())
    assert [job.key for job in again[: len(second)]] == [job.key for job in second]
    assert [job.key for job in second[: len(first)]] == [job.key for job in first]
    assert first[-1].item == "counts" and second[-1].item == "tracks" and not of(second, "patches")
    assert [job.item for job in of(again, "refinement")] == ["p0 refinement"]
    assert again[-1].item == "tie points"


def test_memory_for_tracks_follows_what_was_matched():
    few, many = (
        planned(TiePointsStage(), photos(3), (MATCH_COUNTS, MatchCounts(matches=n, features=2 * n)))[-1] for n in (1000, 100000)
    )
    assert many.scratch == 100 * few.scratch


@pytest.mark.parametrize(("side", "level", "matching_level"), [(4000, 0, 0), (2000, 1, 0), (1999, 2, 1), (1000, 2, 1), (500, 3, 2)])
def test_the_search_side_decides_the_pyramid_level(side, level, matching_level):
    jobs = whole(TiePointsStage(search_side=side))
    assert {job.reads["pixels"].name for job in of(jobs, "features")} == {f"photos/p{n}/{level}" for n in range(3)}
    assert {job.reads["pixels"].name for job in of(jobs, "patches")} == {f"photos/p{n}/{matching_level}" for n in range(3)}


def test_a_photograph_without_small_levels_is_searched_on_its_last_one():
    jobs = whole(TiePointsStage(search_side=500), photos(3, levels=2))
    assert of(jobs, "features")[0].reads["pixels"].name == "photos/p0/1"


def test_limits_of_points_reach_every_part_and_the_photograph():
    jobs = whole(TiePointsStage(max_features=1234, contrast=0.05))
    assert {job.params["detection"].max_features for job in of(jobs, "features")} == {1234}
    assert {job.params["detection"].contrast for job in of(jobs, "features")} == {0.05}
    assert {job.params["max_features"] for job in of(jobs, "chosen")} == {1234}


def test_the_limit_of_matched_points_reaches_the_job_that_counts_them():
    assert of(whole(TiePointsStage(max_matched=20_000)), "counts")[0].params["most"] == 20_000


@pytest.mark.parametrize("side", [4000, 1000])
def test_the_tolerance_is_in_pixels_of_the_searched_level(side):
    stage = TiePointsStage(search_side=side, epipolar_tolerance=2.5, ratio=0.7)
    rules = {job.params["rules"] for job in of(whole(stage), "matches")}
    assert {rule.tolerance for rule in rules} == {2.5 * (4 if side == 1000 else 1)}
    assert {rule.ratio for rule in rules} == {0.7}


@pytest.mark.parametrize(("up_to", "pairs"), [(2, 4 + 3), (5, 10), (15, 10)])
def test_few_photographs_are_compared_with_all_others(up_to, pairs):
    """Five photographs in a row: two neighbours on either side without, all ten pairs with `all_pairs_up_to`."""
    jobs = planned(TiePointsStage(all_pairs_up_to=up_to, nearest=2), photos(5))
    assert len(of(jobs, "matches")) == pairs


def test_more_neighbours_are_compared_when_asked_for():
    counts = [len(of(planned(TiePointsStage(nearest=nearest), photos(40)), "matches")) for nearest in (4, 12)]
    assert counts[0] < 40 * 4 and counts[1] > 1.8 * counts[0]


def test_the_matching_of_the_refinement_is_that_of_the_setting():
    small, large = (LeastSquaresMatching(max_shift=shift, min_correlation=0.8) for shift in (1.0, 6.0))
    jobs = [whole(TiePointsStage(refinement=matching)) for matching in (small, large)]
    for matching, own in zip((small, large), jobs, strict=True):
        params = of(own, "refinement")[0].params
        assert {one.rules.matching for one in (params["photo"], *params["partners"])} == {matching}
    halves = [of(own, "patches")[0].params["strip"].half for own in jobs]
    assert halves[1] == halves[0] + 5, "patches hold the window and its largest shift"


def test_standard_errors_and_the_fate_of_unrefined_observations_reach_the_last_job():
    stage = TiePointsStage(search_side=1000, sigma_floor=0.05, sigma_unrefined=0.9, unrefined="keep")
    weighting = whole(stage)[-1].params["weighting"]
    assert (weighting.floor, weighting.unrefined, weighting.unmatched) == (0.05, pytest.approx(0.9 * 4), "keep")


def test_a_tile_high_strip_at_a_time_is_read_for_patches():
    jobs = of(whole(TiePointsStage()), "patches")
    own = [job for job in jobs if job.item == "p0 patches"]
    assert len(own) == 3 and [job.row for job in own] == [0, 1, 2]
    strips = [job.params["strip"] for job in own]
    assert sum(strip.height for strip in strips) == 3000
    assert all(job.reads["pixels"].window == strip.window for job, strip in zip(own, strips, strict=True))
    assert strips[1].window.row == 1024 - strips[1].half


@pytest.mark.parametrize(
    ("search", "points", "pairs"), [(SEARCHES[0], tile_features, match_pair), (SEARCHES[1], tile_interest_points, correlate_pair)]
)
def test_the_search_decides_how_points_are_found_and_matched(search, points, pairs):
    jobs = whole(TiePointsStage(search=search))
    assert {job.function for job in of(jobs, "features")} == {points}
    assert {job.function for job in of(jobs, "matches")} == {pairs}


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"search": {"kind": "correlation"}, "ratio": 0.7}, "ratio has no effect with search: correlation"),
        ({"search": {"kind": "correlation"}, "contrast": 0.03}, "contrast has no effect with search: correlation"),
        ({"search": {"kind": "correlation"}, "ratio": 0.7, "contrast": 0.03}, "ratio and contrast have no effect"),
        ({"sigma_unrefined": 1.0}, "sigma_unrefined has no effect with unrefined: drop"),
    ],
)
def test_settings_without_effect_are_refused(settings, sentence):
    with pytest.raises(ValidationError, match=sentence):
        TiePointsStage(**settings)


@pytest.mark.parametrize(
    "settings",
    [
        {"search": {"kind": "correlation"}, "ratio": 0.8, "contrast": 0.02},
        {"ratio": 0.7, "contrast": 0.03},
        {"sigma_unrefined": 1.0, "unrefined": "keep"},
        {"sigma_unrefined": 0.7},
    ],
)
def test_defaults_written_out_are_accepted(settings):
    """The workflow as run lists every default, and running it again must not be refused."""
    assert TiePointsStage(**settings).ratio in (0.7, 0.8)
