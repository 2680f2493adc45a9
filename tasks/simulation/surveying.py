"""The results of a survey of the simulated block: GNSS positions, control and check points, and their image measurements.

Points are near the nodes of a lattice over the part of the block that two photos of a strip share, on open ground away from any
object, where as many photos as possible actually see them. Control points are chosen by farthest-point sampling, so that they
surround the block; the others are check points.
"""

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy.ndimage import minimum_filter, uniform_filter

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.truth import ControlRows, Material, MeasurementRows, PositionRows
from orthomill.tasks.geometry.view import View
from orthomill.tasks.simulation.flight import CENTRE, FlightSettings, views

REACH = 45.0
"""m around a lattice node that are searched for a place"""
CLEAR = 6.0
"""m around a point that are free of roads, walls, crowns and water"""
_STEEPEST = 0.25  # m per m: on a slope an error in plan becomes one in height
_SURVEY_DRAWS, _GNSS_DRAWS = 4, 5  # streams of random numbers of the flight's seed
_IN_FRAME = 0.92, 0.43  # along the strips, share of the common ground; across, share of the side of the frame


@dataclass(frozen=True)
class SurveySettings:
    """Number and precision of what is surveyed."""

    control: int
    check: int
    control_sigma: float
    """m, of every coordinate of a point"""
    gnss_sigma: float
    """m, of every coordinate of a projection centre"""
    image_sigma: float
    """px, of every image measurement"""


class SurveyPoint(BaseModel):
    """A place found for a ground point: its true position and the numbers of the photos that truly see it."""

    model_config = ConfigDict(frozen=True)

    xyz: tuple[float, float, float]
    photos: tuple[int, ...]


