"""Heights, lines, areas and volumes with their standard errors, against what they must be."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from orthomill.schemas.accuracy.surface_answers import DrawnFeature, MeasureRules, SurfaceCut
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.accuracy.answers.error_correlation import ErrorCorrelation, correlation_from, window_products
from orthomill.tasks.accuracy.answers.line_answers import bilinear_weights, spot_height
from orthomill.tasks.accuracy.answers.linear_answer import SurfacePart, error_of
from orthomill.tasks.accuracy.answers.measuring import measure
from orthomill.tasks.accuracy.answers.polygon_volumes import area_of, crosses_itself, inside_share, volume_of

RNG = np.random.default_rng(11)
SMOOTH = 3.0
"""cells: sigma of the filter that correlates the noise"""
ALONE = ErrorCorrelation((0.0, 1.0), (1.0, 0.0), common=0.0)


def noise(shape, sigma=0.05):
    field = gaussian_filter(RNG.normal(0, 1, shape), SMOOTH, mode="wrap")
    return sigma * field / field.std()


def gaussian_correlation():
    distances = np.arange(0.0, 20.0)
    return ErrorCorrelation(tuple(distances), tuple(np.exp(-(distances**2) / (4 * SMOOTH**2))), common=0.0)


def part(height, sigma=0.05, datum=0.0, measured=True):
    height = np.asarray(height, float)
    full = np.ones(height.shape)
    return SurfacePart(height, sigma * full, datum * full, np.full(height.shape, measured))


def test_a_volume_is_as_sure_as_its_correlated_errors_allow():
    share = inside_share(np.array([[20, 20], [100, 30], [90, 100], [30, 80]], float), (128, 128))
    errors = [volume_of(part(noise((128, 128))), share, 0.5, 0.0, gaussian_correlation()) for _ in range(80)]
    ratios = np.array([found.volume / found.error.sigma for found in errors])
    assert 0.8 < np.sqrt((ratios**2).mean()) < 1.2
    independent = volume_of(part(np.zeros((128, 128))), share, 0.5, 0.0, ALONE).error.sigma
    assert errors[0].error.sigma > 5 * independent, "independent cells would be far too sure"


def test_what_compares_a_place_with_itself_has_no_error():
    found = error_of(np.zeros((3, 3)), part(np.zeros((3, 3))), ALONE)
    assert found.sigma == 0.0, "as the rise of a closed line"


def test_the_datum_cancels_against_the_border_and_counts_against_a_level():
    share = inside_share(np.array([[5, 5], [50, 5], [50, 50], [5, 50]], float), (60, 60))
    hill = np.zeros((60, 60))
    level, border = (volume_of(part(hill, datum=0.1), share, 1.0, base, ALONE) for base in (0.0, None))
    assert level.error.datum == pytest.approx(0.1 * 45**2, rel=0.01)
    assert border.error.datum < 1e-6 * level.error.datum


def test_a_known_body_has_its_volume_and_a_tilted_border_no_part_in_it():
    rows, cols = np.indices((80, 80), dtype=float)
    cone = np.maximum(0, 6 - np.hypot(rows - 40, cols - 40) / 3)
    share = inside_share(np.array([[5, 5], [75, 5], [75, 75], [5, 75]], float), (80, 80))
    found = volume_of(part(cone + 0.1 * rows - 0.05 * cols + 12), share, 0.5, None, ALONE)
    assert found.volume == pytest.approx(np.pi * 18**2 * 6 / 3 * 0.25, rel=0.01)
    assert found.volume == pytest.approx(found.cut - found.fill) and found.missing == pytest.approx(0)


def test_the_plane_through_the_border_rests_on_measured_cells_where_most_are():
    share = inside_share(np.array([[5, 5], [50, 5], [50, 50], [5, 50]], float), (60, 60))
    heights = np.zeros((60, 60))
    heights[:15] = 8.0
    guessed = replace(part(heights), measured=heights == 0)
    found = volume_of(guessed, share, 1.0, None, ALONE)
    assert found.fill == 0 and found.cut == pytest.approx(8.0 * share[:15].sum())
    assert found.error.estimated == pytest.approx(guessed.relative[0, 0] * share[:15].sum())


def test_estimated_patches_are_one_error_each():
    weights = np.zeros((20, 20))
    weights[2:6, 2:6] = weights[12:16, 12:16] = 1.0
    found = error_of(weights, part(np.zeros((20, 20)), sigma=0.5, measured=False), ALONE)
    assert found.measured == 0 and found.estimated == pytest.approx(np.sqrt(2) * 16 * 0.5)


def test_area_counts_cells_in_part_and_knows_its_corners():
    ring = np.array([[3.3, 2.2], [17.9, 4.1], [12.2, 18.7]])
    area, sigma = area_of(ring, 0.1)
    assert inside_share(ring, (25, 25)).sum() == pytest.approx(area, rel=0.01)
    moved = [area_of(ring + RNG.normal(0, 0.1, ring.shape), 0)[0] for _ in range(2000)]
    assert np.std(moved) == pytest.approx(sigma, rel=0.1)


def test_the_correlation_of_errors_is_found_in_smooth_ground():
    rows, cols = np.indices((96, 96)) / 96
    windows = [3 * rows + cols**2 + noise((96, 96), 0.05) for _ in range(8)]
    products = [window_products(w, np.full(w.shape, 0.05), np.ones(w.shape, bool)) for w in windows]
    found = correlation_from(products, 96)
    assert found.windows == 8
    for distance, value in zip(found.distances[:6], found.values, strict=False):
        assert value == pytest.approx(np.exp(-(distance**2) / (4 * SMOOTH**2)), abs=0.12)
    edge = np.where(cols > 0.5, 5.0, 0.0) + noise((96, 96))
    assert window_products(edge, np.full(edge.shape, 0.05), np.ones(edge.shape, bool)) is None
    assert correlation_from([], 96).windows == 0


GRID = MapGrid(west=1000.0, north=2000.0, cell=0.5, rows=200, cols=300)


@dataclass(frozen=True)
class Ramp:
    """A tilted surface with noise-free heights."""

    grid: MapGrid = GRID
    block: Block | None = None

    def read(self, window: Window) -> SurfaceCut:
        x, y = self.grid.centres(window)
        height = np.float32(10) + 0.1 * (x[None] - 1000) + 0 * y[:, None]
        full = np.ones(height.shape)
        return SurfaceCut(height, 0.03 * full, 0.1 * full, full.astype(bool))


def test_answers_about_a_ramp():
    features = (
        DrawnFeature("spot", "point", np.array([[1020.0, 1950.0]])),
        DrawnFeature("line", "line", np.array([[1010.0, 1950.0], [1050.0, 1950.0]])),
        DrawnFeature("field", "polygon", np.array([[1010.0, 1910.0], [1050.0, 1910.0], [1050.0, 1950.0], [1010.0, 1950.0]])),
    )
    found = measure(Ramp(), features, MeasureRules(level=10.0, corner=0.1, step=5.0))
    by = {(a.feature, a.quantity): a for a in found.answers}
    assert by["spot", "height"].value == pytest.approx(12, abs=1e-4)
    assert by["spot", "height"].sigma == pytest.approx(np.hypot(0.1, 0.03), rel=0.05)
    assert by["line", "distance in plan"].value == pytest.approx(40) and by["line", "distance in plan"].sigma == pytest.approx(
        0.1414, rel=0.01
    )
    assert by["line", "rise"].value == pytest.approx(4, abs=1e-3) and by["line", "rise"].sigma == pytest.approx(0.0424, rel=0.06)
    assert by["line", "slope"].value == pytest.approx(10, abs=0.01)
    assert by["field", "volume"].value == pytest.approx(40 * 40 * 3, rel=0.01)
    assert by["field", "volume"].datum_share == pytest.approx(160, rel=0.01)
    assert [p.along for p in found.profiles] == [0, 5, 10, 15, 20, 25, 30, 35, 40]
    assert found.profiles[2].height == pytest.approx(12, abs=1e-3)


def test_what_lies_in_a_hole_is_not_part_of_a_polygon():
    """A field of 40 x 40 m with a yard of 10 x 10 m taken out, on the ramp."""
    outer = np.array([[1010.0, 1910.0], [1050.0, 1910.0], [1050.0, 1950.0], [1010.0, 1950.0]])
    hole = np.array([[1030.0, 1920.0], [1040.0, 1920.0], [1040.0, 1930.0], [1030.0, 1930.0]])
    features = (DrawnFeature("field", "polygon", outer, (hole,)), DrawnFeature("yard", "polygon", hole))
    by = {(a.feature, a.quantity): a for a in measure(Ramp(), features, MeasureRules(level=10.0, corner=0.1, step=5.0)).answers}
    assert by["field", "area in plan"].value == pytest.approx(1500)
    assert by["field", "area in plan"].sigma == pytest.approx(np.hypot(area_of(outer, 0.1)[1], by["yard", "area in plan"].sigma))
    assert by["field", "volume"].value == pytest.approx(40 * 40 * 3 - 10 * 10 * 3.5, rel=0.002)
    assert by["field", "volume"].datum_share == pytest.approx(150, rel=0.01)


def test_what_lies_elsewhere_is_said_so():
    with pytest.raises(GeometryError, match="far lies outside"):
        measure(Ramp(), (DrawnFeature("far", "point", np.array([[0.0, 0.0]])),), MeasureRules())


def test_one_feature_that_cannot_be_measured_keeps_no_answer_from_the_others():
    bow = np.array([[1010.0, 1910.0], [1050.0, 1950.0], [1050.0, 1910.0], [1010.0, 1950.0]])
    spot, far = (
        DrawnFeature(name, "point", np.array([place])) for name, place in (("spot", [1020.0, 1930.0]), ("far", [0.0, 0.0]))
    )
    answers = measure(Ramp(), (far, spot, DrawnFeature("bow", "polygon", bow)), MeasureRules()).answers
    assert [(a.feature, a.quantity, np.isfinite(a.value)) for a in answers] == [
        ("far", "height", False),
        ("spot", "height", True),
        ("bow", "volume", False),
    ]
    assert "lies outside of the surface" in answers[0].note and "crosses itself" in answers[2].note


def test_an_outline_that_crosses_itself_is_refused_and_one_that_touches_itself_is_not():
    bow = np.array([[1010.0, 1910.0], [1050.0, 1950.0], [1050.0, 1910.0], [1010.0, 1950.0]])
    with pytest.raises(GeometryError, match="bow crosses itself"):
        measure(Ramp(), (DrawnFeature("bow", "polygon", bow),), MeasureRules())
    touching = np.array([[0, 0], [4, 0], [4, 4], [2, 0], [0, 4]])
    assert not crosses_itself(touching) and not crosses_itself(touching[::-1]) and crosses_itself(bow)


def test_a_height_in_a_large_part_is_that_of_its_four_cells():
    surface, known = part(np.arange(35.0).reshape(5, 7), sigma=0.03, datum=0.1), gaussian_correlation()
    found = spot_height(surface, 4.25, 2.5, known)
    whole = error_of(bilinear_weights((5, 7), 4.25, 2.5), surface, known)
    assert found.height == pytest.approx(2.5 * 7 + 4.25) and found.error.sigma == pytest.approx(whole.sigma)
    for col, row in ((-0.5, 2.0), (2.0, -0.5), (6.5, 2.0), (2.0, 4.2)):
        assert spot_height(surface, col, row, known) is None


def test_what_all_heights_have_in_common_does_not_fade_over_a_large_area_and_cancels_in_differences():
    common = replace(ALONE, common=0.04)
    weights = np.full((300, 300), 1 / 300**2)
    assert error_of(weights, part(np.zeros((300, 300)), sigma=0.1), common).measured == pytest.approx(0.02, rel=0.01)
    apart = np.where(np.arange(300) < 150, 1.0, -1.0) * weights
    assert error_of(apart, part(np.zeros((300, 300)), sigma=0.1), common).measured < 0.001
    single = np.zeros((5, 5))
    single[2, 2] = 1.0
    assert error_of(single, part(np.zeros((5, 5)), sigma=0.1), common).measured == pytest.approx(0.1), "as sure as stated"
