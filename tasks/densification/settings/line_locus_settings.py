"""The settings of vertical line locus."""

from pydantic import model_validator

from orthomill.schemas.settings import refuse_ignored, setting
from orthomill.tasks.densification.settings.guide_settings import Guide, TiePointGuide
from orthomill.tasks.matching.line_locus.height_search_settings import HeightSearch


class LineLocus(HeightSearch):
    """Vertical line locus in blocks of nodes; a node is a cell of the surface."""

    block: int = setting(
        64, "Nodes along the side of a block; each block is entered at a tie point of its own.", "cells", ge=8, le=4096
    )
    guide: Guide = setting(TiePointGuide(), "What says how high the terrain lies on which lines are entered.")

    @model_validator(mode="after")
    def _guide_has_an_effect(self) -> "LineLocus":
        if self.start == "neighbour":
            refuse_ignored(self, ("guide",), "start: neighbour", "set start to terrain, or leave it out")
        return self
