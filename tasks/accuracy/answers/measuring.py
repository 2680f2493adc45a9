"""Answers to what a user draws on the surface: spot heights, lines with their profiles, areas and volumes."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from orthomill.schemas.accuracy.surface_answers import (
    DrawnFeature,
    FeatureKind,
    MeasuredAnswers,
    MeasuredSource,
    MeasureRules,
    ProfilePoint,
    SurfaceAnswer,
    SurfaceCut,
)
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.accuracy.answers.datum_lattice import datum_lattice
from orthomill.tasks.accuracy.answers.error_correlation import LEAST, SIDES, ErrorCorrelation, correlation_from, window_products
from orthomill.tasks.accuracy.answers.line_answers import line_answer, profile_places, spot_height
from orthomill.tasks.accuracy.answers.linear_answer import SurfacePart, error_of
from orthomill.tasks.accuracy.answers.polygon_volumes import VolumeAnswer, area_of, crosses_itself, inside_share, volume_of

WINDOWS = 196
"""windows, spread over the surface, in which smooth ground is looked for"""
MOST_CELLS = 40_000_000
"""cells around one feature that are held in memory"""
_NOTHING = 0.01
"""m3, below which noise makes nothing that is worth a number"""
_ASKED: dict[FeatureKind, str] = {"point": "height", "line": "distance", "polygon": "volume"}
"""what a feature of a kind asks for first"""


def measure(surface: MeasuredSource, features: tuple[DrawnFeature, ...], rules: MeasureRules) -> MeasuredAnswers:
    """All answers about all features; one that is too large, crosses itself or lies off the surface has a note instead. Raises
    GeometryError where that holds for all."""
    correlation = surface_correlation(surface)
    answers: list[SurfaceAnswer] = []
    profiles: list[ProfilePoint] = []
    refused: list[GeometryError] = []
    for feature in features:
        try:
            window = _around(surface.grid, feature)
            part = _part(surface.read(window), window)
            if feature.kind == "point":
                answers.extend(_spot(feature, surface.grid, window, part, correlation))
            elif feature.kind == "line":
                answers.extend(_line(feature, surface.grid, window, part, correlation, rules))
                profiles.extend(_profile(feature, surface.grid, window, part, correlation, rules))
            else:
                answers.extend(_polygon(feature, surface, window, part, correlation, rules))
        except GeometryError as error:
            refused.append(error)
            answers.append(SurfaceAnswer(feature.name, _ASKED[feature.kind], math.nan, math.nan, "", note=str(error)))
    if refused and len(refused) == len(features):
        raise refused[0]
    return MeasuredAnswers(tuple(answers), tuple(profiles), correlation_words(correlation))


def surface_correlation(surface: MeasuredSource) -> ErrorCorrelation:
    """How errors of heights of a surface are correlated: those of neighbours from its own smooth ground, those of the datum from
    the block."""
    datum = None if surface.block is None else datum_lattice(surface.block, surface.grid)
    for side in SIDES:
        found = list(_smooth_windows(surface, side))
        if len(found) >= LEAST:
            return replace(correlation_from(found, side), datum=datum)
    return ErrorCorrelation(datum=datum)


def _smooth_windows(surface: MeasuredSource, side: int) -> Iterator[np.ndarray]:
    """Products of the smooth ones among some WINDOWS windows, spread over the surface."""
    grid = surface.grid
    across = max(1, math.isqrt(WINDOWS * grid.cols // max(grid.rows, 1)))
    down = max(1, WINDOWS // across)
    for i in range(down if min(grid.rows, grid.cols) >= side else 0):
        for j in range(across):
            row, col = i * (grid.rows - side) // max(down - 1, 1), j * (grid.cols - side) // max(across - 1, 1)
            cut = surface.read(Window(row, col, side, side))
            products = window_products(cut.height, cut.relative, cut.measured)
            if products is not None:
                yield products


def correlation_words(correlation: ErrorCorrelation) -> str:
    """Where the correlation comes from, in a sentence."""
    cells = f"{correlation.cells:.0f} cells count as one observation"
    if correlation.windows:
        known = f"as in {correlation.windows} windows of smooth ground of this surface, and no less than on a simulated town"
    else:
        known = "as on a simulated town, for this surface has too little smooth ground to tell"
    leaning = "leans and bends as the block's covariances say" if correlation.datum else "is one error, common to the block"
    common = f"{math.sqrt(correlation.common):.2f} of a standard error is common to all heights, as on simulated flights"
    return f"Errors of neighbouring heights are taken as correlated {known}: {cells}; {common}. The datum {leaning}."


def _part(cut: SurfaceCut, window: Window) -> SurfacePart:
    return SurfacePart(cut.height, cut.relative, cut.datum, cut.measured, (window.row, window.col))


def _around(grid: MapGrid, feature: DrawnFeature) -> Window:
    col, row = (np.asarray(values) for values in grid.pixel(feature.places[:, 0], feature.places[:, 1]))
    top, left = math.floor(row.min()) - 2, math.floor(col.min()) - 2
    window = Window(top, left, math.ceil(row.max()) + 3 - top, math.ceil(col.max()) + 3 - left).clipped(grid.shape)
    if window.empty:
        raise GeometryError(f"{feature.name} lies outside of the surface; look at its coordinates and at their system.")
    if window.cells > MOST_CELLS:
        raise GeometryError(
            f"{feature.name} spans {window.cells / 1e6:.0f} million cells, and {MOST_CELLS / 1e6:.0f} million is "
            "the most at a time; cut it into parts."
        )
    return window


def _pixels(grid: MapGrid, window: Window, places: np.ndarray) -> np.ndarray:
    """(N, 2) (col, row) within the window."""
    col, row = grid.pixel(places[:, 0], places[:, 1])
    return np.column_stack([np.asarray(col) - window.col, np.asarray(row) - window.row])


def _spot(
    feature: DrawnFeature, grid: MapGrid, window: Window, part: SurfacePart, correlation: ErrorCorrelation
) -> Iterator[SurfaceAnswer]:
    (col, row), *_ = _pixels(grid, window, feature.places)
    found = spot_height(part, float(col), float(row), correlation)
    if found is None:
        yield SurfaceAnswer(feature.name, "height", math.nan, math.nan, "m", note="the surface has no height here")
        return
    e = found.error
    note = "" if found.measured else "an estimate: no photograph measured this height"
    yield SurfaceAnswer(feature.name, "height", found.height, e.sigma, "m", e.measured, e.estimated, e.datum, note=note)


def _line(
    feature: DrawnFeature, grid: MapGrid, window: Window, part: SurfacePart, correlation: ErrorCorrelation, rules: MeasureRules
) -> Iterator[SurfaceAnswer]:
    found = line_answer(feature.places, _pixels(grid, window, feature.places), part, correlation, rules.corner)
    if found is None:
        yield SurfaceAnswer(feature.name, "distance", math.nan, math.nan, "m", note="an end of it has no height")
        return
    plan = "the corners' own errors; those that the whole block has in common are not in it"
    yield SurfaceAnswer(feature.name, "distance in plan", found.plan, found.plan_sigma, "m", note=plan)
    yield SurfaceAnswer(
        feature.name, "distance in space", found.space, found.space_sigma, "m", note="along the corners, with their heights"
    )
    yield SurfaceAnswer(feature.name, "rise", found.rise, found.rise_sigma, "m")
    yield SurfaceAnswer(feature.name, "slope", 100 * found.slope, 100 * found.slope_sigma, "%")


def _profile(
    feature: DrawnFeature, grid: MapGrid, window: Window, part: SurfacePart, correlation: ErrorCorrelation, rules: MeasureRules
) -> Iterator[ProfilePoint]:
    along, places = profile_places(feature.places, rules.step)
    for at, (x, y), (col, row) in zip(along, places, _pixels(grid, window, places), strict=True):
        found = spot_height(part, float(col), float(row), correlation)
        if found:
            yield ProfilePoint(feature.name, float(at), float(x), float(y), found.height, found.error.sigma, found.measured)


def _polygon(
    feature: DrawnFeature,
    surface: MeasuredSource,
    window: Window,
    part: SurfacePart,
    correlation: ErrorCorrelation,
    rules: MeasureRules,
) -> Iterator[SurfaceAnswer]:
    if crosses_itself(feature.places):
        raise GeometryError(f"The outline of {feature.name} crosses itself, so that it has no area; draw each of its parts.")
    grid = surface.grid
    share, *taken_out = (inside_share(_pixels(grid, window, ring), window.shape) for ring in (feature.places, *feature.holes))
    # Holes are subtracted from what is left: where drawings cross, nothing is taken out twice.
    for hole in taken_out:
        share = np.maximum(share - hole, 0.0)
    area, area_sigma = _area(feature, rules.corner)
    yield SurfaceAnswer(feature.name, "area in plan", area, area_sigma, "m2", note="the corners' own errors")
    base, words, other = _base(rules, window)
    if not (np.isfinite(part.height) & (share > 0)).any():
        yield SurfaceAnswer(feature.name, "volume", math.nan, math.nan, "m3", note="no heights inside")
        return
    found = volume_of(part, share, grid.cell, base, correlation)
    error = found.error
    if other is not None:
        error = replace(error, measured=math.hypot(error.measured, _of_base(other, window, share, grid.cell, correlation)))
    corners = _of_corners(feature, part, share, base, rules.corner, grid.cell)
    error = replace(error, plan=corners)
    note = "; ".join(filter(None, (words, *_reservations(found))))
    shares = error.measured, error.estimated, error.datum, error.plan
    yield SurfaceAnswer(feature.name, "volume", found.volume, error.sigma, "m3", *shares, note=note)
    noise = (
        f"noise alone would make {found.noise:.3g} m3 of each" if found.noise >= _NOTHING else "noise alone would make none of it"
    )
    yield SurfaceAnswer(feature.name, "cut", found.cut, found.cut_sigma, "m3", note=noise)
    yield SurfaceAnswer(feature.name, "fill", found.fill, found.fill_sigma, "m3", note=noise)


def _base(rules: MeasureRules, window: Window) -> tuple[np.ndarray | float | None, str, SurfaceCut | None]:
    """The base of a volume, what it is, and a base with errors of its own."""
    if rules.base is not None:
        cut = rules.base.read(window)
        known = np.isfinite(cut.relative).any()
        words = f"against {rules.base.words}" + ("" if known else ", whose own errors are not known and not in the standard error")
        return cut.height, words, cut if known else None
    if rules.level is not None:
        return rules.level, f"against the level {rules.level:g} m", None
    return None, "against the plane through its border", None


def _of_base(base: SurfaceCut, window: Window, share: np.ndarray, cell: float, correlation: ErrorCorrelation) -> float:
    """What another surface adds, with errors of its own; its datum is taken as independent."""
    weights = np.where(np.isfinite(base.height), share, 0.0) * cell**2
    return error_of(weights, _part(base, window), correlation).sigma


def _of_corners(
    feature: DrawnFeature, part: SurfacePart, share: np.ndarray, base: np.ndarray | float | None, sigma: float, cell: float
) -> float:
    """What corners that are off by `sigma` m do to the volume: the height above the base along the sides that they move."""
    if not sigma:
        return 0.0
    edge = (share > 0) & (share < 1) & np.isfinite(part.height)
    if base is None or not edge.any():
        return 0.0  # the plane passes through the border
    high = float(np.nanmean(np.abs(part.height[edge] - (base[edge] if isinstance(base, np.ndarray) else base))))
    return high * _area(feature, sigma)[1]


def _area(feature: DrawnFeature, sigma: float) -> tuple[float, float]:
    """Area in plan without the holes, m2, and its standard error."""
    (outer, error), *holes = (area_of(ring, sigma) for ring in (feature.places, *feature.holes))
    return outer - sum(area for area, _ in holes), math.hypot(error, *(of_hole for _, of_hole in holes))


def _reservations(found: VolumeAnswer) -> Iterator[str]:
    if found.missing > 0.005 * (found.area + found.missing):
        yield f"{found.missing:.3g} m2 without heights are not in it"
    if found.estimated > 0.01:
        yield f"{100 * found.estimated:.0f} % of its area rests on estimated heights"
