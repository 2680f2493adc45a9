"""The window of a photograph that shows a window of the map, and the ground that a photograph shows: planning declares regions with
them, so they may be too large but not too small. And its outline on the ground, for a map."""

import numpy as np

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.view import View


def photo_window(view: View, grid: MapGrid, window: Window, low: float, high: float, margin: int = 8) -> Window:
    """The window of a photograph that shows the cells `window` of `grid` at any height in [low, high] (m).

    `margin` px wider on each side and clipped to the photograph; empty where the photograph does not see the cells.
    """
    # Points along the edges and not the corners only: distortion bends the edges outwards between them.
    x = grid.west + grid.cell * np.linspace(window.col, window.col + window.width, 9)
    y = grid.north - grid.cell * np.linspace(window.row, window.row + window.height, 9)
    xyz = np.stack(np.meshgrid(x, y, [low, high]), axis=-1).reshape(-1, 3)
    pixels = view.project(xyz)
    pixels = pixels[np.isfinite(pixels).all(axis=1)]
    if not len(pixels):
        return Window(0, 0, 0, 0)
    # Far outside the frame the distortion polynomial leaves the range of integers.
    pixels = np.clip(pixels, -1e9, 1e9)
    col, row = np.floor(pixels.min(axis=0)).astype(int) - margin
    right, bottom = np.ceil(pixels.max(axis=0)).astype(int) + 1 + margin
    return Window(int(row), int(col), int(bottom - row), int(right - col)).clipped((view.camera.height, view.camera.width))


def ground_bounds(view: View, low: float, high: float) -> tuple[float, float, float, float]:
    """(west, south, east, north) in m of all ground that the photograph can show at heights in [low, high].

    Rays of the border that never reach the ground (an oblique view above the horizon) are left out.
    """
    edge = np.linspace(0.0, 1.0, 17)
    col, row = (view.camera.width - 1) * edge, (view.camera.height - 1) * edge
    border = np.concatenate(
        [
            np.column_stack([col, np.zeros(17)]),
            np.column_stack([col, np.full(17, view.camera.height - 1.0)]),
            np.column_stack([np.zeros(17), row]),
            np.column_stack([np.full(17, view.camera.width - 1.0), row]),
        ]
    )
    ground = np.vstack([view.at_height(border, low), view.at_height(border, high)])
    west, south = np.nanmin(ground[:, :2], axis=0)
    east, north = np.nanmax(ground[:, :2], axis=0)
    return float(west), float(south), float(east), float(north)


def ground_outline(view: View, height: float) -> tuple[tuple[float, float], ...]:
    """The four corners (x, y) in m of what a photograph shows at a height; empty for a view that reaches the horizon."""
    right, low = view.camera.width - 1.0, view.camera.height - 1.0
    ground = view.at_height(np.array([[0.0, 0.0], [right, 0.0], [right, low], [0.0, low]]), height)
    if not np.isfinite(ground).all():
        return ()
    return tuple((round(float(x), 3), round(float(y), 3)) for x, y, _ in ground)
