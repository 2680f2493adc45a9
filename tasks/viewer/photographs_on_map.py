"""What the map tells of the photographs: where each was taken, when, and what it shows of the ground."""

import numpy as np

from orthomill.schemas.maps.map_page import MapCamera
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.tasks.geometry.view import View, block_view

SIDE = 6
"""places along each side of a photograph from which its outline on the ground is drawn: lenses bend it"""


def map_cameras(block: Block, photos: Photos) -> tuple[MapCamera, ...]:
    """The photographs of a block on the ground at its mean height."""
    return tuple(_camera(block_view(block, name), photos, block.ground_mean) for name in block.names)


def _camera(view: View, photos: Photos, ground: float) -> MapCamera:
    taken = photos[view.name].time or ""
    x, y, z = (round(float(value), 3) for value in view.centre)
    return MapCamera(name=view.name, centre=(x, y, z), outline=_outline(view, ground), taken=taken)


def _outline(view: View, ground: float) -> tuple[tuple[float, float], ...]:
    """Corners (x, y) m of what a photograph shows of a level ground; none where it looks above the horizon."""
    width, height = view.camera.width - 1, view.camera.height - 1
    t = np.arange(SIDE) / SIDE
    col = np.concatenate([t * width, np.full(SIDE, width), (1 - t) * width, np.zeros(SIDE)])
    row = np.concatenate([np.zeros(SIDE), t * height, np.full(SIDE, height), (1 - t) * height])
    rays = view.rays(np.column_stack([col, row]))
    down = rays[:, 2]
    if not (down < 0).all():
        return ()
    reach = (ground - view.centre[2]) / down
    places = np.asarray(view.centre)[:2] + reach[:, None] * rays[:, :2]
    return tuple((round(float(x), 2), round(float(y), 2)) for x, y in places)
