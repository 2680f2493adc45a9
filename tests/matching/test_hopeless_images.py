"""Every way of matching meets every bad image: an outcome for each point, nothing that is not a number passes as a match.

Images are spoilt in one place or everywhere, on the left, on the right or on both; points and starts lie on the border, outside,
or are no numbers. What can be matched next to them still is.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from benchmarks.matching.published_recipe import published
from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.dense.dense_settings import DenseMatching
from orthomill.tasks.matching.dense.pair_surface import ParallaxCode, match_pair
from orthomill.tasks.matching.least_squares.least_squares_settings import Ellipse, Forward, LeastSquaresMatching
from orthomill.tasks.matching.least_squares.matching import match_points
from orthomill.tasks.matching.points.correlation import correlate
from orthomill.tasks.matching.points.point_settings import TemplateCorrelation
from orthomill.tasks.matching.strategies.cascade import match_cascade
from orthomill.tasks.matching.strategies.cascade_settings import CascadeMatching
from orthomill.tasks.matching.strategies.coarse_to_fine import SearchRange, match_pyramid
from orthomill.tasks.matching.strategies.growing_settings import RegionGrowing
from orthomill.tasks.matching.strategies.node_grid import ImagePart, NodeGrid
from orthomill.tasks.matching.strategies.pyramid_settings import PyramidMatching
from orthomill.tasks.matching.strategies.region_growing import Seeds, found_seeds, grow

SIDE, PARALLAX = 192, 3
"""px; column left - column right"""


class Found(NamedTuple):
    """What a method made of its points: their left (N, 2) and right (N, 2) positions, px, and outcomes (N,)."""

    points: np.ndarray
    right: np.ndarray
    outcome: np.ndarray


def texture(seed: int) -> np.ndarray:
    grey = gaussian_filter(np.random.default_rng(seed).normal(0, 1, (SIDE, SIDE + PARALLAX)), 1.5)
    return np.clip(120 + 40 * grey / grey.std(), 1, 255)


WIDE = texture(4)
LEFT, RIGHT, OTHER = WIDE[:, :SIDE], WIDE[:, PARALLAX:], texture(5)[:, :SIDE]
GRID = NodeGrid.within(ImagePart(LEFT), 16)
POINTS = np.vstack([GRID.points(), [[np.nan, 50], [50, np.inf], [-1e18, 50], [-30, 50], [500, 50]]])


def starts() -> np.ndarray:
    """Good to half a pixel, but for some that lie outside or are no numbers."""
    good = POINTS - [PARALLAX - 0.5, 0.3]
    good[5:9] = [[np.nan, 50], [1e18, 50], [-40, 50], [50, 900]]
    return good


def by_points(settings: LeastSquaresMatching) -> Callable[[np.ndarray, np.ndarray], Found]:
    def match(left, right):
        found = match_points(left, right, POINTS, starts(), settings)
        return Found(POINTS, found.position, found.outcome)

    return match


def by_cascade(left, right):
    found = match_cascade(left, right, POINTS, starts(), CascadeMatching())
    return Found(POINTS, found.position, found.outcome)


def by_correlation(left, right):
    found = correlate(left, right, POINTS, starts(), TemplateCorrelation(template=15, search=31))
    return Found(POINTS, np.column_stack([found.col, found.row]), found.outcome)


def by_growing(left, right):
    seeds = Seeds(POINTS[40:44], starts()[40:44])
    found = grow(ImagePart(left), ImagePart(right), GRID, seeds, RegionGrowing(region=0))
    return Found(GRID.points(), found.position, found.outcome)


def by_growing_from_found_seeds(left, right):
    parts, settings = (ImagePart(left), ImagePart(right)), RegionGrowing(region=6)
    seeds = found_seeds(*parts, GRID, SearchRange(-8, 2), settings, PyramidMatching(levels=2))
    found = grow(*parts, GRID, seeds, settings)
    return Found(GRID.points(), found.position, found.outcome)


def by_pyramid(left, right):
    found = match_pyramid(ImagePart(left), ImagePart(right), GRID, SearchRange(-8, 2), PyramidMatching(levels=2))
    return Found(GRID.points(), found.position, found.outcome)


def by_pair(left, right):
    """A pair needs the same rows: an image of another size is put into one, zeros around."""
    whole = []
    for image in (left, right):
        padded = np.zeros((SIDE, SIDE), image.dtype)
        padded[: image.shape[0], : image.shape[1]] = image[:SIDE, :SIDE]
        whole.append(padded)
    found = match_pair(*whole, -8.0, 16.0, DenseMatching(step=4))
    rows, cols = np.mgrid[0:SIDE:4, 0:SIDE:4]
    points = np.column_stack([cols.ravel(), rows.ravel()]).astype(float)
    matched = (found.outcome == Outcome.CONVERGED).ravel() & (found.code == ParallaxCode.MEASURED).ravel()
    parallax = np.where(matched, found.parallax.ravel().astype(float), np.nan)
    outcome = np.where(matched | (found.outcome.ravel() != Outcome.CONVERGED), found.outcome.ravel(), Outcome.OCCLUDED)
    return Found(points, points - np.column_stack([parallax, np.where(matched, 0.0, np.nan)]), outcome)


METHODS = {
    "inverse-compositional": by_points(LeastSquaresMatching()),
    "inverse-compositional ellipse": by_points(LeastSquaresMatching(shape=Ellipse())),
    "forward": by_points(LeastSquaresMatching(formulation=Forward())),
    "published square": by_points(published(21, limited=False)),
    "mirrored windows let on": by_points(
        published(21, limited=False).model_copy(update={"formulation": Forward(gradients="window_right", max_area_change=None)})
    ),
    "published ellipse": by_points(published(21, Ellipse(), limited=False)),
    "cascade": by_cascade,
    "correlation": by_correlation,
    "region growing": by_growing,
    "region growing, seeds found": by_growing_from_found_seeds,
    "pyramid": by_pyramid,
    "dense": by_pair,
}


def spoilt(grey: np.ndarray, value: float) -> np.ndarray:
    out = grey.astype(np.float32)
    out[np.random.default_rng(0).random(grey.shape) < 2e-4] = value
    return out


GOOD = {
    "8 bits": lambda grey: grey.astype(np.uint8),
    "16 bits": lambda grey: (grey * 200).astype(np.uint16),
    "gaps": lambda grey: spoilt(grey, np.nan),
}
HOPELESS = {
    "constant": lambda grey: np.full_like(grey, 90.0),
    "no data": lambda grey: np.zeros(grey.shape, np.uint8),
    "not a number": lambda grey: np.full(grey.shape, np.nan, np.float32),
    "nothing at all": lambda grey: np.empty((0, 0), np.float32),
    "one pixel": lambda grey: np.full((1, 1), 80, np.uint8),
    "a row": lambda grey: grey[:1].astype(np.uint8),
}
ODD = {
    "infinite": lambda grey: spoilt(grey, np.inf),
    "enormous": lambda grey: (grey * 1e30).astype(np.float32),
    "tiny": lambda grey: (grey * 1e-30).astype(np.float32),
    "smaller": lambda grey: grey[:100, :90].astype(np.uint8),
    "of another place": lambda grey: OTHER.astype(np.uint8),
    "negative": lambda grey: (grey - 300).astype(np.float32),
}


def checked(found: Found) -> Found:
    """The same, when every point has an outcome and a position just when it is matched."""
    count = len(found.points)
    assert found.right.shape == (count, 2) and found.outcome.shape == (count,)
    assert {int(code) for code in found.outcome} <= {int(code) for code in Outcome}
    matched = found.outcome == Outcome.CONVERGED
    assert (np.isfinite(found.right).all(axis=1) == matched).all()
    assert not np.isfinite(found.right[~matched]).any()
    assert np.isfinite(found.points[matched]).all()
    return found


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("depth", GOOD)
def test_good_points_next_to_bad_ones_are_matched(method, depth):
    found = checked(METHODS[method](GOOD[depth](LEFT), GOOD[depth](RIGHT)))
    matched = found.outcome == Outcome.CONVERGED
    inside = ((found.points > 48) & (found.points < SIDE - 48)).all(axis=1)
    assert matched[inside].mean() > (0.15 if depth == "gaps" else 0.9)
    errors = found.right[matched] - found.points[matched] + [PARALLAX, 0.0]
    assert np.abs(errors).max() < 0.5 and (found.right[matched] > -0.5).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", [*HOPELESS, *ODD])
def test_bad_images_end_with_outcomes(method, kind):
    spoil, hopeless = {**HOPELESS, **ODD}[kind], kind in HOPELESS
    for left, right in ((spoil(LEFT), RIGHT.astype(np.uint8)), (LEFT.astype(np.uint8), spoil(RIGHT)), (spoil(LEFT), spoil(RIGHT))):
        found = checked(METHODS[method](left, right))
        assert not (hopeless and (found.outcome == Outcome.CONVERGED).any())


@pytest.mark.parametrize("settings", [LeastSquaresMatching(), published(21), published(21, Ellipse())])
def test_no_points_no_matches(settings):
    none = np.empty((0, 2))
    image = LEFT.astype(np.uint8)
    assert len(match_points(image, image, none, none, settings)) == 0
    assert len(match_cascade(image, image, none, none, CascadeMatching(find=settings))) == 0
    assert len(correlate(image, image, none, none, TemplateCorrelation()).outcome) == 0
    empty = NodeGrid(0, 0, 0, 0, 8)
    assert len(match_pyramid(ImagePart(image), ImagePart(image), empty, SearchRange(-8, 2), PyramidMatching())) == 0
    assert len(grow(ImagePart(image), ImagePart(image), empty, Seeds(none, none), RegionGrowing())) == 0
