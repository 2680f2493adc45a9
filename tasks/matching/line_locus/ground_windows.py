"""The parts of photographs as images for the search: as they are, or rectified to a plane so that windows have the axes of the map.

A photograph rectified to the horizontal plane Z0 is one without tilt and without lens, of camera constant (Zc - Z0) / pitch:
heights off the plane shift and scale it exactly, so that it is projected into like any other.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orthomill.tasks.geometry.distortion import NO_LENS
from orthomill.tasks.geometry.view import View, ViewNumbers
from orthomill.tasks.matching.line_locus.window_correlation import GreyImage
from orthomill.tasks.matching.volume.rectified_photograph import PhotographPixels, PlaneFrame, on_plane

_ABOVE = 0.05
"""share of its flying height above the highest ground that a photograph must keep to be rectified"""


@dataclass(frozen=True)
class NodeArea:
    """The nodes of a block and the heights that they may have: X and Y of the first and the last ones (west, south, east, north),
    lowest and highest height, m."""

    bounds: tuple[float, float, float, float]
    low: float
    high: float


def as_taken(pixels: PhotographPixels, view: View) -> GreyImage:
    """A photograph with its own axes."""
    return GreyImage(pixels.grey, view.numbers, 0.5**pixels.level, float(pixels.col), float(pixels.row))


def to_plane(parts: Sequence[tuple[PhotographPixels, View]], area: NodeArea, pitch: float, half: int) -> list[GreyImage]:
    """Photographs on the middle plane of the nodes, with pixels of `pitch` m and `half` of them around the nodes at any height."""
    plane = (area.low + area.high) / 2
    return [_on_plane(pixels, view, plane, _frame(view, area, plane, pitch, half)) for pixels, view in parts]


def _frame(view: View, area: NodeArea, plane: float, pitch: float, half: int) -> PlaneFrame:
    above = np.maximum(view.centre[2] - np.array([area.low, area.high]), _ABOVE * abs(view.centre[2] - plane) + 1e-9)
    scales = (view.centre[2] - plane) / above
    west, south, east, north = area.bounds
    # Two pixels more: one for interpolation, one for rounding.
    margin = (half + 2) * pitch
    x = view.centre[0] + (np.array([west, east]) - view.centre[0])[:, None] * scales
    y = view.centre[1] + (np.array([south, north]) - view.centre[1])[:, None] * scales
    # Whole pixels of the map, so that the grey values do not depend on where a block begins.
    first, top = np.floor((x.min() - margin) / pitch), np.ceil((y.max() + margin) / pitch)
    cols, rows = np.ceil((x.max() + margin) / pitch) - first, top - np.floor((y.min() - margin) / pitch)
    return PlaneFrame(float(first * pitch), float(top * pitch), pitch, int(rows) + 1, int(cols) + 1)


def _on_plane(pixels: PhotographPixels, view: View, plane: float, frame: PlaneFrame) -> GreyImage:
    x, y, z = map(float, view.centre)
    numbers = ViewNumbers(
        1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, x, y, z,
        (z - plane) / frame.pitch, (x - frame.x) / frame.pitch, (frame.y - y) / frame.pitch,
        NO_LENS, float(frame.cols), float(frame.rows),
    )  # fmt: skip
    return GreyImage(on_plane(pixels, view, frame, plane), numbers)
