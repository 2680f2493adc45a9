"""Normalised correlation: the place in a search window most similar to the template, sub-pixel, with an outcome per point.

Strategy
- The template is the square about the pixel nearest to the left point. Sums and squares of all windows of the search area come
  from integral images, the products from OpenCV's Fourier transform, which is faster for search areas of 50 px and more.
  OpenCV's own normalisation is not used: it calls two flat windows equal.
- A place whose window touches missing data, or is flat, is no candidate. A maximum on the border of the search area is not
  bracketed: the true one may lie beyond, so it is rejected.
- Matching back, from the place found, must return to the point: the best guard against repeated patterns in wide search areas.
- The sub-pixel place is the peak of a paraboloid (sub_pixel.py); the fraction of a pixel of the left point is added.

Source: Karfis 2009 (sources/epipolar.md#correlation, #return); Lewis 1995 (integral images).
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.points.point_settings import TemplateCorrelation
from orthomill.tasks.matching.points.sub_pixel import paraboloid_peaks
from orthomill.tasks.matching.smoothing import with_gaps


@dataclass(frozen=True)
class Correlated:
    """One row per point. Where `outcome` is not CONVERGED, col and row are NaN."""

    col: np.ndarray
    row: np.ndarray
    """float64: position in the right image, px"""
    correlation: np.ndarray
    """float32: of the best place, NaN where there was no candidate"""
    outcome: np.ndarray
    """uint8: `orthomill.schemas.outcome.Outcome`"""

    @property
    def converged(self) -> np.ndarray:
        """(N,) bool"""
        return self.outcome == int(Outcome.CONVERGED)


class _BestPlace(NamedTuple):
    """The best place of a template: its pixel, the peak of the correlation from there (col, row), and the outcome."""

    outcome: Outcome
    col: int = 0
    row: int = 0
    correlation: float = np.nan
    peak: tuple[float, float] = (np.nan, np.nan)


def correlate(
    left: np.ndarray, right: np.ndarray, points: np.ndarray, starts: np.ndarray, settings: TemplateCorrelation
) -> Correlated:
    """Match points of the left image in search windows of the right one.

    left, right: (H, W) grey images of any dtype and any two sizes, 0 or NaN is no data. points, starts: (N, 2) (col, row) px, left
    positions and centres of the search windows. Never raises on the contents of images or points: every point gets its outcome.
    """
    left, right = with_gaps(left), with_gaps(right)
    points, starts = (np.asarray(values, dtype=np.float64).reshape(-1, 2) for values in (points, starts))
    values, outcome = np.full((len(points), 3), np.nan), np.zeros(len(points), np.uint8)
    for index, (point, start) in enumerate(zip(points, starts, strict=True)):
        found = _matched(left, right, point, start, settings)
        values[index, 2], outcome[index] = found.correlation, found.outcome
        if found.outcome == Outcome.CONVERGED:
            values[index, :2] = np.array([found.col, found.row]) + found.peak + (point - np.floor(point + 0.5))
    return Correlated(values[:, 0], values[:, 1], values[:, 2].astype(np.float32), outcome)


def _matched(
    left: np.ndarray, right: np.ndarray, point: np.ndarray, start: np.ndarray, settings: TemplateCorrelation
) -> _BestPlace:
    if not (np.isfinite(point).all() and np.isfinite(start).all() and np.abs([point, start]).max() < 1e9):
        return _BestPlace(Outcome.OUTSIDE)
    # Halves round up whatever the tile, as in least-squares matching.
    pixel, centre = np.floor(np.array([point, start]) + 0.5).astype(np.int64)
    found = _best(left, right, pixel, centre, settings)
    if found.outcome != Outcome.CONVERGED or settings.max_return is None:
        return found
    # Rounded places: the test is for repeated patterns, which are pixels away, not fractions.
    back = _best(right, left, np.array([found.col, found.row]), pixel, settings)
    returned = np.hypot(back.col - pixel[0], back.row - pixel[1]) <= settings.max_return
    return found if back.outcome == Outcome.CONVERGED and returned else found._replace(outcome=Outcome.INCONSISTENT)


def _best(image: np.ndarray, other: np.ndarray, pixel: np.ndarray, centre: np.ndarray, settings: TemplateCorrelation) -> _BestPlace:
    """The best place in `other`, about `centre`, of the template about `pixel` of `image`."""
    half, reach = settings.half, settings.reach
    template = _cut(image, pixel, half)
    if template.shape != (2 * half + 1, 2 * half + 1) or np.isnan(template).any():
        return _BestPlace(Outcome.OUTSIDE)
    if template.std(dtype=np.float64) < settings.min_deviation:
        return _BestPlace(Outcome.LOW_TEXTURE)
    search = _cut(other, centre, half + reach)
    if min(search.shape) < 2 * half + 1:
        return _BestPlace(Outcome.OUTSIDE)
    surface = correlation_surface(template, search, settings.min_deviation)
    if not (surface > -2.0).any():
        return _BestPlace(Outcome.LOW_TEXTURE if np.isneginf(surface).all() else Outcome.OUTSIDE)
    row, col = (int(place) for place in np.unravel_index(np.nanargmax(surface), surface.shape))
    # The search area was clipped at the border of the image: places count from where it really begins.
    first = np.maximum(centre - half - reach, 0) + half
    place = _BestPlace(
        Outcome.CONVERGED, int(first[0]) + col, int(first[1]) + row, float(surface[row, col]), _peak(surface, row, col)
    )
    return _judged(place, centre, settings)


def _judged(found: _BestPlace, centre: np.ndarray, settings: TemplateCorrelation) -> _BestPlace:
    """The place with the outcome that its correlation and its peak deserve."""
    if found.correlation < settings.min_correlation:
        return found._replace(outcome=Outcome.LOW_CORRELATION)
    if not np.isfinite(found.peak).all():
        at_limit = np.abs([found.col - centre[0], found.row - centre[1]]).max() == settings.reach
        return found._replace(outcome=Outcome.MOVED_TOO_FAR if at_limit else Outcome.OUTSIDE)
    return found


def _cut(image: np.ndarray, pixel: np.ndarray, half: int) -> np.ndarray:
    """The square about a pixel (col, row), as far as it lies in the image."""
    col, row = pixel
    return image[max(row - half, 0) : max(row + half + 1, 0), max(col - half, 0) : max(col + half + 1, 0)]


def correlation_surface(template: np.ndarray, search: np.ndarray, min_deviation: float) -> np.ndarray:
    """(H - n + 1, W - n + 1) float64 correlation of a template (n, n) with every window of a search area (H, W), both float32.

    NaN where a window touches NaN, -infinity where it is flatter than `min_deviation`.
    """
    gaps = np.isnan(search)
    # Centred grey values: the variance from sums of squares would lose its digits in float32.
    level = np.float32(np.nanmean(search)) if not gaps.all() else np.float32(0.0)
    centred = np.where(gaps, np.float32(0.0), search - level)
    pattern = template - template.mean()
    size = template.size
    sums, squares = (_window_sums(table, len(template)) for table in cv2.integral2(centred, sdepth=cv2.CV_64F))
    power = squares - sums * sums / size
    enough = power >= size * min_deviation**2
    surface = np.full(power.shape, -np.inf)
    norm = np.sqrt(power[enough] * np.square(pattern, dtype=np.float64).sum())
    # A centred template needs no mean of the window: the products of a constant with it vanish.
    surface[enough] = np.clip(cv2.matchTemplate(centred, pattern, cv2.TM_CCORR)[enough] / norm, -1.0, 1.0)
    if gaps.any():
        surface[_window_sums(cv2.integral(gaps.astype(np.uint8)), len(template)) > 0] = np.nan
    return surface


def _window_sums(integral: np.ndarray, side: int) -> np.ndarray:
    return integral[side:, side:] - integral[:-side, side:] - integral[side:, :-side] + integral[:-side, :-side]


def _peak(surface: np.ndarray, row: int, col: int) -> tuple[float, float]:
    """The peak of the correlation from its best pixel, (col, row); NaN where a neighbour has no correlation."""
    around = surface[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2]
    if around.shape != (3, 3) or not np.isfinite(around).all():
        return np.nan, np.nan
    x, y = paraboloid_peaks(around[None])[0]
    return float(x), float(y)
