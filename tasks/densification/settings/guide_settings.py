"""When a height of the volume counts as measured, and what bounds the heights that are looked for."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from orthomill.schemas.project_paths import ProjectPath
from orthomill.schemas.settings import Settings, setting


class ConfidenceLimits(Settings):
    """When a height of the volume counts as measured."""

    renamed: ClassVar = {"standing": "distinctiveness", "spread": "rival_spread"}  # 0.2
    coherence: float = setting(0.7, "Share of the cells around that must go along with it.", ge=0.0, le=1.0)
    distinctiveness: float = setting(
        0.7, "How clearly it beats its rivals, as a share of what is usual in its surroundings, at least.", ge=0.0, le=2.5
    )
    rival_spread: float = setting(
        1.6, "How far from it heights may lie, on average, that fit nearly as well.", "heights", ge=0.0, le=15.0
    )
    with_pair: float = setting(
        0.3, "The same as distinctiveness, for heights on even ground near which a pair matched.", ge=0.0, le=2.5
    )


class TiePointGuide(Settings):
    """The tie points alone."""

    kind: Literal["tie_points"] = "tie_points"


class GuideFile(Settings):
    """An existing height model in any CRS; tie points close its holes."""

    kind: Literal["file"]
    path: ProjectPath = setting(..., "GeoTIFF with heights in metres, relative to the project's root.")


Guide = Annotated[TiePointGuide | GuideFile, Field(discriminator="kind")]
