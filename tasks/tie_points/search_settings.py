"""The settings of the search for points, without its methods."""

from typing import Literal

from orthomill.schemas.project_paths import ProjectPath
from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.matching.points.point_settings import HarrisPoints, TemplateCorrelation

LEAST_SHARE = 500
"""Features that every photograph keeps, however many photographs there are: eight for each of 64 parts of the frame."""


class CorrelationSearch(Settings):
    """Interest points and correlation: near-vertical photographs of one scale, not rotated against each other."""

    kind: Literal["correlation"]
    points: HarrisPoints = setting(HarrisPoints(), "Interest points.")
    correlation: TemplateCorrelation = setting(
        TemplateCorrelation(), "Search of each point in the other photograph; pixels of the searched level."
    )


class GrowingSearch(Settings):
    """Region growing from seeds: photographs of any turn and scale, of which nothing is known (Otto & Chau 1989)."""

    kind: Literal["region_growing"]
    seeds: ProjectPath | None = setting(
        None,
        "CSV with the columns left, left_col, left_row, right, right_col, right_row: points of two photographs, exact to two "
        "pixels of the searched level, without a turn between them; null: features that both agree on.",
    )
    step: int = setting(16, "Distance of the nodes.", "px of the searched level", ge=4, le=64)
    window: int = setting(21, "Side of the windows of least-squares matching.", "px of the searched level", ge=5, le=101)
