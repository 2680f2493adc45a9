"""The flight over a simulated scene: the camera, the exterior orientations, and how each photograph renders brightness.

Numbers after the Volos block (Karfis 2009; sources/epipolar.md#data): scale 1:6800, c = 153.353 mm,
23 cm frame, base 582 m; rotations of about a degree, kappa up to two degrees, every second strip in the opposite direction.
Everything random is drawn per flight in metres and degrees, so that another pixel size renders the same flight.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import BrownLens, Camera
from orthomill.schemas.orientation import Block, ExteriorOrientation
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.footprint import ground_bounds
from orthomill.tasks.geometry.view import View, view_of
from orthomill.tasks.simulation.scene.layout import Scene, SceneSettings, height_bounds, scene_bounds

CENTRE = (408000.0, 4357000.0)
"""Middle of every block, near Volos, in EPSG:2100."""
PLAIN = 38.0
"""m: mean height of the plain"""
FULL_FRAME = 230.0
"""mm: the frame for which the principal point's offset is stated"""
BLOCK = 8
"""Surface windows begin on multiples of this many cells, as the coarse level of the renderer requires."""
_FULL_HEIGHT = 1043.0  # m: flying height of the full block, for which the scatter of positions below is stated
_OFF_TRACK, _MOST_OFF = (5.0, 7.0, 6.0), 15.0  # m: standard deviations along, across and in height, and their limit
_TILT, _MOST_TILT, _MOST_KAPPA = 0.8, 1.6, 2.0  # degrees
_MARGIN = 12.0  # m of scene beyond what the photographs show
_FLIGHT_DRAWS, _EXPOSURE_DRAWS = 1, 2  # streams of random numbers of a seed; vehicles have 3, the survey 4 and 5


@dataclass(frozen=True)
class FlightSettings:
    """Camera and flight as a flight plan states them."""

    seed: int
    frame_mm: float
    c_mm: float
    pixel_um: float
    scale: float
    base_m: float
    side_overlap: float
    strips: int
    photos_per_strip: int

    @property
    def height(self) -> float:
        """Flying height above the plain, m."""
        return self.scale * self.c_mm / 1000.0

    @property
    def strip_distance(self) -> float:
        """m"""
        return (1.0 - self.side_overlap) * self.frame_mm / 1000.0 * self.scale


@dataclass(frozen=True)
class FlightExposure:
    """How one photograph converts light to grey levels: offset + gain * (1 - vignetting * (r / r_corner)^2) * light."""

    number: int
    """counted from 0; determines noise and vehicles"""
    gain: tuple[float, float, float]
    offset: float
    vignetting: float


def camera_of(flight: FlightSettings) -> Camera:
    """The true camera: a Brown distortion of some 20 px in the corners (96 micrometres) and an eccentric principal point."""
    # All lengths scale with the pixel, so that every pixel size shows the same camera; the distortion is in units of c.
    size = round(flight.frame_mm * 1000.0 / flight.pixel_um)
    in_pixels = 1000.0 / flight.pixel_um
    offset = flight.frame_mm / FULL_FRAME * in_pixels
    return Camera(
        name="volos",
        width=size,
        height=size,
        c=flight.c_mm * in_pixels,
        x0=0.42 * offset,
        y0=-0.31 * offset,
        lens=BrownLens(k1=-0.0155, k2=0.0042, p1=1.8e-4, p2=-1.3e-4),
        pixel_um=flight.pixel_um,
        source="truth",
    )


def orientations(flight: FlightSettings) -> tuple[ExteriorOrientation, ...]:
    """The true exterior orientations, strip by strip in the order of flight."""
    generator = np.random.default_rng([flight.seed, _FLIGHT_DRAWS])
    # All photos draw from one generator in turn, so the order of these loops is part of what the seed determines.
    return tuple(
        _orientation(flight, strip, number, generator)
        for strip in range(flight.strips)
        for number in range(flight.photos_per_strip)
    )


def _orientation(flight: FlightSettings, strip: int, number: int, generator: np.random.Generator) -> ExteriorOrientation:
    """The orientation of one photo, `number` counted along the direction in which the strip is flown."""
    back = strip % 2 == 1
    place = flight.photos_per_strip - 1 - number if back else number
    east = (place - (flight.photos_per_strip - 1) / 2) * flight.base_m
    north = (strip - (flight.strips - 1) / 2) * flight.strip_distance
    centre = np.array([CENTRE[0] + east, CENTRE[1] + north, PLAIN + flight.height])
    centre += np.clip(generator.normal(0.0, _OFF_TRACK), -_MOST_OFF, _MOST_OFF) * (flight.height / _FULL_HEIGHT)
    tilt = np.clip(generator.normal(0.0, _TILT, 2), -_MOST_TILT, _MOST_TILT)
    kappa = generator.uniform(-_MOST_KAPPA, _MOST_KAPPA) + (180.0 if back else 0.0)
    # Rounded as they are written to files, so that what is read back is the truth to the last digit.
    x, y, z = centre.round(4).tolist()
    omega, phi = tilt.round(5).tolist()
    return ExteriorOrientation(
        photo=f"volos_{strip + 1}_{number + 1}", centre=(x, y, z), omega_phi_kappa=(omega, phi, round(float(kappa), 5))
    )


