"""The settings of the volume of heights."""

from typing import Literal

from orthomill.schemas.settings import Settings, setting


class HeightVolume(Settings):
    """Semi-global matching of all photographs in a volume of heights over map cells, coarse to fine."""

    window: Literal[5, 7] = setting(7, "Pixels compared along the side of the census window.", "px")
    oversampling: int = setting(3, "Pixels of a rectified photograph along the side of a cell.", ge=1, le=4)
    spacing: int = setting(2, "Distance of the pixels of a census window.", "px of the rectified photograph", ge=1, le=4)
    step: float = setting(0.5, "Greatest parallax between neighbouring heights.", "cells", gt=0.1, le=4.0)
    photographs: int = setting(8, "Photographs that are chosen for a place.", ge=2, le=32)
    compared: int = setting(8, "Of these, photographs that are compared in a cell: the first that show it.", ge=2, le=16)
    best_share: float = setting(0.5, "Share of the pairs of photographs that decide: the most similar ones.", gt=0.0, le=1.0)
    blank: float = setting(
        0.4, "Cost of a pair of which one photograph does not show the height.", "share of the bits", ge=0.0, le=1.0
    )
    small_penalty: float = setting(0.16, "Cost of a change by one height between neighbours.", "share of the bits", ge=0.0, le=2.0)
    large_penalty: float = setting(0.6, "Cost of a larger jump between neighbours.", "share of the bits", ge=0.0, le=4.0)
    widest: int = setting(96, "Heights of the coarsest level, at most.", ge=32, le=256)
    margin: int = setting(7, "Heights added on both sides to the range that the coarser level found.", ge=1, le=64)
    reach: int = setting(1, "Coarser cells around a cell whose heights are within its range.", "cells", ge=1, le=8)
    most_heights: int = setting(128, "Heights of a cell, at most.", ge=16, le=512)
    mean_heights: int = setting(48, "Mean number of heights of the cells of a tile, at most; bounds the memory.", ge=16, le=512)
    doubt: float = setting(
        0.08,
        "A height whose photographs fit by this less is a rival of a third of the weight.",
        "share of the bits",
        gt=0.0,
        le=1.0,
    )
    coherence: float = setting(2.0, "A neighbour goes along when its height differs by at most this.", "heights", gt=0.0)
    coherence_slope: float = setting(0.75, "Added to it per cell of distance: the slope of a coherent surface.", ge=0.0, le=8.0)

    @property
    def half(self) -> int:
        """Half side of the window, px, without its middle pixel."""
        return self.window // 2
