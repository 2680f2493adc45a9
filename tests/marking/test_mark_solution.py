"""Marks added to a block by its covariance against the least-squares adjustment that they stand for."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.marking.simulated_marks import simulated_block, simulated_marks
from orthomill.schemas.marks import Mark, MarkedPoint, Marks
from orthomill.tasks.marking.judging import judged, numbered, sights
from orthomill.tasks.marking.mark_solution import solved

BLOCK = simulated_block(2, 5, seed=3)


def with_tie_point(marks):
    """The first point without coordinates."""
    first = marks.points[0].model_copy(update={"role": "tie", "xyz": None})
    return Marks(points=(first, *marks.points[1:]))


def by_least_squares(solution):
    """Corrections of block and points by stacked observations: the block's own estimate, the marks, the coordinates."""
    belief, J = solution.belief, solution.J.toarray()
    n, points = J.shape[1], len(solution.start)
    root = np.linalg.inv(np.linalg.cholesky(belief.covariance))
    rows = [np.hstack([root, np.zeros((n, 3 * points))])]
    right = [np.zeros(n)]
    per_mark = 1.0 / np.sqrt(solution.variances)[:, None]
    # `w` is reduced by the given coordinates, from which points are then counted.
    rows.append(per_mark * np.hstack([J, solution.B.reshape(len(J), -1)]))
    right.append(per_mark[:, 0] * solution.w)
    for point in np.flatnonzero(~solution.free):
        own = np.zeros((3, n + 3 * points))
        own[:, n + 3 * point : n + 3 * point + 3] = np.diag(1.0 / solution.marked.sigma[point])
        rows.append(own)
        right.append(np.zeros(3))
    A, b = np.vstack(rows), np.concatenate(right)
    values, inverse = np.linalg.lstsq(A, b, rcond=None)[0], np.linalg.inv(A.T @ A)
    residual = solution.w - np.hstack([J, solution.B.reshape(len(J), -1)]) @ values
    return values[:n], values[n:].reshape(-1, 3), residual.reshape(-1, 2), inverse[n:, n:]


def test_residuals_places_and_precision_are_those_of_least_squares():
    table = numbered(BLOCK.belief, with_tie_point(simulated_marks(BLOCK, 1, points=4, most=5)).points)
    solution = solved(BLOCK.belief, table.marked)
    block, moved, residual, covariance = by_least_squares(solution)
    np.testing.assert_allclose(solution.correction, block, atol=1e-9)
    np.testing.assert_allclose(solution.residual, residual, atol=1e-7)
    start = np.where(solution.free[:, None], solution.start, solution.marked.known)
    np.testing.assert_allclose(solution.places, start + moved, atol=1e-8)
    for point in range(len(start)):
        own = covariance[3 * point : 3 * point + 3, 3 * point : 3 * point + 3]
        np.testing.assert_allclose(solution.covariance_of(point), own, rtol=1e-5, atol=1e-10)


def test_what_a_mark_is_off_is_what_leaving_it_out_shows():
    table = numbered(BLOCK.belief, simulated_marks(BLOCK, 2, points=3, most=6).points)
    whole = solved(BLOCK.belief, table.marked)
    for ray in (0, 4):
        alone = np.arange(len(table.marked.rays)) == ray
        rest = solved(BLOCK.belief, table.marked.without(alone), whole.start)
        seen = rest.predicted(int(table.marked.rays.point[ray]), table.marked.rays.photo[[ray]])
        away = table.marked.rays.xy[ray] - seen.xy[0]
        np.testing.assert_allclose(whole.mark_tests[1][ray], away, atol=1e-6)
        spread = seen.covariance[0] + table.marked.rays.sigma[ray] ** 2 * np.eye(2)
        assert whole.mark_tests[0][ray] == pytest.approx(np.sqrt(away @ np.linalg.solve(spread, away)), rel=1e-6)


