"""The stage `tie_points`: how points are searched in the photographs, matched in pairs, joined and refined."""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from orthomill.schemas.job import Export, Job
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import Settings, refuse_ignored, setting
from orthomill.schemas.stage_contract import InspectionPart, ProjectView, Stage
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching
from orthomill.tasks.tie_points.search_settings import LEAST_SHARE, CorrelationSearch, GrowingSearch


class FeatureSearch(Settings):
    """Features with descriptors, invariant against scale and rotation."""

    kind: Literal["features"]


Search = Annotated[FeatureSearch | CorrelationSearch | GrowingSearch, Field(discriminator="kind")]

_OF_DESCRIPTORS = ("ratio", "contrast")


class TiePointsStage(Stage):
    """Finds points that two or more photographs show and refines their measurements."""

    title: ClassVar[str] = "Tie points"
    inspects: ClassVar[InspectionPart | None] = "ties"
    kind: Literal["tie_points"] = "tie_points"
    search: Search = setting(
        FeatureSearch(kind="features"),
        "How points are found and matched: features with descriptors for photographs of any attitude, the published interest "
        "points and correlation for near-vertical ones, or features that the published region growing assigns to each other.",
    )
    search_side: int = setting(
        2000, "Points are searched on the pyramid level whose longer side is at most this.", "px", ge=500, le=20000
    )
    max_features: int = setting(8000, "Points kept per photograph.", ge=200, le=100000)
    max_matched: int = setting(
        600_000,
        "Matched points of all photographs together that the block is made from. Of more, every photograph keeps its share, "
        f"{LEAST_SHARE} at least, all over its frame and those that were matched most often first.",
        ge=10_000,
        le=100_000_000,
    )
    contrast: float = setting(
        0.02, "Least contrast of a point (SIFT's threshold); a lower value finds more and weaker points.", gt=0.0, le=0.2
    )
    ratio: float = setting(0.8, "Largest ratio of the best to the second best descriptor distance.", gt=0.3, le=1.0)
    epipolar_tolerance: float = setting(
        1.5, "Distance from the epipolar line up to which a match is accepted.", "px of the searched level", gt=0.0
    )
    all_pairs_up_to: int = setting(15, "Up to this many photographs every pair is compared.", "photographs", ge=2)
    nearest: int = setting(
        10,
        "Of more photographs, each is compared with this many others: those that show the nearest ground, or those most similar to "
        "it where its position is unknown.",
        "photographs",
        ge=2,
        le=100,
    )
    refinement: LeastSquaresMatching = setting(
        LeastSquaresMatching(max_shift=3.0, min_correlation=0.7),
        "Least-squares matching of each observation against the track's reference.",
    )
    sigma_floor: float = setting(
        0.03,
        "Least standard error of an observation; the measured scatter about epipolar lines replaces it when larger.",
        "px",
        gt=0.0,
    )
    sigma_unrefined: float = setting(
        0.7, "Standard error of observations that could not be refined and are kept.", "px of the searched level", gt=0.0
    )
    unrefined: Literal["keep", "drop"] = setting("drop", "Whether observations that could not be refined are kept.")

    @model_validator(mode="after")
    def _has_an_effect(self) -> "TiePointsStage":
        """Raises ValueError for settings that the chosen mode does not read."""
        if self.search.kind == "correlation":
            remedy = "descriptors are not compared: remove the line, or set search: features"
            refuse_ignored(self, _OF_DESCRIPTORS, "search: correlation", remedy)
        if self.unrefined == "drop":
            remedy = "no such observation is kept: remove the line, or set unrefined: keep"
            refuse_ignored(self, ("sigma_unrefined",), "unrefined: drop", remedy)
        return self

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """Features, matches of pairs, tracks, patches and their refinement."""
        from orthomill.tasks.tie_points.plan.tie_point_jobs import tie_point_jobs

        return tie_point_jobs(self, view)
