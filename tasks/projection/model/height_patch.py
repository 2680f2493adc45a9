"""A part of a height model as triangles with a picture on it."""

import numpy as np

from orthomill.tasks.projection.model.glb import ModelPart, as_jpeg


def height_patch(heights: np.ndarray, cell: float, corner: np.ndarray, picture: np.ndarray, skirt: float) -> ModelPart | None:
    """Triangles between the centres of cells (rows, cols) of heights m, NaN where there is none; None where no triangle is left.

    corner (3,) m: the centre of the upper left cell, relative to the model's origin, with Z of a height of 0. picture (h, w, 3) of
    the cells, to their borders. skirt m: how far the border hangs down, so that a neighbour of another resolution leaves no crack.
    """
    rows, cols = heights.shape
    known = np.isfinite(heights)
    row, col = np.mgrid[:rows, :cols]
    number = np.arange(rows * cols).reshape(rows, cols)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    triangles = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, c, b), (b, c, d))])
    triangles = triangles[known.ravel()[triangles].all(axis=1)]
    if not len(triangles):
        return None
    xyz = np.column_stack([col.ravel() * cell, -row.ravel() * cell, np.nan_to_num(heights).ravel()]) + corner
    places = np.column_stack([(col.ravel() + 0.5) / cols, (row.ravel() + 0.5) / rows])
    if skirt > 0:
        rim = _rim(triangles)
        below = np.arange(rim.size).reshape(rim.shape) + len(xyz)
        first, second, under, beyond = rim[:, 0], rim[:, 1], below[:, 0], below[:, 1]
        hanging = np.concatenate([np.stack(t, -1) for t in ((first, under, second), (second, under, beyond))])
        xyz = np.concatenate([xyz, xyz[rim.ravel()] - [0.0, 0.0, skirt]])
        places, triangles = np.concatenate([places, places[rim.ravel()]]), np.concatenate([triangles, hanging])
    used, renumbered = np.unique(triangles, return_inverse=True)
    return ModelPart(xyz[used], renumbered.reshape(-1, 3), places[used], as_jpeg(picture))


def _rim(triangles: np.ndarray) -> np.ndarray:
    """(E, 2): the edges that only one triangle has, in its direction."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    _, which, times = np.unique(edges.min(axis=1) << 32 | edges.max(axis=1), return_inverse=True, return_counts=True)
    return edges[times[which] == 1]
