"""Bundles of the three applications of Petsa et al. (2007), simulated: cameras, numbers of photographs and control, noise.

Objects and stations are ours, for the report prints neither: (1) the church entrance of the embedded project `portal`, surveyed
control; (2) an entrance with strong differences of depth, control from a point cloud; (3) a curved wall and two parallel walls with
converging photographs, and one low wall photographed in a single parallel strip, all with control from a point cloud.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.tasks.adjustment.bundle import adjust
from orthomill.tasks.adjustment.model.collinearity import residuals
from orthomill.tasks.adjustment.model.network import Interior, Network, Rays, State
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector
from orthomill.tasks.geometry.view import View
from orthomill.tasks.simulation.portal.portal_block import portal_camera, portal_views, to_system

FREE = (0, 1, 2, 3, 4)
"""c, x0, y0, k1, k2: the parameters that the report prints"""


@dataclass(frozen=True)
class PublishedBlock:
    """A block as it was flown: `views`, true `points` (N, 3) m of which the first `control` are known to `sigma_m`, and the noise
    `sigma_px` of an image coordinate."""

    views: tuple[View, ...]
    points: np.ndarray
    control: int
    sigma_m: float
    sigma_px: float


def looking(name: str, camera: Camera, place: np.ndarray, aim: np.ndarray, roll: float) -> View:
    """A photograph from `place` that looks at `aim`, turned by `roll` degrees."""
    back = (place - aim) / np.linalg.norm(place - aim)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    return View(name, camera, rotation_of_vector([0, 0, -np.radians(roll)]) @ np.array([right, np.cross(back, right), back]), place)


def church() -> PublishedBlock:
    """Application 1: 7 photographs, 18 surveyed points, 0.28 px."""
    generator = np.random.default_rng(1)
    depth = np.repeat([-1.0, 0.0, 0.9], 20)
    places = np.column_stack([generator.uniform(-2.4, 2.4, 60), depth, generator.uniform(0.4, 5.2, 60)])
    return PublishedBlock(portal_views(), to_system(places), 18, 0.001, 0.28)


def entrance() -> PublishedBlock:
    """Application 2: 7 photographs, 10 targets from the scans, 0.25 px."""
    generator = np.random.default_rng(2)
    scale = 2575.78
    update = {"c": scale, "x0": 20.93, "y0": 16.17, "k1": -3.37e-8 * scale**2, "k2": 5.77e-15 * scale**4}
    views = tuple(replace(view, camera=portal_camera().model_copy(update=update)) for view in portal_views())
    places = np.column_stack([generator.uniform(-2.4, 2.4, 50), generator.uniform(-1.2, 1.6, 50), generator.uniform(0.4, 5.0, 50)])
    return PublishedBlock(views, to_system(places), 10, 0.003, 0.25)


def site(part: int, relief: float = 1.0) -> PublishedBlock:
    """Application 3, its parts 1 to 3: 17, 16 and 10 photographs, points of the cloud (7 mm) as control, 0.54 to 0.61 px. relief:
    times the depth of the low wall of part 3."""
    generator = np.random.default_rng(30 + part)
    c = 3415.0
    camera = Camera(
        name="site", width=3072, height=2304, c=c, x0=5.0, y0=8.0, k1=5.3e-9 * c**2, k2=1.2e-15 * c**4, pixel_um=2.3, source="truth"
    )
    count, noise = {1: (17, 0.54), 2: (16, 0.61), 3: (10, 0.58)}[part]
    if part == 1:
        angle = generator.uniform(-1.3, 1.3, 80)
        places = np.column_stack([4 * np.sin(angle), 4 * np.cos(angle), generator.uniform(0, 3, 80)])
    else:
        # A wall at right angles to the low one is all the depth of part 3.
        low = np.where(np.arange(80) % 8, generator.uniform(0.0, 0.15, 80), generator.uniform(-1.2, 0.0, 80))
        depth = np.where(np.arange(80) % 2, 2.5, 0.0) if part == 2 else relief * low
        places = np.column_stack([generator.uniform(-5, 5, 80), depth, generator.uniform(0, 3, 80)])
    along = np.linspace(-4.5, 4.5, count)
    views = []
    for number, x in enumerate(along):
        converging = part < 3
        # Strips at two distances; the low wall has one strip of parallel photographs.
        away = (-7.0 if number % 2 else -5.0) if converging else -7.0
        aim = np.array([0.45 * x if converging else x, 1.0, 1.6])
        turned = 90.0 if converging and number % 3 == 0 else 0.0
        place = np.array([x, away, 1.6 + 0.4 * generator.uniform(-1, 1)])
        views.append(looking(f"p{number}", camera, place, aim, turned + generator.normal(0, 1.5)))
    return PublishedBlock(tuple(views), places, 16, 0.007, noise)


def adjusted(block: PublishedBlock, seed: int) -> tuple[Adjustment, State]:
    """The self-calibrating adjustment of one set of errors, and the truth."""
    generator = np.random.default_rng([seed, 77])
    truth = State(
        np.array([view.rotation for view in block.views]),
        np.array([view.centre for view in block.views]),
        block.points,
        np.array([block.views[0].camera.interior]),
        np.zeros(3),
    )
    seen = np.array([view.contains(view.project(block.points)) for view in block.views]).T
    point, photo = (index.astype(np.int32) for index in np.nonzero(seen))
    rays = Rays(point, photo, np.zeros((len(point), 2)), np.full(len(point), block.sigma_px))
    camera_of = np.zeros(len(block.views), np.int64)
    rays = replace(rays, xy=-residuals(truth, rays, camera_of) + generator.normal(0.0, block.sigma_px, (len(rays), 2)))
    weight = np.zeros_like(block.points)
    weight[: block.control] = block.sigma_m**-2
    network = Network(
        camera_of,
        _self_calibration(truth.interior),
        truth.centre,
        np.zeros_like(truth.centre),
        block.points + generator.normal(0.0, block.sigma_m, block.points.shape),
        weight,
        np.zeros(len(block.views)),
    )
    return adjust(network, _nearby(truth, generator), rays), truth


def _self_calibration(interior: np.ndarray) -> Interior:
    size = interior.shape[1]
    free = np.isin(np.arange(size), FREE)[None]
    return Interior(interior, np.zeros((1, size, size)), free, np.zeros_like(free))


def _nearby(truth: State, generator: np.random.Generator) -> State:
    """Starting values: a few centimetres and milliradians, and a camera constant that is 1 % off."""
    turned = np.array([rotation_of_vector(generator.normal(0, 3e-3, 3)) @ R for R in truth.rotation])
    interior = truth.interior.copy()
    interior[0, :5] *= (1.01, 0.0, 0.0, 0.8, 0.8)
    centre = truth.centre + generator.normal(0, 0.03, truth.centre.shape)
    return replace(
        truth, rotation=turned, centre=centre, point=truth.point + generator.normal(0, 0.02, truth.point.shape), interior=interior
    )


def interior_sigmas(result: Adjustment) -> np.ndarray:
    """(5,) formal standard errors of FREE."""
    columns = result.network.interior_columns[0, list(FREE)]
    return np.sqrt(np.diag(result.cofactor.joint(columns)))


def texture_shift(result: Adjustment, truth: State, block: PublishedBlock) -> float:
    """Root mean square distance, px, between where photographs find the same place of the surface: what blurs a blend.

    The surface comes from the control's source and not from the bundle: true points are projected with the adjusted orientations,
    and what all photographs of a point have in common is a shift of the whole picture, not blur.
    """
    rays = result.rays
    away = residuals(replace(result.state, point=truth.point), rays, result.network.camera_of) - residuals(
        truth, rays, result.network.camera_of
    )
    # On the object: shifts of photographs from other distances and sides are comparable along the plane of the wall only.
    depth = np.linalg.norm(truth.point[rays.point] - truth.centre[rays.photo], axis=1)
    right = np.einsum("mij,mi->mj", truth.rotation[rays.photo][:, :2], away) * (depth / truth.interior[0, 0])[:, None]
    count = np.bincount(rays.point, minlength=len(truth.point))
    mean = (
        np.stack([np.bincount(rays.point, right[:, k], len(truth.point)) for k in range(3)], axis=1) / np.maximum(count, 1)[:, None]
    )
    apart = (right - mean[rays.point])[count[rays.point] > 1]
    pixel = float(np.median(depth)) / truth.interior[0, 0]
    return float(np.sqrt((apart**2).sum(axis=1).mean()) / pixel)