def views(flight: FlightSettings) -> tuple[View, ...]:
    """The true views in the order of `orientations`."""
    camera = camera_of(flight)
    return tuple(view_of(orientation, camera) for orientation in orientations(flight))


def exposure(flight: FlightSettings, number: int) -> FlightExposure:
    """Brightness rendering of photo `number`."""
    generator = np.random.default_rng([flight.seed, _EXPOSURE_DRAWS, number])
    # One gain for the exposure, and up to 3 % per band for the colour balance of the film.
    gain = generator.uniform(0.84, 1.12) * (1.0 + generator.uniform(-0.03, 0.03, 3))
    red, green, blue = gain.round(4).tolist()
    offset, vignetting = round(float(generator.uniform(-6.0, 10.0)), 2), round(float(generator.uniform(0.08, 0.24)), 3)
    return FlightExposure(number, (red, green, blue), offset, vignetting)


def scene_settings(flight: FlightSettings, buildings: int, wood: float = 0.0) -> SceneSettings:
    """The scene under the flight: all ground above 0 m that any photograph can show, in multiples of ten metres. wood: radius of a
    closed wood, m.

    Computed with a camera of fixed pixel count, so that the scene does not depend on the pixel size.
    """
    coarse = views(replace(flight, pixel_um=flight.frame_mm))
    bounds = np.array([ground_bounds(view, 0.0, 2.0 * PLAIN) for view in coarse])
    west, south = np.floor((bounds[:, :2].min(axis=0) - _MARGIN) / 10.0) * 10.0
    east, north = np.ceil((bounds[:, 2:].max(axis=0) + _MARGIN) / 10.0) * 10.0
    return SceneSettings(
        seed=flight.seed,
        west=float(west),
        south=float(south),
        east=float(east),
        north=float(north),
        flying_height=flight.height,
        buildings=buildings,
        wood=wood,
    )


def scene_grid(settings: SceneSettings, cell: float) -> MapGrid:
    """The map grid of the scene's rasters."""
    west, south, east, north = scene_bounds(settings)
    rows, cols = int(np.ceil((north - south) / cell)), int(np.ceil((east - west) / cell))
    return MapGrid(west=west, north=north, cell=cell, rows=rows, cols=cols)


def true_block(flight: FlightSettings, scene: Scene, crs: str) -> Block:
    """All true orientations and the camera as a block."""
    return block_of_truth(crs, camera_of(flight), orientations(flight), height_bounds(scene, scene_bounds(scene.settings)))


def block_of_truth(crs: str, camera: Camera, photos: tuple[ExteriorOrientation, ...], heights: tuple[float, float]) -> Block:
    """True orientations and the camera of all of them as a block; heights: the lowest and the highest of the ground, m."""
    return Block(
        crs=crs,
        cameras={camera.name: camera},
        of_photo={photo.photo: camera.name for photo in photos},
        photos=photos,
        datum="The true values of the simulation.",
        sigma0_px=0.0,
        redundancy=0,
        iterations=0,
        ground_low=heights[0],
        ground_high=heights[1],
    )


def seen_window(view: View, scene: Scene, grid: MapGrid, pixels: Window) -> Window:
    """The window of `grid` that the photo window `pixels` can show, aligned to BLOCK cells.

    Heights are bounded twice: first by the whole scene, then by the objects in the window found.
    """
    bounds = scene_bounds(scene.settings)
    # The second bounds are much tighter in the plain, and a third pass would gain nothing more.
    for _ in range(2):
        low, high = height_bounds(scene, bounds)
        bounds = _ground_under(view, pixels, low, high)
    margin = 3.0 * grid.cell + 1.0
    first = np.array([grid.north - bounds[3] - margin, bounds[0] - grid.west - margin]) / (grid.cell * BLOCK)
    last = np.array([grid.north - bounds[1] + margin, bounds[2] - grid.west + margin]) / (grid.cell * BLOCK)
    (row, col), (bottom, right) = np.floor(first).astype(int).tolist(), np.ceil(last).astype(int).tolist()
    return Window(row * BLOCK, col * BLOCK, (bottom - row) * BLOCK, (right - col) * BLOCK).clipped(grid.shape)


def _ground_under(view: View, pixels: Window, low: float, high: float) -> tuple[float, float, float, float]:
    """(west, south, east, north) of what a photo window shows between two heights, m."""
    # Five points along each side: distortion bends the borders of a window outwards between its corners.
    col = np.linspace(pixels.col - 1.0, pixels.col + pixels.width, 5)
    row = np.linspace(pixels.row - 1.0, pixels.row + pixels.height, 5)
    border = np.array([(c, r) for c in col for r in row if c in (col[0], col[-1]) or r in (row[0], row[-1])])
    ground = np.vstack([view.at_height(border, low), view.at_height(border, high)])[:, :2]
    (west, south), (east, north) = ground.min(axis=0), ground.max(axis=0)
    return float(west), float(south), float(east), float(north)
