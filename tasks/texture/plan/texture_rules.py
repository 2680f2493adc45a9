"""By which rules a tile of the orthoimage is made, from the settings of the stage."""

from math import inf

from orthomill.schemas.surface import Surface
from orthomill.tasks.colouring.blending.colour_rules import colour_rules_of
from orthomill.tasks.texture.mosaic import TextureRules
from orthomill.tasks.texture.stage import TextureStage


def texture_rules(asked: TextureStage, surface: Surface) -> TextureRules:
    """How a tile is made on a surface model."""
    cell = surface.grid.cell
    return TextureRules(
        # Between two cells the interpolated surface may exceed the true one by half a cell on a slope of one.
        tolerance=0.5 * cell if asked.tolerance == "auto" else asked.tolerance,
        bridge=asked.bridge,
        drape_reach=_reach(asked, cell),
        widening_margin=asked.occlusion_margin,
        widening_ramp=asked.occlusion_ramp,
        sharpen=asked.edges.kind == "sharpen",
        colours=colour_rules_of(asked),
        wanted=surface.wanted,
    )


def _reach(asked: TextureStage, cell: float) -> float:
    """How far holes are draped, in cells of the surface model."""
    if asked.holes.kind == "leave":
        return 0.0
    return inf if asked.holes.max_gap == "unlimited" else asked.holes.max_gap / cell
