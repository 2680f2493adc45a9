"""What the epipolar stage tells people: the pairs, their geometry, and how well homologous points share a row."""

import math

import numpy as np

from orthomill.schemas.epipolar import EpipolarPair, EpipolarPairs, epipolar_raster
from orthomill.schemas.observations import ImageResiduals
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture, StageReport
from orthomill.tasks.epipolar.parallax import RowResiduals, row_residuals, summary
from orthomill.tasks.geometry.normal_case import border_pixels
from orthomill.tasks.geometry.view import block_view

PARALLAX_LIMIT = 0.5
"""px: root mean square y-parallax above which matching along rows loses points"""
BAND_LIMIT = 1.0
"""px: half-width of the row band that matching along rows can bear"""


def report(block: Block, pairs: EpipolarPairs, measured: ImageResiduals, photos: Photos) -> StageReport:
    """Tables, figures and warnings of the epipolar pairs; y-parallaxes are of the tie points that the block adjustment kept."""
    ties = measured.take(measured.used & (measured.track >= 0))
    residuals = {pair.name: row_residuals(pair, block, ties, photos.names) for pair in pairs.pairs}
    rows = {name: summary(values) for name, values in residuals.items()}
    return StageReport(
        figures=_figures(pairs, summary(np.concatenate(list(residuals.values())))),
        grids=(_pairs_grid(pairs), _residuals_grid(pairs, rows), *_not_used(pairs)),
        charts=(_map(block), _histogram(residuals)),
        pictures=_pictures(pairs.pairs[0]),
        warnings=tuple(_warnings(block, pairs, rows)),
    )


def height_of_a_pixel(pair: EpipolarPair) -> float:
    """Height (m) that 1 px of x-parallax stands for, at the mean depth: (H / B) times the ground pixel."""
    parallax = (pair.parallax_low + pair.parallax_high) / 2
    return pair.base * pair.c / parallax**2


def _known(value: float, digits: int = 2) -> float | None:
    return round(value, digits) if math.isfinite(value) else None


def _figures(pairs: EpipolarPairs, every: RowResiduals) -> tuple[Figure, ...]:
    used = pairs.pairs
    megapixels = sum(pair.rows * (pair.left_cols + pair.right_cols) for pair in used) / 1e6
    return (
        Figure(name="pairs", value=len(used), sentence="Pairs of photographs that are matched.", headline=True),
        Figure(name="pairs_not_used", value=len(pairs.not_used), sentence="Pairs that share ground but are not matched."),
        Figure(
            name="tie_points",
            value=every.points,
            sentence="Tie points in the y-parallax check, over all pairs; those that the adjustment rejected are left out.",
        ),
        Figure(
            name="y_parallax_rms",
            value=_known(every.rms, 3),
            unit="px",
            headline=True,
            sentence="Root mean square y-parallax of the tie points: how far homologous points leave their common row.",
        ),
        Figure(name="y_parallax_median", value=_known(every.median, 3), unit="px", sentence="Median of the absolute y-parallaxes."),
        Figure(name="y_parallax_max", value=_known(every.greatest, 3), unit="px", sentence="Greatest absolute y-parallax."),
        Figure(
            name="row_band",
            value=_known(max(pair.row_sigma for pair in used), 3),
            unit="px",
            sentence="Half-width of the row band that the orientation's precision lets expect, in the weakest corner of the "
            "worst pair; corners without tie points are uncertain.",
        ),
        Figure(
            name="base_height_mean",
            value=_known(float(np.mean([pair.base_height for pair in used])), 3),
            sentence="Mean base over flying height of the pairs.",
        ),
        Figure(name="megapixels", value=round(megapixels, 1), unit="Mpx", sentence="Size of all epipolar images together."),
    )


def _pairs_grid(pairs: EpipolarPairs) -> Grid:
    rows = tuple(
        (
            p.name,
            round(p.base, 2),
            round(p.base_height, 3),
            p.rows,
            p.left_cols,
            p.right_cols,
            round(p.parallax_low, 1),
            round(p.parallax_high, 1),
            round(height_of_a_pixel(p), 3),
        )
        for p in pairs.pairs
    )
    return Grid(
        title="Epipolar pairs",
        rows=rows,
        columns=(
            "pair",
            "base (m)",
            "base/height",
            "rows",
            "columns left",
            "columns right",
            "least parallax (px)",
            "greatest parallax (px)",
            "height of 1 px (m)",
        ),
        note="The height of 1 px is what an error of one pixel in the x-parallax does to the height; "
        "matching by least squares measures about a tenth to a third of a pixel.",
    )


