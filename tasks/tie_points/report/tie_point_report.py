"""The stage's last step: assembles the tie points and reports how well they connect the block."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Literal, NamedTuple

from orthomill.schemas.errors import some_of
from orthomill.schemas.observations import TiePointCounts, TiePoints
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.photo import Photos
from orthomill.schemas.stage_report import Answer, Chart, Figure, Grid, StageReport, Topic, Verdict
from orthomill.tasks.tie_points.block_strength import FRAME_CELLS, WEAK, Strength, measure
from orthomill.tasks.tie_points.match_records import Links, Observations, PairSummary, Refined, Scatters
from orthomill.tasks.tie_points.repeated_photographs import repeated_photographs
from orthomill.tasks.tie_points.tie_point_assembly import RefinementSummary, Weighting, assemble, with_measured_floor

_LEAST_COVERAGE = 0.25  # of the frame; with less, distortion and attitude are extrapolated over most of it
_MOST_PAIRS = 200  # rows of the table of pairs, those with most matches
_MOST_PARTS = 5  # parts of a divided block that are listed


class TiePointResults(NamedTuple):
    """The tie points of all photographs, and the stage's report."""

    tie_points: TiePoints
    counts: TiePointCounts
    report: StageReport


def finish(
    photos: Photos,
    links: Links,
    summaries: tuple[PairSummary, ...],
    observations: tuple[Observations, ...],
    refined: tuple[Refined, ...],
    scatters: tuple[Scatters, ...],
    weighting: Weighting,
) -> TiePointResults:
    """The tie points and the stage's report."""
    measured = with_measured_floor(weighting, tuple(scatter for own in scatters for scatter in own.pairs))
    points, summary = assemble(observations, refined, measured)
    strength = measure(points, photos)
    report = StageReport(
        verdict=_verdict(strength),
        answers=(_answer(photos, strength),),
        doubts=tuple(_doubts(photos, strength)),
        losses=tuple(_other_warnings(photos, strength, summaries)),
        figures=(
            *_point_figures(points, strength),
            *_pair_figures(links, summaries),
            *_refinement_figures(summary),
            *_block_figures(strength),
            _floor_figure(measured),
        ),
        grids=(_photo_grid(photos, strength), _pair_grid(summaries), _outcome_grid(summary)),
        charts=(_ray_chart(strength), _block_chart(photos, summaries)),
        warnings=(*_doubts(photos, strength), *_other_warnings(photos, strength, summaries)),
    )
    counts = TiePointCounts(points=int(points.track.max(initial=-1)) + 1, rays=len(points))
    return TiePointResults(points, counts, report)


def _point_figures(points: TiePoints, strength: Strength) -> tuple[Figure, ...]:
    in_three = int((strength.rays >= 3).sum())
    per_point = round(float(strength.rays.mean()), 2)
    return (
        Figure(
            name="tie_points", value=len(strength.rays), sentence="Ground points that two or more photographs show.", headline=True
        ),
        Figure(name="observations", value=len(points), sentence="Image measurements of tie points."),
        # A point in two photographs is controlled in one direction only: along the epipolar line a gross error stays invisible.
        Figure(name="tie_points_in_three", value=in_three, sentence="Tie points in three or more photographs."),
        Figure(name="rays_per_point", value=per_point, sentence="Photographs per tie point, mean."),
    )


def _pair_figures(links: Links, summaries: tuple[PairSummary, ...]) -> tuple[Figure, ...]:
    accepted = sum(pair.accepted for pair in summaries)
    conflicts = "Tracks dropped because they meet one photograph in two places."
    return (
        Figure(name="pairs_compared", value=len(summaries), sentence="Pairs of photographs compared."),
        Figure(name="pairs_accepted", value=accepted, sentence="Pairs that show common ground."),
        Figure(name="tracks_in_conflict", value=links.conflicts, sentence=conflicts),
    )


