"""The picture of the footprint map."""

from orthomill.schemas.orientation import Block
from orthomill.schemas.stage_report import Picture
from orthomill.tasks.orientation.examined.overlap_map import CENTRE, MOST, OUTLINE, OVERLAP, map_width

_COLOURS = ("#c0392b", "#e67e22", "#f1c40f", "#7dbb5e", "#3f9b6a", "#1f6f8b")


def overlap_picture(block: Block) -> Picture:
    """How the report draws the map of `overlap_map`."""
    wide = map_width(block)
    where = "level ground at mean height. North is up" if block.area is None else "the surface's plane, seen from its front"
    seen = [(0, "#f4f4f1", "seen by none")]
    seen += [(i, _COLOURS[i - 1], f"{i} photograph{'s' * (i > 1)}{' or more' * (i == MOST)}") for i in range(1, MOST + 1)]
    return Picture(
        title="Footprints and overlap",
        raster=OVERLAP,
        style="classes",
        caption=f"Photographs that see each place of {where}, the picture is {wide:.4g} m wide. "
        "Heights need two photographs; with three or more, blunders can be detected.",
        classes=(*seen, (OUTLINE, "#555555", "outline of a photograph"), (CENTRE, "#000000", "projection centre")),
    )
