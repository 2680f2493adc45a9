"""The report of the epipolar stage: the pairs, their geometry, and how well homologous points share a row."""

import math
from collections.abc import Iterator
from statistics import median

from orthomill.schemas.epipolar import EpipolarPair, EpipolarPairs, epipolar_raster
from orthomill.schemas.observations import ImageResiduals
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture, StageReport, Verdict
from orthomill.tasks.epipolar.parallax import LEAST_POINTS, ROWS_AGREE, RowResiduals
from orthomill.tasks.epipolar.row_checks import CheckedRows, centres_and_footprints, checked_rows, mean_base_height

PARALLAX_LIMIT = 0.5
"""px: root mean square y-parallax beyond which matching along rows loses points"""
BAND_LIMIT = 1.0
"""px: predicted y-parallax beyond which homologous points leave the rows that matching looks at"""


def report(block: Block, pairs: EpipolarPairs, measured: ImageResiduals, photos: Photos) -> StageReport:
    """Tables, figures and warnings of the epipolar pairs; the y-parallaxes are those of tie points that the adjustment kept."""
    checked = checked_rows(block, pairs, measured, photos)
    rows, whole = checked.pairs, checked.whole
    return StageReport(
        verdict=_verdict(pairs, whole),
        losses=(*_level_warning(pairs), *_row_warnings(pairs, rows)),
        figures=_figures(pairs, whole),
        grids=(_pairs_grid(pairs), _residuals_grid(pairs, rows), *_not_used(pairs)),
        charts=(_map(block), _histogram(checked)),
        pictures=_pictures(pairs.pairs[0]),
        warnings=tuple(_warnings(block, pairs, rows)),
    )


def height_of_a_pixel(pair: EpipolarPair) -> float:
    """Height (m) of 1 px of x-parallax at the mean depth: (H / B) times the ground pixel."""
    parallax = (pair.parallax_low + pair.parallax_high) / 2
    return pair.base * pair.c / parallax**2


def _known(value: float, digits: int = 2) -> float | None:
    return round(value, digits) if math.isfinite(value) else None


_LABELS = {
    "y_parallax_rms": "Distance off the row (y-parallax), root mean square",
    "y_parallax_median": "The same, median",
    "y_parallax_max": "The same, largest",
    "row_band": "Predicted distance off the row",
}
"""what people call a figure whose name does not say it"""
_FIGURES = (
    ("pairs", "", "Pairs of photographs that are matched."),
    ("pairs_not_used", "", "Pairs that share ground but are not matched."),
    ("tie_points", "", "Tie points in the y-parallax check, over all pairs; those rejected by the adjustment are left out."),
    ("y_parallax_rms", "px", "Root mean square y-parallax of the tie points: how far homologous points lie off their common row."),
    ("y_parallax_median", "px", "Median of the absolute y-parallaxes."),
    ("y_parallax_max", "px", "Largest absolute y-parallax."),
    (
        "row_band",
        "px",
        "Standard error of the y-parallax that the precision of the orientation predicts, root mean square over the common ground "
        "of the worst pair; the measured y-parallaxes outweigh it.",
    ),
    ("level", "", "Level of the photographs that is matched: 0 as they are, 1 at half their size, 2 at a quarter."),
    ("base_height_mean", "", "Mean base over flying height of the pairs."),
    ("megapixels", "Mpx", "Total size of all epipolar images."),
)
"""name, unit and meaning of every figure, in the order of the report"""
_HEADLINES = ("pairs", "y_parallax_rms")


def _figures(pairs: EpipolarPairs, every: RowResiduals) -> tuple[Figure, ...]:
    used = pairs.pairs
    megapixels = sum(pair.rows * (pair.left_cols + pair.right_cols) for pair in used) / 1e6
    values: dict[str, float | int | None] = {
        "pairs": len(used),
        "pairs_not_used": len(pairs.not_used),
        "tie_points": every.points,
        "y_parallax_rms": _known(every.rms, 3),
        "y_parallax_median": _known(every.median, 3),
        "y_parallax_max": _known(every.greatest, 3),
        "row_band": _known(max(pair.row_sigma_predicted for pair in used), 3),
        "level": pairs.pairs[0].level,
        "base_height_mean": _known(mean_base_height(pairs), 3),
        "megapixels": round(megapixels, 1),
    }
    return tuple(
        Figure(
            name=name, label=_LABELS.get(name, ""), value=values[name], unit=unit, sentence=sentence, headline=name in _HEADLINES
        )
        for name, unit, sentence in _FIGURES
    )


_PAIR_COLUMNS = (
    "pair",
    "base (m)",
    "base/height",
    "rows",
    "columns left",
    "columns right",
    "smallest parallax (px)",
    "largest parallax (px)",
    "height of 1 px (m)",
)


def _pair_row(pair: EpipolarPair) -> tuple[float | int | str, ...]:
    return (
        pair.name,
        round(pair.base, 2),
        round(pair.base_height, 3),
        pair.rows,
        pair.left_cols,
        pair.right_cols,
        round(pair.parallax_low, 1),
        round(pair.parallax_high, 1),
        round(height_of_a_pixel(pair), 3),
    )


def _pairs_grid(pairs: EpipolarPairs) -> Grid:
    return Grid(
        title="Epipolar pairs",
        columns=_PAIR_COLUMNS,
        rows=tuple(map(_pair_row, pairs.pairs)),
        note="The height of 1 px is the height error caused by one pixel of x-parallax; least-squares matching measures to about a "
        "tenth to a third of a pixel.",
    )