def _refinement_figures(summary: RefinementSummary) -> tuple[Figure, ...]:
    matched, tried = summary.outcomes.get(int(Outcome.CONVERGED), 0), sum(summary.outcomes.values())
    share, sigma, shift = round(matched / max(tried, 1), 4), _rounded(summary.median_sigma), _rounded(summary.median_shift)
    return (
        Figure(name="refined_share", value=share, sentence="Share of observations refined by least-squares matching."),
        Figure(name="refined_sigma_px", value=sigma, unit="px", sentence="Median formal standard error of the refinement."),
        Figure(name="refined_shift_px", value=shift, unit="px", sentence="Median shift by the refinement."),
    )


def _block_figures(strength: Strength) -> tuple[Figure, ...]:
    parts, fewest = len(strength.parts), strength.fewest
    even = "How evenly the nine von Gruber areas of a frame are filled, median over the photographs; 1: equally."
    return (
        Figure(name="connected_parts", value=parts, sentence=_PARTS),
        Figure(name="distribution_index", value=_rounded(strength.median_evenness), sentence=even),
        Figure(name="fewest_in_photo", value=fewest, sentence="Tie points in the photograph with the fewest."),
    )


_PARTS = (
    f"Parts of the block with fewer than {WEAK // 2} tie points between them. That there are enough is all that is known before "
    "pairs are oriented: the orientation may find further groups."
)


def _floor_figure(weighting: Weighting) -> Figure:
    sentence = "Scatter of refined points about their epipolar lines, included in the standard error of every observation."
    return Figure(name="scatter_px", value=round(weighting.floor, 4), unit="px", sentence=sentence)


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)


def _photo_grid(photos: Photos, strength: Strength) -> Grid:
    rows = tuple(
        (name, int(count), int(partners), round(100 * float(share)), round(float(even), 2))
        for name, count, partners, share, even in zip(
            photos.names, strength.observations, strength.partners, strength.coverage, strength.evenness, strict=True
        )
    )
    columns = ("photo", "tie points", "connected photographs", "frame covered (%)", "distribution index")
    return Grid(
        title="Photographs",
        columns=columns,
        rows=rows,
        note=f"Connected: {WEAK} common tie points or more. Covered: of {FRAME_CELLS} x {FRAME_CELLS} cells. Distribution index: "
        "entropy of the nine von Gruber areas, 1 when all hold the same number.",
    )


def _pair_grid(summaries: tuple[PairSummary, ...]) -> Grid:
    accepted = sorted((pair for pair in summaries if pair.accepted), key=lambda pair: -pair.inliers)
    rows = tuple((pair.left, pair.right, pair.tentative, pair.inliers) for pair in accepted[:_MOST_PAIRS])
    left_out = len(summaries) - len(accepted)
    note = f"{left_out} more pairs were compared and show no common ground." if left_out else ""
    return Grid(title="Pairs", columns=("left", "right", "matches", "on epipolar lines"), rows=rows, note=note)


def _outcome_grid(summary: RefinementSummary) -> Grid:
    rows = tuple((Outcome(code).sentence, count) for code, count in sorted(summary.outcomes.items()))
    return Grid(title="Refinement by least-squares matching", columns=("outcome", "observations"), rows=rows)


def _ray_chart(strength: Strength) -> Chart:
    counts = strength.points_by_rays
    return Chart(
        title="Photographs per tie point",
        style="bars",
        x_label="photographs",
        y_label="tie points",
        x=tuple(float(rays) for rays in range(2, 2 + len(counts))),
        series={"tie points": tuple(float(count) for count in counts)},
    )


def _block_chart(photos: Photos, summaries: tuple[PairSummary, ...]) -> Chart:
    """Matches of neighbours in sequence: a low bar shows where a strip is poorly connected."""
    found = {(pair.left, pair.right): float(pair.inliers) for pair in summaries}
    values = tuple(found.get(pair, 0.0) for pair in pairwise(photos.names))
    return Chart(
        title="Matches between consecutive photographs",
        style="bars",
        x_label="photograph number",
        y_label="matches",
        x=tuple(float(number) for number in range(1, 1 + len(values))),
        series={"matches with the next": values},
    )


