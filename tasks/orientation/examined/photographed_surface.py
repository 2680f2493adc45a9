"""How much of the photographed surface several photographs see, for a field as for a facade.

The surface is where the tie points are: every photograph is divided into cells, each of which lies as far in front of it as its
nearest tie point does, and is then looked for in all other photographs. What hides what is not examined.
"""

import numpy as np
from scipy.spatial import cKDTree

from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.imagery.photograph_rows import rows_of_photos
from orthomill.tasks.orientation.examined.block_facts import Facts

CELLS = 3600
"""Cells of all photographs together: they give a percentage to better than a percent."""
LEAST_SIDE = 3
"""Cells along each side of a photograph at least, however many photographs there are."""


def coverage(facts: Facts) -> tuple[float, float]:
    """Percent of the photographed surface that two and three photographs see; 0 where no surface is known."""
    if not len(facts.points):
        return 0.0, 0.0
    views = [block_view(facts.block, name) for name in facts.block.names]
    own_points = _own_points(facts)
    side = max(LEAST_SIDE, round(float(np.sqrt(CELLS / len(views)))))
    places, area = [], []
    for view in views:
        depth, ground = _cells(view, own_points[view.name], side)
        places.append(ground)
        area.append((depth / view.camera.c) ** 2)
    ground = np.vstack(places)
    count = np.sum([view.contains(view.project(ground)) for view in views], axis=0)
    # What n photographs see is divided into cells n times.
    share = np.concatenate(area) / np.maximum(count, 1)
    seen = float(share.sum())
    by_two, by_three = (float(share[count >= least].sum()) for least in (2, 3))
    return (100.0 * by_two / seen, 100.0 * by_three / seen) if seen else (0.0, 0.0)


def _own_points(facts: Facts) -> dict[str, np.ndarray]:
    """(n, 3) m the tie points that each photograph measured, by its name; all of the block where it measured none."""
    points, image = facts.points, facts.image
    places = np.column_stack([points.x, points.y, points.z])
    order = np.argsort(points.track)
    at = np.searchsorted(points.track, image.track, sorter=order).clip(0, len(order) - 1)
    row = order[at]
    used = np.flatnonzero(image.used & (points.track[row] == image.track))
    parts = rows_of_photos(image.photo[used], len(facts.photos.names))
    own = {name: row[used[part]] for name, part in zip(facts.photos.names, parts, strict=True)}
    return {name: places[rows] if len(rows) else places for name, rows in own.items()}


def _cells(view: View, points: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Depths (side * side,) m of the cells of a photograph, and their places (side * side, 3) m; none without `points` (n, 3) in
    front of it."""
    pixels = view.project(points)
    ahead = np.isfinite(pixels).all(axis=1)
    if not ahead.any():
        return np.zeros(0), np.zeros((0, 3))
    share = (np.arange(side) + 0.5) / side
    col, row = np.meshgrid(share * (view.camera.width - 1), share * (view.camera.height - 1))
    cells = np.column_stack([col.ravel(), row.ravel()])
    nearest = points[ahead][cKDTree(pixels[ahead]).query(cells)[1]]
    depth = (view.centre - nearest) @ view.rotation[2]
    rays = view.rays(cells)
    return depth, view.centre - rays * (depth / (rays @ view.rotation[2]))[:, None]
