"""The settings of the search for points, without its methods."""

from typing import Literal

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