def _verdict(strength: Strength) -> Verdict:
    parts, fewest = len(strength.parts), strength.fewest
    connected = (
        "connect all photographs by their number"
        if parts == 1 and fewest
        else f"leave {parts} parts"
        if parts > 1
        else "leave some out"
    )
    level: Literal["good", "fair", "poor"] = "poor" if parts > 1 else "good" if fewest >= WEAK else "fair"
    weakest = f"the weakest photograph has {fewest}"
    return Verdict(level=level, sentence=f"{len(strength.rays)} tie points {connected}; {weakest}.")


def _answer(photos: Photos, strength: Strength) -> Answer:
    """Which photographs belong together; replaced by what the orientation makes of it."""
    tied = max(map(len, strength.parts), default=0)
    count = "all" if tied == len(photos.names) else f"{tied} of"
    return Answer(topic=Topic.PHOTOGRAPHS, text=f"{count} {len(photos.names)} tied to each other")


def _doubts(photos: Photos, strength: Strength) -> Iterator[str]:
    """A block in parts has a common place only by positions and control, whatever the adjustment says."""
    if len(strength.parts) > 1:
        yield _divided(photos, strength)


def _other_warnings(photos: Photos, strength: Strength, summaries: tuple[PairSummary, ...]) -> Iterator[str]:
    repeated = _repeated(photos, summaries)
    for stays, others in repeated.items():
        yield _same_picture(stays, others)
    counted = list(zip(photos.names, strength.observations, strength.coverage, strict=True))
    left_out = {name for others in repeated.values() for name in others}
    unconnected = [name for name, count, _ in counted if count == 0 and name not in left_out]
    if unconnected:
        they = "it" if len(unconnected) == 1 else "they"
        yield f"No other photograph shows common ground with {some_of(unconnected, most=10)}: {they} will not join the block."
    weak = [f"{name} ({count})" for name, count, _ in counted if 0 < count < WEAK]
    if weak:
        yield f"Fewer than {WEAK} tie points in {some_of(weak, most=10)}: expect a poorly determined or failing orientation there."
    uneven = [name for name, count, share in counted if count and share < _LEAST_COVERAGE]
    if uneven:
        yield (
            f"Tie points cover less than a quarter of the frame of {some_of(uneven, most=10)}: nothing holds the rest of it. More "
            "overlap on its empty side would; water and leaves give none."
        )


def _repeated(photos: Photos, summaries: tuple[PairSummary, ...]) -> dict[str, list[str]]:
    """Names of photographs that stay -> those that repeat them."""
    names = list(photos.names)
    pairs = [(names.index(summary.left), names.index(summary.right)) for summary in summaries]
    found = repeated_photographs(pairs, summaries, len(names))
    return {names[stays]: [names[other] for other in others] for stays, others in found.items()}


def _same_picture(stays: str, others: list[str]) -> str:
    if len(others) == 1:
        return (
            f"{stays} and {others[0]} are the same picture, or two from one place: {others[0]} is left out, for it would only "
            "repeat the measurements of the other. Remove one of them from the project."
        )
    return (
        f"{stays} and {some_of(others, most=10)} are the same picture, or taken from one place: only {stays} takes part, for the "
        "others would only repeat its measurements. Remove them from the project."
    )


def _divided(photos: Photos, strength: Strength) -> str:
    parts = [[photos.names[number] for number in part] for part in strength.parts]
    # Of two of one size the first is the largest, as it is for the orientation.
    largest = max(parts, key=len)
    smaller = sorted((part for part in parts if part is not largest), key=len)
    named = "; ".join(some_of(part, most=10) for part in smaller[:_MOST_PARTS])
    return (
        f"The block is divided into {len(parts)} parts without enough tie points between them. Not connected with the largest "
        f"part: {named}."
    )
