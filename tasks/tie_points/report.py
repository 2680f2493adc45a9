"""The stage's last step: assembles the tie points and tells how well they hold the block together."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from orthomill.schemas.errors import some_of
from orthomill.schemas.observations import TiePoints
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.photo import Photos
from orthomill.schemas.stage_report import Chart, Figure, Grid, StageReport
from orthomill.tasks.tie_points.match_records import Links, Observations, PairSummary, Refined, Scatter
from orthomill.tasks.tie_points.tie_point_assembly import RefinementSummary, Weighting, assemble, with_measured_floor

_CELLS = 8
_GRUBER = 3
"""areas along each side of a frame (von Gruber)"""
_WEAK = 30
"""Tie points below which a photograph or a pair hangs on too little."""


@dataclass(frozen=True)
class Strength:
    """What the tie points say of each photograph (arrays by photograph number) and of the block."""

    observations: np.ndarray
    partners: np.ndarray
    """photographs that share `_WEAK` tie points or more"""
    coverage: np.ndarray
    """share of the frame's cells that hold a tie point"""
    block: np.ndarray
    """number of the connected part of the block; -1 for photographs without tie points"""
    rays: np.ndarray
    """photographs per tie point (by tie point)"""
    evenness: np.ndarray
    """distribution index: 1 when the nine von Gruber areas of the frame hold equally many tie points, 0 when one holds all"""


def finish(
    photos: Photos, links: Links, summaries: tuple[PairSummary, ...], observations: tuple[Observations, ...],
    refined: tuple[Refined, ...], scatters: tuple[Scatter, ...], weighting: Weighting,
) -> dict[str, Any]:  # fmt: skip
    """The tie points and the stage's report."""
    measured = with_measured_floor(weighting, scatters)
    points, summary = assemble(observations, refined, measured)
    strength = measure(points, photos)
    report = StageReport(
        figures=(*_figures(points, strength, links, summaries, summary), _floor_figure(measured)),
        grids=(_photo_grid(photos, strength), _pair_grid(summaries), _outcome_grid(summary)),
        charts=(_ray_chart(strength), _block_chart(photos, summaries)),
        warnings=tuple(_warnings(photos, strength, summaries)),
    )
    return {"tie_points": points, "report": report}


