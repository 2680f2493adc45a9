"""The small block of the tests: the flight of the full one with a quarter of its frame and flying height."""

from functools import cache

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.simulation.flight import FlightSettings, scene_grid, scene_settings, seen_window, views
from orthomill.tasks.simulation.scene.ground_texture import PaintedWindow, painted_window
from orthomill.tasks.simulation.scene.layout import Scene
from orthomill.tasks.simulation.scene.settlement import scene_of
from orthomill.tasks.simulation.simulated_tiles import Site

FLIGHT = FlightSettings(
    seed=2009, frame_mm=57.5, c_mm=38.34, pixel_um=96.0, scale=6800.0, base_m=145.0, side_overlap=0.6, strips=2, photos_per_strip=3
)


@cache
def site() -> Site:
    settings = scene_settings(FLIGHT, 20)
    return Site(settings, FLIGHT, scene_grid(settings, 0.5))


def scene() -> Scene:
    return scene_of(site().scene)


@cache
def whole() -> PaintedWindow:
    """The whole scene, painted."""
    return painted_window(scene(), site().grid, Window(0, 0, *site().grid.shape))


def ground_under(number: int, pixels: Window) -> tuple[MapGrid, Window, PaintedWindow]:
    """The scene under a window of a photo, as `render` takes it."""
    grid = site().grid
    window = seen_window(views(FLIGHT)[number], scene(), grid, pixels)
    return grid, window, painted_window(scene(), grid, window)
