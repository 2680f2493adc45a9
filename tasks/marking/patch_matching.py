"""A mark carried to another photograph: searched by correlation about the place where it is expected, then by least squares.

The patch about the mark is turned, scaled and sheared as orientation (or the features around) say, so that neither turned
photographs nor other flying heights matter; gain and offset of the light are part of the correlation, and unknowns of the least
squares. Where another place within the search looks nearly as much like the patch, nothing is proposed: a person can tell rows of
paving stones apart by what lies around them, a patch cannot.

Source: Gruen 1985 for the least squares; Skarlatos (sources/matching.md#least-squares).
"""

from dataclasses import dataclass

import cv2
import numpy as np

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.least_squares.matching import match_points
from orthomill.tasks.matching.least_squares.model import LeastSquaresMatching

HALF = 12
"""px: half side of the patch, in the photograph that is searched"""
LEAST_CORRELATION = 0.7
RIVAL = 0.72
"""A place is refused where its lack of correlation (1 - r) is more than this share of that of the best other place."""
NOISE = 0.03
"""Lack of correlation that chance explains: between places that differ by less, it decides."""
APART = 5.0
"""px from the best place beyond which another one is a rival"""
LEAST_SEARCH, MOST_SEARCH = 4, 90
"""px"""
TWICE = 2.0
"""Least squares takes grey values of neighbouring pixels as independent; smoothed and resampled ones are not, and its standard
errors are about half of what they should be."""
LEAST_SIGMA = 0.05
"""px"""
SEARCHED = LeastSquaresMatching(window=2 * HALF + 1, min_correlation=0.6, min_gradient=0.3, max_shift=4.0)


@dataclass(frozen=True, eq=False)
class CarriedPatch:
    """A patch (h, w) about a mark at `place` (2,) (col, row) in it, the standard error `sigma` of the mark, px, and `affine` (2,
    2): from steps in its photograph to steps in the one that is searched."""

    grey: np.ndarray
    place: np.ndarray
    sigma: float
    affine: np.ndarray


@dataclass(frozen=True, eq=False)
class SearchedPatch:
    """A part (h, w) of the photograph that is searched, NaN outside of it, the expected `place` (2,) in it and its covariance (2,
    2) px^2."""

    grey: np.ndarray
    place: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class CarriedMark:
    """The `place` (2,) px in the searched part, its standard error, the correlation there, and the best one elsewhere; `refused`:
    why not, empty where nothing speaks against it."""

    place: np.ndarray
    sigma: float
    correlation: float
    rival: float
    refused: str = ""


NOWHERE = np.full(2, np.nan)


def search_radius(covariance: np.ndarray) -> int:
    """px about an expected place within which a mark is searched."""
    longest = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    return int(np.clip(np.ceil(3.0 * longest) + 3, LEAST_SEARCH, MOST_SEARCH))


def carried(marked: list[CarriedPatch], searched: SearchedPatch) -> CarriedMark:
    """The mark by all patches together: the place that most of them agree on."""
    found = [carried_from(one, searched) for one in marked]
    good = [one for one in found if not one.refused]
    if not good:
        return max(
            found, key=lambda one: one.correlation, default=CarriedMark(NOWHERE, np.inf, 0.0, 0.0, "there is no mark to match")
        )
    places, sigma = np.array([one.place for one in good]), np.array([one.sigma for one in good])
    middle = np.median(places, axis=0)
    best = max(good, key=lambda one: one.correlation)
    apart = np.linalg.norm(places - middle, axis=1)
    if (apart > np.maximum(1.0, 4.0 * sigma)).sum() * 2 > len(good) - (len(good) == 2):
        return CarriedMark(
            best.place, best.sigma, best.correlation, best.rival, "patches of different photographs find different places"
        )
    kept = apart <= np.maximum(1.0, 4.0 * sigma)
    weight = 1.0 / sigma[kept] ** 2
    place = (weight[:, None] * places[kept]).sum(axis=0) / weight.sum()
    # The patch that is searched is the same for all: only the errors of the marks average out.
    spread = max(float(np.sqrt(1.0 / weight.sum())), 0.5 * float(sigma[kept].min()), LEAST_SIGMA)
    return CarriedMark(place, spread, best.correlation, best.rival)


