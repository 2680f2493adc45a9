"""The report on tie points: figures, tables, and every warning where its fact is present and only there."""

import numpy as np
import pytest

from orthomill.schemas.observations import TiePoints
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.tie_points.block_strength import measure
from orthomill.tasks.tie_points.match_records import Links, Observations, PairSummary, Refined, Scatter, Scatters
from orthomill.tasks.tie_points.report.tie_point_report import finish
from orthomill.tasks.tie_points.tie_point_assembly import Weighting

SIZE = (900, 900)


def photos(count: int) -> Photos:
    facts = {"width": SIZE[0], "height": SIZE[1], "bands": 1, "dtype": "uint8", "camera": "c"}
    return Photos(photos=tuple(Photo(name=f"p{n}", path=f"p{n}.jpg", **facts) for n in range(count)))


def observations(tracks: np.ndarray, reference: int | np.ndarray, spread: float = 1.0) -> Observations:
    """One photograph with points on a lattice that fills `spread` of its frame."""
    count = len(tracks)
    side = int(np.ceil(np.sqrt(max(count, 1))))
    one = np.ones(count, np.float32)
    place = (np.arange(count) + 0.5) % side / side, (np.arange(count) // side + 0.5) / side
    col, row = (spread * part * SIZE[0] for part in place)
    return Observations(tracks.astype(np.int32), np.broadcast_to(reference, count).astype(np.int32), col, row, one, 0 * one)


def refined(photo: int, tracks: np.ndarray, failed: int = 0, spread: float = 1.0) -> Refined:
    """All observations of a photograph refined by 0.5 px but for the first `failed`."""
    own = observations(tracks, 0, spread)
    bad = np.arange(len(tracks)) < failed
    outcome = np.where(bad, int(Outcome.NOT_CONVERGED), int(Outcome.CONVERGED)).astype(np.uint8)
    sigma = np.where(bad, np.nan, 0.04).astype(np.float32)
    col, row = (np.where(bad, np.nan, part) for part in (own.col + 0.5, own.row))
    return Refined(np.full(len(tracks), photo, np.int32), tracks.astype(np.int32), col, row, sigma, outcome)


def summary(left: str, right: str, inliers: int = 50, alike: bool = False) -> PairSummary:
    return PairSummary(left=left, right=right, tentative=60, inliers=inliers, alike=alike)


SCATTERS = (Scatter(points=90, sigma=0.2),)


def results(count: int = 100, failed: int = 0, unmatched="drop", scatters=SCATTERS, spread: float = 1.0):
    """Two photographs that share `count` points, the first one the reference of all."""
    tracks = np.arange(count)
    tables = observations(tracks, 0, spread), observations(tracks, 0, spread)
    links = Links(pairs=((0, 1),), tracks=count, conflicts=3)
    weighting = Weighting(0.03, 0.7, unmatched)
    return finish(
        photos(2),
        links,
        (summary("p0", "p1"),),
        tables,
        (refined(1, tracks, failed, spread),),
        (Scatters(pairs=tuple(scatters)),),
        weighting,
    )


def values(report) -> dict:
    return {figure.name: figure.value for figure in report.figures}


def test_figures_of_two_photographs():
    found = values(results(100, failed=10).report)
    assert found["tie_points"] == 90 and found["observations"] == 180 and found["tie_points_in_three"] == 0
    assert found["rays_per_point"] == 2.0 and found["pairs_compared"] == found["pairs_accepted"] == 1
    assert found["tracks_in_conflict"] == 3 and found["refined_share"] == 0.9
    assert found["refined_sigma_px"] == 0.04 and found["refined_shift_px"] == 0.5
    assert found["connected_parts"] == 1 and found["fewest_in_photo"] == 90 and found["scatter_px"] == 0.2


def test_the_measured_scatter_enters_every_standard_error():
    points = results(100).tie_points
    reference, other = points.sigma[points.photo == 0], points.sigma[points.photo == 1]
    assert np.allclose(reference, 0.2) and np.allclose(other, np.hypot(0.2, 0.04))
    without = results(100, scatters=()).tie_points
    assert np.allclose(without.sigma[without.photo == 0], 0.03)


def test_unrefined_observations_are_kept_when_asked_for():
    points, counts, report = results(100, failed=10, unmatched="keep")
    assert (counts.points, counts.rays) == (100, len(points))
    assert values(report)["tie_points"] == 100
    wide = points.sigma[(points.photo == 1) & (points.track < 10)]
    assert np.allclose(wide, 0.7)


def test_outcomes_are_listed_by_their_sentences():
    (grid,) = (grid for grid in results(100, failed=10).report.grids if grid.title.startswith("Refinement"))
    assert dict(grid.rows) == {Outcome.CONVERGED.sentence: 90, Outcome.NOT_CONVERGED.sentence: 10}


def test_a_faultless_pair_gives_no_warning():
    assert results(100).report.warnings == ()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"count": 20}, "Fewer than 30 tie points in p0 (20), p1 (20)"),
        ({"spread": 0.3}, "less than a quarter of the frame of p0, p1"),
    ],
)
def test_poorly_connected_photographs_are_named(arguments, words):
    (warning,) = results(**arguments).report.warnings
    assert words in warning


