"""The Gauss-Helmert model against closed forms: weighted means, levelling loops, the orthogonal line, the circle."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.reliability import NONCENTRALITY
from orthomill.tasks.adjustment.solve.mixed_model import _singular, solve_mixed


@dataclass(frozen=True, eq=False)
class Levelling:
    """Height differences between benchmarks; the first has height 0. `lines` (s, 2): from, to."""

    lines: np.ndarray
    heights: np.ndarray

    def evaluate(self, observations):
        height = np.append(0.0, self.heights)
        A = np.zeros((len(self.lines), len(height)))
        A[np.arange(len(A)), self.lines[:, 0]] -= 1.0
        A[np.arange(len(A)), self.lines[:, 1]] += 1.0
        return A @ height - observations[:, 0], A[:, 1:], -np.ones_like(observations)

    def moved(self, correction):
        return replace(self, heights=self.heights + correction)


@dataclass(frozen=True, eq=False)
class Line:
    """x cos(angle) + y sin(angle) = distance, both coordinates observed."""

    angle: float
    distance: float

    def evaluate(self, xy):
        c, s = np.cos(self.angle), np.sin(self.angle)
        A = np.column_stack([-s * xy[:, 0] + c * xy[:, 1], -np.ones(len(xy))])
        return xy @ [c, s] - self.distance, A, np.tile([c, s], (len(xy), 1))

    def moved(self, correction):
        return Line(self.angle + correction[0], self.distance + correction[1])


@dataclass(frozen=True, eq=False)
class Circle:
    """(x - x0)^2 + (y - y0)^2 = r^2."""

    x0: float
    y0: float
    r: float

    def evaluate(self, xy):
        d = xy - [self.x0, self.y0]
        A = -2 * np.column_stack([d, np.full(len(d), self.r)])
        return (d**2).sum(axis=1) - self.r**2, A, 2 * d

    def moved(self, correction):
        return Circle(*(np.array([self.x0, self.y0, self.r]) + correction))


def test_a_levelling_loop_distributes_its_misclosure_by_variance():
    lines = np.array([[0, 1], [1, 2], [2, 0]])
    observed, sigma = np.array([[1.002], [2.004], [-3.000]]), np.array([[1.0], [2.0], [3.0]]) * 1e-3
    result = solve_mixed(Levelling(lines, np.zeros(2)), observed, sigma=sigma)
    misclosure, share = observed.sum(), (sigma**2 / (sigma**2).sum())[:, 0]
    assert result.residuals[:, 0] == pytest.approx(-misclosure * share)
    assert result.model.heights == pytest.approx([1.002 - misclosure / 14, 3.006 - misclosure * 5 / 14])
    assert result.redundancy == 1 and result.sigma0 == pytest.approx(misclosure / np.sqrt((sigma**2).sum()))
    assert result.redundancy_number == pytest.approx(share), "a loop checks each line by its share of the variance"
    assert np.abs(result.standardised) == pytest.approx(np.ones(3)), "one redundant observation: all tests are the same"


def test_two_levelling_lines_give_the_weighted_mean_and_its_precision():
    result = solve_mixed(
        Levelling(np.array([[0, 1]] * 3), np.zeros(1)), np.array([[1.0], [1.2], [1.3]]), sigma=np.array([[1.0], [2.0], [2.0]])
    )
    mean = (1.0 + 1.2 / 4 + 1.3 / 4) / 1.5
    assert result.model.heights == pytest.approx([mean])
    assert result.standard_errors == pytest.approx([result.sigma0 / np.sqrt(1.5)])
    variance = ((1.0 - mean) ** 2 + (1.2 - mean) ** 2 / 4 + (1.3 - mean) ** 2 / 4) / 2
    assert result.sigma0 == pytest.approx(np.sqrt(variance))
    assert result.redundancy_number == pytest.approx([1 - 1 / 1.5, 1 - 0.25 / 1.5, 1 - 0.25 / 1.5])


@pytest.mark.parametrize("wrong", range(6))
def test_the_w_test_finds_the_wrong_line_of_a_levelling_net(wrong):
    lines = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [0, 2], [1, 3]])
    height = np.array([0.0, 1.0, 3.0, -2.0])
    observed = (height[lines[:, 1]] - height[lines[:, 0]])[:, None]
    observed[wrong] += 0.01
    result = solve_mixed(Levelling(lines, np.zeros(3)), observed, sigma=np.full((6, 1), 1e-3))
    # Baarda: w = v / (sigma sqrt(r)); its square at the wrong line is the whole square sum.
    w = result.discrepancy / np.sqrt(result.redundancy_number)
    assert np.abs(w).argmax() == wrong
    assert w[wrong] ** 2 == pytest.approx((result.discrepancy**2).sum())
    assert result.redundancy_number == pytest.approx(np.full(6, 0.5)), "a complete net of four: 3 of 6"


def test_the_smallest_detectable_error_is_baardas():
    lines = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [0, 2], [1, 3]])
    rng = np.random.default_rng(0)
    result = solve_mixed(Levelling(lines, np.zeros(3)), 1e-3 * rng.standard_normal((6, 1)), sigma=np.full((6, 1), 1e-3))
    assert result.detectable[:, 0] == pytest.approx(NONCENTRALITY * result.sigma0 * 1e-3 / np.sqrt(np.full(6, 0.5)))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_the_orthogonal_line_is_the_principal_axis(seed):
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0.2, 1.3)
    along = rng.uniform(-5, 5, 40)
    xy = 2.0 * np.array([np.cos(angle), np.sin(angle)]) + np.outer(along, [-np.sin(angle), np.cos(angle)])
    xy = xy + 0.05 * rng.standard_normal(xy.shape)
    result = solve_mixed(Line(angle + 0.1, 1.8), xy)
    values, vectors = np.linalg.eigh((xy - xy.mean(axis=0)).T @ (xy - xy.mean(axis=0)))
    normal = vectors[:, 0] * np.sign(vectors[:, 0] @ [np.cos(angle), np.sin(angle)])
    assert [np.cos(result.model.angle), np.sin(result.model.angle)] == pytest.approx(normal, abs=1e-9)
    assert result.model.distance == pytest.approx(xy.mean(axis=0) @ normal, abs=1e-9)
    assert result.sigma0 == pytest.approx(np.sqrt(values[0] / 38))
    assert np.allclose(result.residuals, np.outer(result.residuals @ normal, normal), atol=1e-9), "perpendicular to the line"


def test_adjusted_observations_fulfil_the_conditions():
    rng = np.random.default_rng(2)
    turn = rng.uniform(0, 2 * np.pi, 30)
    xy = [3.0, -1.0] + 2.0 * np.column_stack([np.cos(turn), np.sin(turn)]) + 0.05 * rng.standard_normal((30, 2))
    result = solve_mixed(Circle(2.5, -0.5, 1.5), xy)
    F, _, _ = result.model.evaluate(xy + result.residuals)
    assert np.abs(F).max() < 1e-10
    model = result.model
    radial = np.hypot(*(xy - [model.x0, model.y0]).T) - model.r
    assert np.linalg.norm(result.residuals, axis=1) == pytest.approx(np.abs(radial)), "along the radius"
    assert radial.mean() == pytest.approx(0.0, abs=1e-10)
    assert np.abs(np.array([model.x0, model.y0, model.r]) - [3, -1, 2]).max() < 4 * result.standard_errors.max()


def test_redundancy_numbers_sum_to_the_redundancy_and_scale_is_free():
    rng = np.random.default_rng(5)
    xy = np.column_stack([np.linspace(0, 9, 12), 0.5 * np.linspace(0, 9, 12)]) + 0.1 * rng.standard_normal((12, 2))
    plain = solve_mixed(Line(2.0, 0.1), xy)
    weighted = solve_mixed(Line(2.0, 0.1), xy, sigma=np.full((12, 2), 0.1))
    assert plain.redundancy_number.sum() == pytest.approx(10) == weighted.redundancy_number.sum()
    assert plain.covariance == pytest.approx(weighted.covariance), "a common factor of all weights does not count"
    assert plain.sigma0 == pytest.approx(0.1 * weighted.sigma0)


def test_standard_errors_are_those_of_repetition():
    angle, results = 0.7, []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        xy = np.outer(np.linspace(-5, 5, 25), [-np.sin(angle), np.cos(angle)]) + 0.05 * rng.standard_normal((25, 2))
        results.append(solve_mixed(Line(angle, 0.0), xy))
    errors = np.array([(r.model.angle - angle, r.model.distance) for r in results])
    stated = np.array([r.standard_errors for r in results])
    assert np.sqrt((errors**2).mean(axis=0)) == pytest.approx(stated.mean(axis=0), rel=0.25)
    assert np.mean([r.sigma0 for r in results]) == pytest.approx(0.05, rel=0.05)


def test_without_redundancy_there_is_a_solution_but_no_precision():
    result = solve_mixed(Levelling(np.array([[0, 1], [0, 2]]), np.zeros(2)), np.array([[1.0], [2.0]]))
    assert result.model.heights == pytest.approx([1.0, 2.0])
    assert result.redundancy == 0 and np.isnan(result.sigma0) and np.isnan(result.covariance).all()
    assert not result.standardised.any()


def test_an_unchecked_observation_has_no_standardised_discrepancy():
    lines = np.array([[0, 1], [0, 1], [1, 2]])
    result = solve_mixed(Levelling(lines, np.zeros(2)), np.array([[1.0], [1.1], [5.0]]))
    assert result.redundancy_number == pytest.approx([0.5, 0.5, 0.0])
    assert result.standardised[2] == 0.0 and abs(result.standardised[0]) == pytest.approx(1.0)


def test_too_few_conditions_are_refused():
    with pytest.raises(GeometryError, match="1 matches cannot determine 2 unknowns; at least 2"):
        solve_mixed(Line(0.0, 0.0), np.array([[1.0, 2.0]]))


def test_a_singular_configuration_is_refused():
    with pytest.raises(GeometryError, match="do not determine"):
        solve_mixed(Levelling(np.array([[1, 2], [1, 2], [2, 1]]), np.zeros(2)), np.ones((3, 1)))


@pytest.mark.parametrize("apart", [1.0, 1e-2, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("size", [2, 5, 9])
def test_the_determinant_spares_the_condition_where_it_tells_the_same(size, apart):
    """Columns that differ by `apart`: conditions from 1 to what rounding leaves of 1e16."""
    rng = np.random.default_rng(size)
    columns = rng.standard_normal((40, 1)) + apart * rng.standard_normal((40, size))
    normal = columns.T @ columns
    scale = 1.0 / np.sqrt(np.diag(normal))
    scaled = normal * scale[:, None] * scale
    assert _singular(scaled) == (np.linalg.cond(scaled) > 1e14)
    assert apart > 1e-8 or _singular(scaled)


def test_an_iteration_that_does_not_converge_is_an_error():
    rng = np.random.default_rng(1)
    with pytest.raises(GeometryError, match="did not converge in 2 iterations"):
        solve_mixed(Circle(40.0, 30.0, 0.1), rng.standard_normal((20, 2)), most=2)