def carried_from(marked: CarriedPatch, searched: SearchedPatch) -> CarriedMark:
    """The mark of one patch in the searched part."""
    template = warped(marked)
    if not np.isfinite(template).all():
        return CarriedMark(NOWHERE, np.inf, 0.0, 0.0, "the patch leaves its photograph")
    found = _best_place(template, searched)
    if found is None:
        return CarriedMark(NOWHERE, np.inf, 0.0, 0.0, "the search leaves the photograph, or its patch has no texture")
    start, correlation, rival = found
    if correlation < LEAST_CORRELATION:
        return CarriedMark(start, np.inf, correlation, rival, f"correlation {correlation:.2f} only")
    if max(1.0 - correlation, NOISE) > RIVAL * (1.0 - rival):
        return CarriedMark(
            start, np.inf, correlation, rival, f"another place looks as much alike (correlation {rival:.2f} and {correlation:.2f})"
        )
    a = marked.affine
    match = match_points(
        np.where(np.isfinite(marked.grey), np.maximum(marked.grey, 0.5), np.nan).astype(np.float32),
        np.where(np.isfinite(searched.grey), np.maximum(searched.grey, 0.5), np.nan).astype(np.float32),
        marked.place[None],
        start[None],
        SEARCHED,
        affine=np.array([[a[0, 0], a[0, 1], a[1, 0], a[1, 1]]]),
        half=np.array([round(HALF / np.sqrt(max(abs(np.linalg.det(a)), 0.1)))]),
    )
    if match.outcome[0] != Outcome.CONVERGED:
        return CarriedMark(start, np.inf, correlation, rival, Outcome(int(match.outcome[0])).sentence)
    by_mark = marked.sigma * float(np.sqrt(max(abs(np.linalg.det(a)), 1e-3)))
    sigma = float(np.hypot(max(TWICE * float(match.sigma[0]), LEAST_SIGMA), by_mark))
    return CarriedMark(match.position[0], sigma, float(match.correlation[0]), rival)


def warped(marked: CarriedPatch) -> np.ndarray:
    """(2 HALF + 1, 2 HALF + 1) float32: the patch as the searched photograph would show it, the mark in its middle pixel."""
    back = np.linalg.inv(marked.affine)
    to_patch = np.column_stack([back, marked.place - back @ (HALF, HALF)])
    size = (2 * HALF + 1, 2 * HALF + 1)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(marked.grey, to_patch, size, flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=float("nan"))


def _best_place(template: np.ndarray, searched: SearchedPatch) -> tuple[np.ndarray, float, float] | None:
    """The place (2,) with the best correlation within three standard errors, that correlation, and the best of all other places."""
    radius = search_radius(searched.covariance)
    middle = np.round(searched.place).astype(int)
    reach = radius + HALF
    part = np.full((2 * reach + 1, 2 * reach + 1), np.nan, np.float32)
    top, left = middle[1] - reach, middle[0] - reach
    rows = slice(max(top, 0), min(top + len(part), searched.grey.shape[0]))
    cols = slice(max(left, 0), min(left + len(part), searched.grey.shape[1]))
    if rows.start >= rows.stop or cols.start >= cols.stop:
        return None
    part[rows.start - top : rows.stop - top, cols.start - left : cols.stop - left] = searched.grey[rows, cols]
    known = np.isfinite(part)
    if template.std() < 1.0 or not known.any():
        return None
    filled = np.where(known, part, np.float32(part[known].mean()))
    score = cv2.matchTemplate(filled, template.astype(np.float32), cv2.TM_CCOEFF_NORMED)
    whole = cv2.erode(known.astype(np.uint8), np.ones(template.shape, np.uint8))[HALF:-HALF, HALF:-HALF] > 0
    offset = np.indices(score.shape)[::-1].transpose(1, 2, 0) - radius + (middle - searched.place)
    spread = searched.covariance + np.eye(2)
    inside = np.einsum("rci,ij,rcj->rc", offset, np.linalg.inv(spread), offset) < 3.5**2
    score = np.where(whole & np.isfinite(score), score, -1.0)
    allowed = np.where(inside, score, -1.0)
    row, col = np.unravel_index(int(allowed.argmax()), allowed.shape)
    best = float(allowed[row, col])
    if best <= -1.0:
        return None
    rows_, cols_ = np.indices(score.shape)
    # Rivals are maxima: the slope of the best place is no place of its own.
    peaks = (score >= cv2.dilate(score.astype(np.float32), np.ones((3, 3), np.uint8)) - 1e-6) & inside
    far = np.hypot(rows_ - row, cols_ - col) > APART
    rival = float(score[peaks & far].max()) if (peaks & far).any() else -1.0
    return np.array([col, row], float) - radius + middle, best, rival
