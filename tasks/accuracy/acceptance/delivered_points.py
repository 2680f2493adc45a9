"""Products of whatever program at surveyed points: heights where the ground is flat, and places that somebody measured in the
orthoimage."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.accuracy.acceptance import InspectedProducts
from orthomill.schemas.accuracy.point_tests import TESTED, PlaceTest, PointTest, PointTests
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.accuracy.points.surface_height import CellsAround, beside_survey, cells_around, height_at
from orthomill.tasks.accuracy.points.under_vegetation import under_vegetation
from orthomill.tasks.accuracy.statement.point_statement import statement_of

STEEPEST = 0.1
Heights = Callable[[MapGrid, Window], np.ndarray]
"""a window of heights (rows, cols) m, NaN where there are none"""


@dataclass(frozen=True)
class SurveyedPoint:
    """A point of the inspector: X, Y, Z and standard errors, m; its place in the orthoimage, where somebody measured it."""

    name: str
    xyz: tuple[float, float, float]
    sigma: tuple[float, float, float]
    place: tuple[float, float] | None = None


def inspected(
    points: tuple[SurveyedPoint, ...],
    grid: MapGrid | None,
    heights: Heights | None,
    image: MapGrid | None,
    vegetated: tuple[str, ...] = (),
) -> InspectedProducts:
    """The statement about products that state no errors of their own; image: the pixels of the orthoimage, half of one of which a
    place errs; vegetated: names or shell patterns of points under vegetation, stated apart. Raises WorkflowError for one that no
    point has."""
    under, tests = under_vegetation((point.name for point in points), vegetated), []
    for point in points:
        place = _measured(point, image)
        height = None
        if grid is not None and heights is not None:
            window = cells_around(grid, *point.xyz[:2]).clipped(grid.shape)
            values = heights(grid, window) if not window.empty else np.zeros((0, 0))
            height = height_at(CellsAround(grid, window, values, np.zeros(values.shape)), *point.xyz[:2], STEEPEST)
        height = beside_survey(height, point.sigma[2])
        known = {"name": point.name, "surveyed": point.xyz, "sigma": point.sigma, "vegetated": point.name in under}
        tests.append(PointTest(**known, height=height, place=place))
    area = grid.rows * grid.cols * grid.cell**2 / 1e6 if grid else 0.0
    return unpromised(PointTests(points=tuple(tests), area_km2=area))


def _measured(point: SurveyedPoint, image: MapGrid | None) -> PlaceTest | None:
    if image is None:
        return None
    if point.place is None:
        return PlaceTest(reason="nobody measured it in the orthoimage: ortho_x, ortho_y")
    col, row = image.pixel(*point.place)
    if not (-0.5 <= col < image.cols - 0.5 and -0.5 <= row < image.rows - 0.5):
        return PlaceTest(reason="its measured place lies outside of the orthoimage")
    half = image.cell / 2
    return PlaceTest(reason=TESTED, place=point.place, sigma=(half, half), photos=0)


def unpromised(tests: PointTests) -> InspectedProducts:
    """The tests, and the statement without what was promised: a surface of another program promises nothing, and only the survey's
    errors would stand in the comparison."""
    found = statement_of(tests)
    figures = tuple(figure.model_copy(update={"promised": None}) for figure in found.figures)
    return InspectedProducts(found.model_copy(update={"figures": figures}), tests.points)
