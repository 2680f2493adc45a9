"""Poles along a country road with a wire between them: thin things that stand above the surface and do not belong to it."""

from enum import IntEnum

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.simulation.scene.layout import Scene, ground_at, pond_distance

POLE_NUMBER = 65535
"""Poles have this number of a building while a photo is rendered."""
WIRE_RADIUS = 0.12
"""m: a bundle of cables"""
MARKED = 0.75
"""m from a wire or a pole in plan within which the ground is marked as lying under one"""
POLE_COLOUR = (96, 86, 74)
WIRE_COLOUR = (38.0, 38.0, 42.0)
_ROAD, _SPAN, _TALL, _SAG, _BESIDE = 0, 45.0, 9.0, 1.1, 1.8  # the road; m between poles, of their height, of the sag, off the edge


class SpanColumn(IntEnum):
    """Columns of a line of wires, for kernels: one row per span, from a pole to the next (m)."""

    X = 0
    Y = 1
    TO_X = 2
    TO_Y = 3
    Z = 4
    TO_Z = 5


def spans_of(scene: Scene) -> np.ndarray:
    """(S, 6) spans of wire along the first road: ends in plan, and the heights of the tops of their poles; none over the pond."""
    s = scene.settings
    along = np.arange(s.west + 0.5 * _SPAN, s.east, _SPAN)
    centre, _ = scene.roads.centre_line(_ROAD, along)
    y = centre + scene.roads.half_width[_ROAD] + _BESIDE
    z = ground_at(scene, along, y) + _TALL
    spans = np.column_stack([along[:-1], y[:-1], along[1:], y[1:], z[:-1], z[1:]])
    return spans[pond_distance(scene.pond, 0.5 * (along[:-1] + along[1:]), 0.5 * (y[:-1] + y[1:])) > 1.5]


@njit(inline="always")
def off_span(span, x, y):
    """Share of the way along a span (clamped to its ends) and distance from it in plan (m)."""
    dx, dy = span[SpanColumn.TO_X] - span[SpanColumn.X], span[SpanColumn.TO_Y] - span[SpanColumn.Y]
    east, north = x - span[SpanColumn.X], y - span[SpanColumn.Y]
    share = min(max((east * dx + north * dy) / (dx * dx + dy * dy), 0.0), 1.0)
    return share, np.sqrt((east - share * dx) ** 2 + (north - share * dy) ** 2)


@njit(inline="always")
def wire_height(span, share):
    """Height of the wire, m: a parabola, which a catenary of so little sag is."""
    straight = span[SpanColumn.Z] + share * (span[SpanColumn.TO_Z] - span[SpanColumn.Z])
    return straight - 4.0 * _SAG * share * (1.0 - share)


@njit()
def near_spans(marked, axes, spans, reach):
    """Sets `marked` (rows, cols) int32 to the number of the span, from 1, of cells within `reach` (m) of it in plan.

    `axes`: x (cols,) and y (rows,) of the cells' centres.
    """
    x, y = axes
    cell = x[1] - x[0]
    for k in range(spans.shape[0]):
        span = spans[k]
        low_x, high_x = min(span[SpanColumn.X], span[SpanColumn.TO_X]), max(span[SpanColumn.X], span[SpanColumn.TO_X])
        low_y, high_y = min(span[SpanColumn.Y], span[SpanColumn.TO_Y]), max(span[SpanColumn.Y], span[SpanColumn.TO_Y])
        left, right = (
            max(int(np.floor((low_x - reach - x[0]) / cell)), 0),
            min(int(np.ceil((high_x + reach - x[0]) / cell)) + 1, len(x)),
        )
        top, bottom = (
            max(int(np.floor((y[0] - high_y - reach) / cell)), 0),
            min(int(np.ceil((y[0] - low_y + reach) / cell)) + 1, len(y)),
        )
        for row in range(top, bottom):
            for col in range(left, right):
                _, distance = off_span(span, x[col], y[row])
                if distance <= reach:
                    marked[row, col] = k + 1
