"""The colours of points of a surface: from every photograph that sees a point, by the rules that hold for any surface.

Next to the limit of what is hidden (`widening/hidden_edges.py`) a colour counts for almost nothing.

Source: Petsa et al. 2007 (sources/blending.md, M6, M7, M8, M9, M12, M13).
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import Window
from orthomill.tasks.colouring.balance.photo_radiometry import Radiometry, in_block
from orthomill.tasks.colouring.blending.blending import Blended, blend
from orthomill.tasks.colouring.blending.colour_rules import ColourRules
from orthomill.tasks.colouring.blending.reserves import fading, reserved
from orthomill.tasks.colouring.sampling.photograph_colours import PhotoPixelsAt, most_bands
from orthomill.tasks.colouring.sampling.surface_sampling import of_tile, sample_points
from orthomill.tasks.colouring.sight.output_tile import PhotographsAtHand
from orthomill.tasks.colouring.sight.sight_rasters import TilePoints
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.visibility.output_frame import moved
from orthomill.tasks.visibility.sight import PlaceSight


@dataclass(frozen=True, eq=False)
class ShownPhotographs:
    """What colours points: `photos`, pixels at `at_hand.parts`; `zones` of the photographs at `at_hand.zones`; the block, and the
    mesh's `origin` (3,) m; `facing`: -1 for a mesh whose triangles face inwards."""

    at_hand: PhotographsAtHand
    photos: tuple[np.ndarray, ...]
    zones: tuple[np.ndarray, ...]
    block: Block
    origin: np.ndarray
    radiometry: Radiometry
    facing: float

    @property
    def views(self) -> list[View]:
        """The photographs of the parts."""
        return [moved(block_view(self.block, part.name), self.origin) for part in self.at_hand.parts]


@dataclass(frozen=True, eq=False)
class TileColours:
    """Colours (photographs, rows, cols, bands), weights, breaks and zones (photographs, rows, cols) of a tile: the number of the
    narrowest zone next to a limit that holds a value, 0 far from all limits. Without zones at hand a break of the depth is one."""

    colours: np.ndarray
    weights: np.ndarray
    breaks: np.ndarray
    zones: np.ndarray

    def near(self, within: int) -> np.ndarray:
        """bool (photographs, rows, cols): values in one of the first `within` zones."""
        return (self.zones > 0) & (self.zones <= within)

    def blended(self, rules: ColourRules, within: int = 0) -> Blended:
        """The colours as one; those in the first `within` zones serve where there are no others."""
        weights = reserved(self.weights, self.near(within)) if within else self.weights
        weights = fading(weights) if rules.finest else weights
        return blend(self.colours, weights, rules.blend, self.breaks if rules.breaks else None)


def tile_colours(surface: TilePoints, sight: np.ndarray, shown: ShownPhotographs, rules: ColourRules) -> TileColours:
    """The colours of points in every photograph at hand, in the radiometry of the block; sight (rows, cols, photographs)."""
    photos, parts, radiometry = shown.photos, shown.at_hand.parts, shown.radiometry
    shape = sight.shape[:2]
    bands = most_bands(photos)
    colours = np.zeros((len(parts), shape[0] * shape[1], bands), np.float32)
    weights = np.zeros((len(parts), shape[0] * shape[1]), np.float32)
    breaks, near = np.zeros((len(parts), *shape), bool), np.zeros((len(parts), shape[0] * shape[1]), np.uint8)
    windows = {part.name: (zone, part.window) for zone, part in zip(shown.zones, shown.at_hand.zones, strict=True)}
    for k, (view, pixels, part) in enumerate(zip(shown.views, photos, parts, strict=True)):
        code = sight[..., shown.at_hand.names.index(part.name)]
        breaks[k] = code == PlaceSight.AT_BREAK
        chosen = of_tile(surface, code) >= PlaceSight.AT_BREAK
        if not chosen.any():
            continue
        at_hand, border = PhotoPixelsAt.of(pixels, part.window, part.level), rules.border(view.camera)
        sampled = sample_points(view, at_hand, surface, chosen, shown.facing, border)
        if part.name in windows:
            near[k, sampled.at] = _zone_at(sampled.pixels, *windows[part.name])
        # Corrected before blending: rejection compares colours, and a gain of some per cent would look like a gross error.
        colours[k, sampled.at] = in_block(sampled.colour, sampled.r2, part.name, radiometry)
        weights[k, sampled.at] = sampled.weight
    flat = len(parts), *shape
    near = near if windows else breaks.astype(np.uint8)
    return TileColours(colours.reshape(*flat, bands), weights.reshape(flat), breaks, near.reshape(flat))


def _zone_at(pixels: np.ndarray, zone: np.ndarray, window: Window) -> np.ndarray:
    """uint8 (N,): the zone in which pixels (N, 2) of a photograph lie, whose zones are at hand for `window`."""
    places = np.floor(pixels + 0.5).astype(int) - (window.col, window.row)
    places = np.clip(places, 0, (window.width - 1, window.height - 1))
    return zone[places[:, 1], places[:, 0]]