def measure(points: TiePoints, photos: Photos) -> Strength:
    """How strongly each photograph is tied."""
    count = len(photos.photos)
    shared = shared_points(points, count)
    observations = np.bincount(points.photo, minlength=count)
    _, block = connected_components(coo_array(shared >= _WEAK // 2), directed=False)
    frame = np.array([(photo.width, photo.height) for photo in photos.photos])
    cell = np.clip(np.column_stack([points.col, points.row]) / frame[points.photo] * _CELLS, 0, _CELLS - 1).astype(int)
    filled = np.unique(np.column_stack([points.photo, cell]), axis=0)[:, 0]
    return Strength(
        observations=observations,
        partners=(shared >= _WEAK).sum(axis=1),
        coverage=np.bincount(filled, minlength=count) / _CELLS**2,
        block=np.where(observations > 0, block, -1),
        rays=np.bincount(points.track),
        evenness=np.array([distribution_index(points.take(points.photo == number), size) for number, size in enumerate(frame)]),
    )


def distribution_index(own: TiePoints, size: np.ndarray) -> float:
    """How evenly the points of one photograph of `size` (width, height) fill its von Gruber areas: the entropy of their shares in
    units of that of equal shares."""
    if not len(own):
        return 0.0
    area = np.clip(np.column_stack([own.col, own.row]) / size * _GRUBER, 0, _GRUBER - 1).astype(int)
    count = np.bincount(area[:, 1] * _GRUBER + area[:, 0], minlength=_GRUBER**2)
    share = count[count > 0] / len(own)
    return float(-(share * np.log(share)).sum() / np.log(_GRUBER**2)) + 0.0


def shared_points(points: TiePoints, photos: int) -> np.ndarray:
    """(photos, photos) int: tie points that two photographs share; the diagonal is zero."""
    shows = coo_array(
        (np.ones(len(points), dtype=np.int64), (points.photo, points.track)), shape=(photos, points.track.max(initial=0) + 1)
    )
    shared = (shows.tocsr() @ shows.tocsr().T).toarray()
    np.fill_diagonal(shared, 0)
    return shared


def _figures(
    points: TiePoints, strength: Strength, links: Links, summaries: tuple[PairSummary, ...], summary: RefinementSummary
) -> tuple[Figure, ...]:
    tracks, many = len(strength.rays), int((strength.rays >= 3).sum())
    matched, tried = summary.outcomes.get(int(Outcome.CONVERGED), 0), sum(summary.outcomes.values())
    return (
        Figure(name="tie_points", value=tracks, sentence="Ground points that two or more photographs show.", headline=True),
        Figure(name="observations", value=len(points), sentence="Image measurements of them."),
        Figure(name="tie_points_in_three", value=many, sentence="Tie points in three or more photographs."),
        Figure(
            name="rays_per_point", value=round(float(strength.rays.mean()), 2), sentence="Photographs per tie point, on average."
        ),
        Figure(name="pairs_compared", value=len(summaries), sentence="Pairs of photographs compared."),
        Figure(name="pairs_accepted", value=sum(pair.accepted for pair in summaries), sentence="Pairs that show common ground."),
        Figure(
            name="tracks_in_conflict",
            value=links.conflicts,
            sentence="Tracks dropped because they met one photograph in two places.",
        ),
        Figure(
            name="refined_share",
            value=round(matched / max(tried, 1), 4),
            sentence="Share of observations refined by least squares.",
        ),
        Figure(
            name="refined_sigma_px",
            value=_rounded(summary.median_sigma),
            unit="px",
            sentence="Median formal sigma of the refinement.",
        ),
        Figure(name="refined_shift_px", value=_rounded(summary.median_shift), unit="px", sentence="Median move by the refinement."),
        Figure(
            name="connected_parts", value=_parts(strength), sentence="Parts of the block without enough tie points between them."
        ),
        Figure(
            name="distribution_index",
            value=_rounded(float(np.median(strength.evenness))),
            sentence="How evenly the nine von Gruber areas of a frame are filled, median over the photographs; 1: equally.",
        ),
        Figure(name="fewest_in_photo", value=int(strength.observations.min()), sentence="Tie points in the weakest photograph."),
    )


def _floor_figure(weighting: Weighting) -> Figure:
    sentence = "Scatter of refined points about their epipolar lines, which every observation's standard error includes."
    return Figure(name="scatter_px", value=round(weighting.floor, 4), unit="px", sentence=sentence)


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)


def _parts(strength: Strength) -> int:
    return len(np.unique(strength.block[strength.block >= 0]))


def _photo_grid(photos: Photos, strength: Strength) -> Grid:
    rows = tuple(
        (name, int(count), int(partners), round(100 * float(share)), round(float(even), 2))
        for name, count, partners, share, even in zip(
            photos.names, strength.observations, strength.partners, strength.coverage, strength.evenness, strict=True
        )
    )
    columns = ("photo", "tie points", "photographs tied to it", "frame covered (%)", "distribution index")
    return Grid(
        title="Photographs",
        columns=columns,
        rows=rows,
        note=f"Tied: {_WEAK} common tie points or more. Covered: of {_CELLS} x {_CELLS} cells. Distribution index: entropy of the "
        "nine von Gruber areas, 1 when all hold equally many.",
    )


def _pair_grid(summaries: tuple[PairSummary, ...]) -> Grid:
    accepted = sorted((pair for pair in summaries if pair.accepted), key=lambda pair: -pair.inliers)
    rows = tuple((pair.left, pair.right, pair.tentative, pair.inliers) for pair in accepted[:200])
    left_out = len(summaries) - len(accepted)
    note = f"{left_out} more pairs were compared and show no common ground." if left_out else ""
    return Grid(title="Pairs", columns=("left", "right", "matches", "on epipolar lines"), rows=rows, note=note)


def _outcome_grid(summary: RefinementSummary) -> Grid:
    rows = tuple((Outcome(code).sentence, count) for code, count in sorted(summary.outcomes.items()))
    return Grid(title="Refinement by least-squares matching", columns=("outcome", "observations"), rows=rows)


def _ray_chart(strength: Strength) -> Chart:
    counts = np.bincount(strength.rays)[2:]
    return Chart(
        title="Photographs per tie point", style="bars", x_label="photographs", y_label="tie points",
        x=tuple(float(rays) for rays in range(2, 2 + len(counts))), series={"tie points": tuple(float(count) for count in counts)},
    )  # fmt: skip


def _block_chart(photos: Photos, summaries: tuple[PairSummary, ...]) -> Chart:
    """Matches of neighbours in sequence: a gap shows where a strip hangs on little."""
    found = {(pair.left, pair.right): float(pair.inliers) for pair in summaries}
    values = tuple(found.get(pair, 0.0) for pair in pairwise(photos.names))
    return Chart(
        title="Matches between photographs that follow each other", style="bars", x_label="photograph number", y_label="matches",
        x=tuple(float(number) for number in range(1, 1 + len(values))), series={"matches with the next": values},
    )  # fmt: skip


def _warnings(photos: Photos, strength: Strength, summaries: tuple[PairSummary, ...]) -> list[str]:
    twins = {pair.right for pair in summaries if pair.alike}
    lonely = [name for name, count in zip(photos.names, strength.observations, strict=True) if count == 0 and name not in twins]
    weak = [f"{name} ({count})" for name, count in zip(photos.names, strength.observations, strict=True) if 0 < count < _WEAK]
    uneven = [
        name
        for name, share, count in zip(photos.names, strength.coverage, strength.observations, strict=True)
        if count and share < 0.25
    ]
    warnings = [
        f"{pair.left} and {pair.right} are the same picture, or two from one place: {pair.right} is left out, for it would only "
        "repeat the measurements of the other. Take one of them out of the project."
        for pair in summaries
        if pair.alike
    ]
    if lonely:
        they = "it" if len(lonely) == 1 else "they"
        warnings.append(f"No other photograph shows common ground with {some_of(lonely, most=10)}: {they} will not join the block.")
    if weak:
        warnings.append(f"Fewer than {_WEAK} tie points in {some_of(weak, most=10)}: expect a weak or failing orientation there.")
    if uneven:
        warnings.append(f"Tie points cover less than a quarter of the frame of {some_of(uneven, most=10)}.")
    if _parts(strength) > 1:
        warnings.append(_split(photos, strength))
    return warnings


def _split(photos: Photos, strength: Strength) -> str:
    parts = [
        [photos.names[number] for number in np.flatnonzero(strength.block == part)]
        for part in np.unique(strength.block)
        if part >= 0
    ]
    smaller = sorted(parts, key=len)[:-1]
    named = "; ".join(some_of(part, most=10) for part in smaller[:5])
    return (
        f"The block falls into {len(parts)} parts without enough tie points between them; apart from the largest part lie: {named}."
    )