def _residuals_grid(pairs: EpipolarPairs, rows: dict[str, RowResiduals]) -> Grid:
    return Grid(
        title="Y-parallax of the tie points",
        columns=("pair", "tie points", "mean (px)", "RMS (px)", "median (px)", "largest (px)", "predicted (px)", "used (px)"),
        rows=tuple(_residuals_row(pair, rows[pair.name]) for pair in pairs.pairs),
        note="Homologous points must lie on the same row. Predicted is the standard error that follows from the precision of both "
        "orientations, root mean square over the common ground. Used by the fusion of pairs is the measured level (1.48 times the "
        "median, tie points' own noise included), and the prediction where fewer than "
        f"{LEAST_POINTS} tie points connect the pair.",
    )


def _residuals_row(pair: EpipolarPair, found: RowResiduals) -> tuple[float | str | None, ...]:
    numbers = found.mean, found.rms, found.median, found.greatest, pair.row_sigma_predicted, pair.row_sigma
    return pair.name, found.points, *(_known(number, 3) for number in numbers)


def _not_used(pairs: EpipolarPairs) -> tuple[Grid, ...]:
    if not pairs.not_used:
        return ()
    return (Grid(title="Pairs that are not used", columns=("pair", "reason"), rows=pairs.not_used[:200]),)


def _map(block: Block) -> Chart:
    """Projection centres with their names, and points along the borders of the footprints."""
    x, y, centres = centres_and_footprints(block)
    return Chart(
        title="Projection centres and borders of the footprints",
        style="map",
        x_label="X (m)",
        y_label="Y (m)",
        x=x,
        series={"y": y},
        labels=(*block.names, *[""] * (len(x) - centres)),
        caption="Labelled points are projection centres; the others follow the borders of the photographs on the ground.",
    )


def _histogram(checked: CheckedRows) -> Chart:
    return Chart(
        title="Y-parallax of the tie points",
        style="bars",
        x_label="y-parallax (px)",
        y_label="measurements",
        x=checked.middles,
        series={"all pairs": checked.counts},
    )


def _pictures(pair: EpipolarPair) -> tuple[Picture, ...]:
    caption = "Homologous points lie on the same row of the left and the right image; black is outside the photograph."
    return tuple(
        Picture(
            title=f"Epipolar image, {side} of {pair.name}",
            raster=epipolar_raster(pair.name, side),
            style="ramp",
            colours="gray",
            low=0,
            high=255,
            caption=caption,
        )
        for side in ("left", "right")
    )


def _verdict(pairs: EpipolarPairs, whole: RowResiduals) -> Verdict:
    many = f"{len(pairs.pairs)} pairs are matched"
    if not whole.points:
        return Verdict(level="fair", sentence=f"{many}; no tie points check how well their rows fit.")
    fits = whole.rms <= PARALLAX_LIMIT
    words = f"{many}; homologous points lie {whole.rms:.2f} px off their common row (root mean square)"
    return Verdict(level="good" if fits else "fair", sentence=f"{words}{'' if fits else f', more than {PARALLAX_LIMIT} px'}.")


def _warnings(block: Block, pairs: EpipolarPairs, rows: dict[str, RowResiduals]) -> Iterator[str]:
    yield from _level_warning(pairs)
    yield from _row_warnings(pairs, rows)
    unchecked = [pair.name for pair in pairs.pairs if not rows[pair.name].points]
    if unchecked:
        yield f"No tie points connect {', '.join(unchecked)} directly: their y-parallax could not be checked."
    used = {name for pair in pairs.pairs for name in (pair.left, pair.right)}
    idle = [name for name in block.names if name not in used]
    if idle:
        yield f"In no pair, and therefore without contribution to the surface: {', '.join(idle)}."


def _level_warning(pairs: EpipolarPairs) -> Iterator[str]:
    level = pairs.pairs[0].level
    rows = median(pair.row_sigma for pair in pairs.pairs) * 2**level
    if level and rows > ROWS_AGREE:
        yield (
            f"The photographs do not fit together to a pixel: homologous points lie {rows:.1f} px off their row (median pair). So "
            f"the surface is matched at 1/{2**level} of their size, with cells {2**level} times as large. A stabiliser or a moving "
            "lens, a shutter that exposes line by line, or a lens that the camera model does not follow does that: switch "
            "stabilisation off, fix focus and zoom, or calibrate the camera."
        )


def _row_warnings(pairs: EpipolarPairs, rows: dict[str, RowResiduals]) -> Iterator[str]:
    measured = [(pair.name, rows[pair.name]) for pair in pairs.pairs]
    off_row = {name: row.rms for name, row in measured if row.points and row.rms > PARALLAX_LIMIT}
    if off_row:
        yield (
            f"Homologous points lie off their row by more than {PARALLAX_LIMIT} px (root mean square) in "
            f"{_worst(off_row, len(pairs.pairs))}: the orientation or the lens distortion does not fit there, "
            "or tie points are wrong; matching will lose points."
        )
    # The prediction warns only where nothing was measured: measured y-parallaxes outweigh a pessimistic covariance.
    unmeasured = [pair for pair in pairs.pairs if not rows[pair.name].points]
    wide = {pair.name: pair.row_sigma_predicted for pair in unmeasured if pair.row_sigma_predicted > BAND_LIMIT}
    if wide:
        yield (
            "The precision of the orientation predicts y-parallaxes of more than one row, and no tie points check them, "
            f"in {_worst(wide, len(pairs.pairs))}; more or better distributed tie points or control would help."
        )


def _worst(values: dict[str, float], pairs: int) -> str:
    """The number of pairs, and the three worst of them."""
    worst = sorted(values, key=values.__getitem__, reverse=True)[:3]
    return f"{len(values)} of {pairs} pairs (worst: {', '.join(f'{name} {values[name]:.2f} px' for name in worst)})"