def test_predicted_places_scatter_as_stated():
    """Over many points: the marks left out against the places that the others predict."""
    sizes = []
    for seed in range(12):
        marks = simulated_marks(simulated_block(2, 5, seed=seed + 20), seed, points=2, most=8, sigma=0.3)
        block = simulated_block(2, 5, seed=seed + 20)
        for point in marks.points:
            kept = dict(list(point.marks.items())[:3])
            for sight in sights(block.belief, Marks(points=(point.model_copy(update={"marks": kept}),)), point.name):
                if sight.photo in point.marks:
                    mark = point.marks[sight.photo]
                    away = np.array([mark.col, mark.row]) - sight.place
                    spread = sight.covariance + mark.sigma**2 * np.eye(2)
                    sizes.append(away @ np.linalg.solve(spread, away))
    assert len(sizes) > 40
    # Chi-squared with two degrees of freedom has the mean 2; marks of one point share errors, so that the mean scatters more.
    assert 1.2 < np.mean(sizes) < 3.0


def test_the_next_mark_gains_what_the_adjustment_with_it_gains():
    point = simulated_marks(BLOCK, 5, points=1, most=8).points[0].model_copy(update={"role": "tie", "xyz": None})
    two = point.model_copy(update={"marks": dict(list(point.marks.items())[:2])})
    best = sights(BLOCK.belief, Marks(points=(two,)), point.name, sigma=0.3)[0]
    at = Mark(col=best.place[0], row=best.place[1], sigma=0.3)
    three = two.model_copy(update={"marks": {**two.marks, best.photo: at}})
    before, after = (judged(BLOCK.belief, Marks(points=(one,))).points[0].sigma for one in (two, three))
    assert best.gain[0] == pytest.approx(np.linalg.norm(before), rel=1e-3)
    assert best.gain[1] == pytest.approx(np.linalg.norm(after), rel=0.02)
    assert best.gain[1] < best.gain[0]


def test_one_mark_without_coordinates_looks_along_its_ray():
    point = simulated_marks(BLOCK, 6, points=1, most=6).points[0]
    one = MarkedPoint(name="new", role="tie", marks=dict(list(point.marks.items())[:1]))
    found = {sight.photo: sight for sight in sights(BLOCK.belief, Marks(points=(one,)), "new")}
    others = [photo for photo in point.marks if photo in found]
    assert others
    for photo in others:
        away = np.array([point.marks[photo].col, point.marks[photo].row]) - found[photo].place
        assert away @ np.linalg.solve(found[photo].covariance + np.eye(2), away) < 20


def test_coordinates_alone_say_where_to_look():
    point = simulated_marks(BLOCK, 6, points=1, most=6).points[0]
    bare = point.model_copy(update={"marks": {}})
    found = {sight.photo: sight for sight in sights(BLOCK.belief, Marks(points=(bare,)), point.name)}
    assert set(point.marks) <= set(found)
    assert all(
        np.hypot(mark.col - found[photo].place[0], mark.row - found[photo].place[1]) < 30 for photo, mark in point.marks.items()
    )


def test_a_point_that_nothing_places_is_nowhere():
    nothing = MarkedPoint(name="new", role="tie")
    assert sights(BLOCK.belief, Marks(points=(nothing,)), "new") == ()
    assert judged(BLOCK.belief, Marks(points=(nothing,))).marks == ()


def test_marks_in_photographs_without_orientation_are_passed_over():
    point = simulated_marks(BLOCK, 7, points=1).points[0]
    elsewhere = point.model_copy(update={"marks": {**point.marks, "another": Mark(col=1.0, row=1.0)}})
    assert len(judged(BLOCK.belief, Marks(points=(elsewhere,))).marks) == len(point.marks)


def test_nothing_checks_the_marks_of_a_point_with_two():
    point = simulated_marks(BLOCK, 8, points=1).points[0].model_copy(update={"role": "tie", "xyz": None})
    loose = replace(BLOCK.belief, covariance=BLOCK.belief.covariance + np.diag(np.full(len(BLOCK.belief.covariance), 1.0)))
    two = Marks(points=(point.model_copy(update={"marks": dict(list(point.marks.items())[:2])}),))
    assert all(mark.test is None for mark in judged(loose, two).marks)