def _residuals_grid(pairs: EpipolarPairs, rows: dict[str, RowResiduals]) -> Grid:
    return Grid(
        title="Y-parallax of the tie points",
        columns=("pair", "tie points", "mean (px)", "RMS (px)", "median (px)", "greatest (px)", "row band (px)"),
        rows=tuple(_residuals_row(pair, rows[pair.name]) for pair in pairs.pairs),
        note="Homologous points must lie on the same row. The row band is what the precision of both orientations lets expect in "
        "the weakest corner of the common ground; what was measured holds where tie points lie, their own noise included.",
    )


def _residuals_row(pair: EpipolarPair, found: RowResiduals) -> tuple[float | str | None, ...]:
    numbers = found.mean, found.rms, found.median, found.greatest, pair.row_sigma
    return pair.name, found.points, *(_known(number, 3) for number in numbers)


def _not_used(pairs: EpipolarPairs) -> tuple[Grid, ...]:
    if not pairs.not_used:
        return ()
    return (Grid(title="Pairs that are not used", columns=("pair", "reason"), rows=pairs.not_used[:200]),)


def _map(block: Block) -> Chart:
    """Projection centres with their names, and the corners of the footprints."""
    mean = (block.ground_low + block.ground_high) / 2
    corners = [block_view(block, name).at_height(border_pixels(block_view(block, name))[::4], mean) for name in block.names]
    points = np.vstack([[photo.centre for photo in block.photos], *corners])
    points = points[np.isfinite(points).all(axis=1)]
    labels = (*block.names, *[""] * (len(points) - len(block.names)))
    return Chart(
        title="Projection centres and borders of the footprints",
        style="map",
        x_label="X (m)",
        y_label="Y (m)",
        x=tuple(points[:, 0].round(2).tolist()),
        series={"y": tuple(points[:, 1].round(2).tolist())},
        labels=labels,
        caption="Named points are projection centres; the others lie along the borders of the photographs on the ground.",
    )


def _histogram(residuals: dict[str, np.ndarray]) -> Chart:
    every = np.concatenate(list(residuals.values()))
    edges = np.linspace(-2.0, 2.0, 41)
    counts, _ = np.histogram(np.clip(every, -2.0, 2.0), edges)
    return Chart(
        title="Y-parallax of the tie points",
        style="bars",
        x_label="y-parallax (px)",
        y_label="measurements",
        x=tuple(((edges[:-1] + edges[1:]) / 2).round(3).tolist()),
        series={"all pairs": tuple(map(float, counts))},
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


def _warnings(block: Block, pairs: EpipolarPairs, rows: dict[str, RowResiduals]):
    measured = [(pair.name, rows[pair.name]) for pair in pairs.pairs]
    off_row = {name: row.rms for name, row in measured if row.points and row.rms > PARALLAX_LIMIT}
    if off_row:
        yield (
            f"Homologous points leave their row by more than {PARALLAX_LIMIT} px (root mean square) in "
            f"{_worst(off_row, len(pairs.pairs))}: the orientation or the lens distortion does not fit there, "
            "or tie points are wrong; matching will lose points."
        )
    wide = {pair.name: pair.row_sigma for pair in pairs.pairs if pair.row_sigma > BAND_LIMIT and not rows[pair.name].points}
    if wide:
        yield (
            f"No tie points check, and the precision of the orientation lets expect, y-parallaxes of more than one row in "
            f"{_worst(wide, len(pairs.pairs))}; more or better distributed tie points or control would help."
        )
    unchecked = [pair.name for pair in pairs.pairs if not rows[pair.name].points]
    if unchecked:
        yield f"No tie points connect {', '.join(unchecked)} directly: their y-parallax could not be checked."
    used = {name for pair in pairs.pairs for name in (pair.left, pair.right)}
    idle = [name for name in block.names if name not in used]
    if idle:
        yield f"In no pair, and so of no help to measure the surface: {', '.join(idle)}."


def _worst(values: dict[str, float], pairs: int) -> str:
    """How many pairs, and the three worst of them."""
    worst = sorted(values, key=values.__getitem__, reverse=True)[:3]
    return f"{len(values)} of {pairs} pairs (worst: {', '.join(f'{name} {values[name]:.2f} px' for name in worst)})"
