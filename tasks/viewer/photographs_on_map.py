"""What the map tells of the photographs: where each was taken, when, and what it shows of the ground."""

import colorsys

import numpy as np

from orthomill.schemas.maps.map_page import MapCamera
from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.tasks.geometry.view import View, block_view

SIDE = 6
"""places along each side of a photograph from which its outline on the ground is drawn: lenses bend it"""
_TURN = (np.sqrt(5.0) - 1.0) / 2.0
"""of the circle of hues from one photograph to the next: by the golden section no two of a strip look alike"""


def map_cameras(block: Block, photos: Photos) -> tuple[MapCamera, ...]:
    """The photographs of a block on the ground at its mean height."""
    return tuple(_camera(block_view(block, name), photos, block.ground_mean) for name in block.names)


def photograph_classes(block: Block, photos: Photos) -> tuple[tuple[int, str, str], ...]:
    """Number in `ORTHO_SOURCE`, colour "#rrggbb", and name with the time of every photograph."""
    nothing = (0, "#ffffff", "no photograph")
    names = block.names
    return nothing, *((k, _hue(k), f"{name}, {photos[name].time or 'time unknown'}") for k, name in enumerate(names, 1))


def _hue(number: int) -> str:
    return "#" + "".join(f"{round(255 * value):02x}" for value in colorsys.hsv_to_rgb(number * _TURN % 1.0, 0.55, 0.85))


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