def lattice(flight: FlightSettings, count: int) -> tuple[tuple[float, float], ...]:
    """`count` nodes (x, y) m, distributed evenly over the ground that at least two photos of the block share."""
    side = flight.frame_mm / 1000.0 * flight.scale
    # The outermost photos of a strip share ground with one neighbour only: two bases less than all of them cover.
    half_x = _IN_FRAME[0] * max((flight.photos_per_strip - 3) / 2 * flight.base_m + side / 2, side / 4)
    half_y = (flight.strips - 1) / 2 * flight.strip_distance + _IN_FRAME[1] * side
    cols = max(int(np.ceil(np.sqrt(count * half_x / half_y))), 2)
    rows = max(-(-count // cols), 2)
    nodes = [(CENTRE[0] + half_x * a, CENTRE[1] + half_y * b) for b in np.linspace(-1, 1, rows) for a in np.linspace(-1, 1, cols)]
    return tuple((float(nodes[k][0]), float(nodes[k][1])) for k in farthest_first(np.array(nodes))[:count])


def farthest_first(points: np.ndarray) -> list[int]:
    """The order of points (N, 2) in which each is the farthest from all before it; the first is the farthest from the middle."""
    order = [int(np.argmax(np.hypot(*(points - points.mean(axis=0)).T)))]
    distance = np.hypot(*(points - points[order[0]]).T)
    while len(order) < len(points):
        order.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.hypot(*(points - points[order[-1]]).T))
        distance[order] = -1.0
    return order


def search_window(grid: MapGrid, node: tuple[float, float]) -> Window:
    """The cells around a lattice node among which a place is searched."""
    col, row = grid.pixel(np.array(node[0]), np.array(node[1]))
    reach = int(REACH / grid.cell)
    return Window(int(row) - reach, int(col) - reach, 2 * reach, 2 * reach).clipped(grid.shape)


def find_place(
    node: tuple[float, float], grid: MapGrid, window: Window, cells: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> SurveyPoint:
    """The place nearest to `node` among those that most photos see; `cells` are height (m), material and visibility of `window`.

    Raises GeometryError where two photos see no open ground.
    """
    height, material, seen = cells
    size = 2 * int(CLEAR / grid.cell) + 1
    # No roads: vehicles may cover a point there in one of the photos.
    bare = np.isin(material, (Material.OPEN_GROUND, Material.FIELD))
    free = minimum_filter(bare.astype(np.uint8), size, mode="constant") > 0
    level = np.hypot(*np.gradient(uniform_filter(height, 5), grid.cell)) < _STEEPEST
    # The smallest mask of the nine cells: next to an occlusion some cells are seen by fewer photos, and the count drops there.
    photos = np.bitwise_count(minimum_filter(seen, 3)) * (free & level)
    if photos.max() < 2:
        raise GeometryError(
            f"No open ground within {REACH:.0f} m of ({node[0]:.0f}, {node[1]:.0f}) is seen by two photos; "
            "request fewer ground points, fewer buildings or more overlap."
        )
    x, y = grid.centres(window)
    distance = np.hypot(x[None, :] - node[0], y[:, None] - node[1])
    row, col = np.unravel_index(np.argmin(np.where(photos == photos.max(), distance, np.inf)), distance.shape)
    bits = int(seen[row, col])
    return SurveyPoint(
        xyz=(float(x[col]), float(y[row]), float(height[row, col])), photos=tuple(k for k in range(32) if bits >> k & 1)
    )


def survey(
    flight: FlightSettings, settings: SurveySettings, points: tuple[SurveyPoint, ...]
) -> tuple[ControlRows, MeasurementRows]:
    """Surveyed coordinates and the measurements in every photo that actually sees the points, both with normal errors."""
    generator = np.random.default_rng([flight.seed, _SURVEY_DRAWS])
    true = np.array([point.xyz for point in points]).reshape(-1, 3)
    xyz = (true + generator.normal(0.0, settings.control_sigma, true.shape)).round(4)
    roles = ["control"] * settings.control + ["check"] * (len(points) - settings.control)
    names = [f"{role[:2].upper()}{k:02d}" for role, k in zip(roles, _counted(roles), strict=True)]
    sigma = np.full(len(points), settings.control_sigma)
    x, y, z = xyz.T
    control = ControlRows(
        name=np.array(names, dtype=str), role=np.array(roles, dtype=str), x=x, y=y, z=z, sigma_x=sigma, sigma_y=sigma, sigma_z=sigma
    )
    return control, _measure(views(flight), names, points, settings.image_sigma, generator)


def _counted(words: list[str]) -> list[int]:
    """The running number of every word among its equals, from 1."""
    return [words[: k + 1].count(word) for k, word in enumerate(words)]


def _measure(
    photos: tuple[View, ...], names: list[str], points: tuple[SurveyPoint, ...], sigma: float, generator: np.random.Generator
) -> MeasurementRows:
    """Projections of the true points with normal errors, point by point."""
    seen = [(k, photo) for k, point in enumerate(points) for photo in point.photos]
    true = np.array([photos[photo].project(np.array([points[k].xyz]))[0] for k, photo in seen]).reshape(-1, 2)
    pixels = (true + generator.normal(0.0, sigma, true.shape)).round(3)
    return MeasurementRows(
        np.array([names[k] for k, _ in seen], str),
        np.array([photos[photo].name for _, photo in seen], str),
        pixels[:, 0],
        pixels[:, 1],
        np.full(len(seen), sigma),
    )


def positions(flight: FlightSettings, settings: SurveySettings) -> PositionRows:
    """The projection centres as measured by GNSS, with normal errors."""
    photos = views(flight)
    true = np.array([view.centre for view in photos])
    generator = np.random.default_rng([flight.seed, _GNSS_DRAWS])
    xyz = (true + generator.normal(0.0, settings.gnss_sigma, true.shape)).round(4)
    sigma = np.full(len(photos), settings.gnss_sigma)
    x, y, z = xyz.T
    return PositionRows(photo=np.array([view.name for view in photos]), x=x, y=y, z=z, sigma_x=sigma, sigma_y=sigma, sigma_z=sigma)
