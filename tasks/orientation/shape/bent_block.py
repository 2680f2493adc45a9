"""The finding that a block is bent, from its positions and its attitudes, before and whatever the standard errors of either."""

from collections.abc import Iterator

import numpy as np

from orthomill.schemas.findings.datum_findings import BlockBent
from orthomill.tasks.adjustment.model.datum import antennas
from orthomill.tasks.adjustment.testing.position_trend import HeightTrend, height_trend
from orthomill.tasks.orientation.block.assembly import BlockResults
from orthomill.tasks.orientation.shape.view_trend import ViewTrend, view_trend

LEAST_DEGREES = 1.0
"""A smaller divergence of views is what gimbals may drift by."""
VIEWS_DIVERGE = 4.0
"""Standard errors by which views diverge: errors of a gimbal scatter, so that chance exceeds it once in ten thousand blocks."""
CERTAIN = 10.0
"""Standard errors of a bend against positions from which on it is none of the receiver: the height of a barometer errs by half a
metre wherever a drone brakes at the end of a strip, and looks like a bend of all strips."""
BENT_PIXELS = 5.0
"""Pixels on the ground from which on a bend puts results in doubt: what tie points and models of lenses leave is less."""


OPEN = 3.0
"""Standard errors of a bend by the photographs themselves within which they do not tell it from none."""


def bent_block(results: BlockResults, stated: float | None = None) -> Iterator[BlockBent]:
    """Whether heights bend over the block, by its positions, or its photographs turn with it, by their attitudes; `stated`: the
    standard error of a bend of the block, m (None: not known)."""
    heights, views = _heights(results), _views(results)
    by_heights = heights is not None and heights.is_bent
    by_views = views is not None and abs(views.ratio) > VIEWS_DIVERGE and abs(views.degrees) > LEAST_DEGREES
    if not (by_heights or by_views):
        return
    bend = heights.bend if by_heights and heights else views.bend if views else 0.0
    pixel = _ground_pixel(results)
    yield BlockBent(
        bend_m=bend,
        extent_m=2.0 * heights.radius if by_heights and heights else views.extent if views else 0.0,
        pixels=abs(bend) / pixel,
        scatter_m=heights.scatter if by_heights and heights else None,
        views_deg=views.degrees if by_views and views else None,
        grave=abs(bend) > BENT_PIXELS * pixel,
        sure=by_views or (heights is not None and abs(heights.ratio) > CERTAIN),
        in_metres=not results.datum.free,
        open_m=stated if stated is not None and not by_views and abs(bend) < OPEN * stated else None,
    )


def _heights(results: BlockResults) -> HeightTrend | None:
    """The trend of block minus given heights of the antennas; None for a free block, which has none."""
    if results.datum.free:
        return None
    known = results.problem.known
    has = known.positioned
    given = known.position[has] - results.datum.origin
    found = antennas(results.result.network, results.result.state)[has]
    return height_trend(found[:, :2], found[:, 2] - given[:, 2])


def _views(results: BlockResults) -> ViewTrend | None:
    state, up = results.result.state, results.problem.known.up
    has = np.isfinite(up).all(axis=1)
    return view_trend(state.centre[has, :2], state.rotation[has], up[has])


def _ground_pixel(results: BlockResults) -> float:
    """m: a typical pixel on the ground."""
    result = results.result
    rays = result.rays.take(result.used)
    depth = np.linalg.norm(result.state.point[rays.point] - result.state.centre[rays.photo], axis=1)
    return float(np.median(depth / result.state.interior[result.network.camera_of[rays.photo], 0]))
