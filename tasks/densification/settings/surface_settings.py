"""The settings by which nodes of pairs and heights of the volume become a surface."""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from orthomill.schemas.settings import Settings, refuse_ignored, setting


class Gridding(Settings):
    """From the nodes of a pair to map cells."""

    max_jump: float = setting(1.5, "Neighbouring nodes whose parallaxes differ by more are not on one surface.", "px", gt=0.0)
    node_reach: float = setting(0.5, "A node at a jump covers the cells around it up to this distance.", "nodes", ge=0.0, le=2.0)


class Fusion(Settings):
    """How the heights of several pairs become one."""

    agreement: float = setting(3.0, "Heights agree when they differ by no more than this many standard errors.", gt=0.0, le=10.0)
    tolerance: float = setting(0.3, "Heights also agree when they differ by less than this.", "cells", ge=0.0, le=10.0)


class Completion(Settings):
    """How the heights of pairs and those of the volume go together."""

    nearness: float = setting(1.0, "Heights of a pair count only within this distance of the volume's.", "cells", gt=0.0, le=20.0)


class SpikeFilter(Settings):
    """Removal of spikes by comparison with the heights around."""

    radius: float = setting(4.0, "Radius of the circle of neighbours.", "cells", ge=1.0, le=30.0)
    sigmas: float = setting(3.0, "Standard deviations of the neighbours by which a height may differ from their mean.", gt=0.0)
    rounds: int = setting(2, "How often the filter runs.", ge=0, le=10)
    min_support: int = setting(10, "A height that fewer neighbours support is removed.", "cells", ge=0)
    support_slope: float = setting(1.5, "A neighbour supports a height when the slope between them is at most this.", gt=0.0)
    far_radius: float = setting(
        12.0, "Radius of the wider circle in which a height also needs support; 0: none.", "cells", ge=0.0, le=60.0
    )
    far_support: float = setting(0.15, "Share of the wider circle that must support a height.", ge=0.0, le=1.0)
    far_slope: float = setting(3.0, "A height in the wider circle supports when the slope is at most this.", gt=0.0)
    floor: float = setting(0.3, "Deviations below this share of the cell size are never spikes.", "cells", ge=0.0)

    @model_validator(mode="after")
    def _settings_have_an_effect(self) -> Self:
        """Refuses settings of a part of the filter that is switched off."""
        for switch, others in _SWITCHES.items():
            if getattr(self, switch) == 0:
                refuse_ignored(self, others, f"{switch}: 0", f"leave it out, or set {switch} to more than 0")
        return self

    @property
    def halo(self) -> int:
        """Distance in cells at which a height can influence the filter."""
        return int(np.ceil(self.radius)) * self.rounds + int(np.ceil(self.far_radius))


_SWITCHES = {"rounds": ("radius", "sigmas", "min_support", "support_slope"), "far_radius": ("far_support", "far_slope")}
"""settings that switch a part of the filter off when they are 0, and the settings that only this part reads"""


class PointThinning(Settings):
    """Which matched nodes become points of the point cloud."""

    most_per_cell: int = setting(
        2, "Matched nodes of all pairs that a cell of the surface model keeps: those of the smallest standard error.", ge=1, le=32
    )


class MeasuredOnly(Settings):
    """Cells without a measured height stay empty."""

    kind: Literal["none"]

    @property
    def reach(self) -> int:
        """Distance from a gap, in cells, within which heights are used."""
        return 0


class EstimateGaps(Settings):
    """Every gap gets an estimated height, with a code that says so."""

    kind: Literal["estimate"] = "estimate"
    max_gap: int = setting(64, "How far from the heights around it a cell may be interpolated.", "cells", ge=1, le=500)

    @property
    def reach(self) -> int:
        """Distance from a gap, in cells, within which heights are used."""
        return self.max_gap


Filling = Annotated[MeasuredOnly | EstimateGaps, Field(discriminator="kind")]