def block(*shared: tuple[int, int, int], count: int) -> tuple[Photos, tuple[Observations, ...], tuple[Refined, ...]]:
    """Photographs that share points: (first, second, number of points) each, the first one their reference."""
    tracks: list[list[int]] = [[] for _ in range(count)]
    references: list[list[int]] = [[] for _ in range(count)]
    matched, first = [], 0
    for left, right, number in shared:
        own = list(range(first, first + number))
        for photo in (left, right):
            tracks[photo] += own
            references[photo] += [left] * number
        matched.append(refined(right, np.array(own)))
        first += number
    tables = [observations(np.array(own, dtype=int), np.array(of, dtype=int)) for own, of in zip(tracks, references, strict=True)]
    return photos(count), tuple(tables), tuple(matched)


def report_of(made, summaries):
    shown, tables, matched = made
    links = Links(pairs=(), tracks=0, conflicts=0)
    return finish(shown, links, summaries, tables, matched, (), Weighting(0.03, 0.7, "keep")).report


def test_a_divided_block_is_reported_with_its_smaller_part():
    report = report_of(block((0, 1, 60), (1, 2, 60), (3, 4, 60), count=5), (summary("p0", "p1"),))
    assert values(report)["connected_parts"] == 2
    (warning,) = (text for text in report.warnings if "divided" in text)
    assert report.doubts == (warning,)
    assert warning.endswith("2 parts without enough tie points between them. Not connected with the largest part: p3, p4.")


def test_fifteen_points_connect_parts_but_fourteen_do_not():
    for number, parts in ((15, 1), (14, 2)):
        made = block((0, 1, 60), (1, 2, number), (2, 3, 60), count=4)
        assert values(report_of(made, ()))["connected_parts"] == parts


def test_an_unconnected_photograph_is_named_but_a_duplicate_is_reported_as_such():
    alike = summary("p1", "p2", inliers=0, alike=True)
    warnings = report_of(block((0, 1, 60), count=4), (summary("p0", "p1"), alike)).warnings
    assert any(text.startswith("p1 and p2 are the same picture") for text in warnings)
    assert [text for text in warnings if "shows common ground" in text] == [
        "No other photograph shows common ground with p3: it will not join the block."
    ]


def test_photographs_from_one_place_are_told_in_one_sentence():
    alike = tuple(summary(left, right, inliers=0, alike=True) for left, right in (("p1", "p2"), ("p1", "p3"), ("p2", "p3")))
    warnings = report_of(block((0, 1, 60), count=4), (summary("p0", "p1"), *alike)).warnings
    (said,) = [text for text in warnings if "same picture" in text]
    assert said.startswith("p1 and p2, p3 are the same picture") and "only p1 takes part" in said
    assert not any("shows common ground" in text for text in warnings)


def test_pairs_are_listed_by_their_number_of_matches():
    pairs = (summary("p0", "p1", 40), summary("p1", "p2", 80), summary("p0", "p2", 0))
    report = report_of(block((0, 1, 60), (1, 2, 60), count=3), pairs)
    (grid,) = (grid for grid in report.grids if grid.title == "Pairs")
    assert [row[:2] for row in grid.rows] == [("p1", "p2"), ("p0", "p1")]
    assert grid.note == "1 more pairs were compared and show no common ground."
    (chart,) = (chart for chart in report.charts if chart.title.startswith("Matches"))
    assert chart.series["matches with the next"] == (40.0, 80.0)


def test_rays_are_counted_per_tie_point():
    photo = np.array([0, 1, 2, 0, 1, 1, 2], np.int32)
    track = np.array([0, 0, 0, 1, 1, 2, 2], np.int32)
    points = TiePoints(track, photo, np.full(7, 5.0), np.full(7, 5.0), np.ones(7, np.float32))
    strength = measure(points, photos(3))
    assert strength.rays.tolist() == [3, 2, 2] and strength.observations.tolist() == [2, 3, 2]
    assert strength.partners.tolist() == [0, 0, 0], "three points connect nothing"
    assert np.allclose(strength.coverage, 1 / 64)
