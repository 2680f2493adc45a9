"""A flight through the product, and what came out beside the truth: bend of ground and centres, what was said of it."""

from dataclasses import dataclass
from time import process_time

import numpy as np

from benchmarks.flights.measured_flight import Flight, Kind, flight
from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.observations import Control, GroundPoints
from orthomill.schemas.orientation import Block, RelativeOrientations
from orthomill.tasks.adjustment.model.interior_settings import InteriorChoice, WeightedInterior
from orthomill.tasks.adjustment.testing.position_trend import height_trend
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.exterior.adjusted_block import orient_block
from orthomill.tasks.orientation.exterior.block_choices import BlockChoices
from orthomill.tasks.orientation.interchange.foreign_block import ForeignPose
from orthomill.tasks.orientation.relative.pairs import relate_pairs
from orthomill.tasks.orientation.results.block_tables import BlockTables
from orthomill.tasks.orientation.shape.view_trend import view_trend
from orthomill.tasks.orientation.start.similarity import VerticalityConstraint, fit_similarity

LEAST_MATCHES, REJECTION, VERTICAL = 15, 4.0, 5.0
"""Defaults of the stage."""
NAMES_A_DOME = ("bent", "bend", "dome", "bowl")
"""Parts of the names of findings that say of a block that it bends."""


@dataclass(frozen=True)
class Judged:
    """A flight that was oriented; lengths in m. `bend`: the range of the quadratic part of the errors of ground heights, over the
    points, `bend_centres`: that of the projection centres; `worst`: its largest deviation from 0, `stated`: the standard error of
    the height there; `noise_bend`: the bend that the same measurements give with the true camera; `told`: the standard error of a
    bend by the scatter of positions or attitudes, whichever tell it better."""

    layout: str
    relief: str
    receiver: str
    gimbal: bool
    sound: bool
    seed: int
    photos: int
    lost: int
    ground_pixel: float
    bend: float
    bend_centres: float
    noise_bend: float
    worst: float
    stated: float
    shape: float
    sigma0: float
    c_error: float
    c_stated: float
    wrong_c: float
    k1: float
    k3: float
    x0: float
    y0: float
    iterations: int
    cpu: float
    told: float
    named: str
    said: str


def flown_and_judged(kind: Kind, seed: int) -> Judged:
    """The flight of a kind with the chances of a seed, judged."""
    return judged(flight(kind, seed))


def judged(flight: Flight) -> Judged:
    """The flight through the product's own functions, as the stage calls them, beside the truth."""
    started = process_time()
    try:
        relative = relate_pairs(flight.photos, flight.cameras, flight.tie_points, LEAST_MATCHES)
        tables = _oriented(flight, flight.cameras, relative)
    except GeometryError as error:
        return _row(flight, process_time() - started, lost=len(flight.views), said=str(error))
    cpu = process_time() - started
    bend, worst, stated = _ground_bend(flight, tables.points)
    camera = tables.block.cameras["cam"]
    findings = [type(one).__name__ for one in tables.precision.findings]
    return _row(
        flight,
        cpu,
        lost=len(flight.views) - len(tables.block.photos),
        bend=bend,
        bend_centres=_centre_bend(flight, tables.block),
        noise_bend=_noise_bend(flight, relative),
        worst=worst,
        stated=stated,
        shape=_stated_shape(tables),
        sigma0=tables.block.sigma0_px,
        told=_told(flight, tables.block),
        c_error=camera.c - flight.camera.c,
        c_stated=float(np.sqrt(camera.covariance[0][0])) if camera.covariance else 0.0,
        iterations=tables.block.iterations,
        named=" ".join(name for name in findings if any(part in name.lower() for part in NAMES_A_DOME)),
        said=" ".join(findings),
    )


def _row(flight: Flight, cpu: float, **found) -> Judged:
    camera, nominal = flight.camera, flight.cameras.cameras["cam"]
    nothing = dict.fromkeys(
        ("bend", "bend_centres", "noise_bend", "worst", "stated", "shape", "told", "sigma0", "c_error", "c_stated"), float("nan")
    )
    known = {
        "photos": len(flight.views),
        "ground_pixel": flight.ground_pixel,
        "wrong_c": nominal.c / camera.c - 1.0,
        "k1": camera.lens.k1,
        "k3": camera.lens.k3,
        "x0": camera.x0,
        "y0": camera.y0,
    }
    return Judged(
        **vars(flight.kind), seed=flight.seed, cpu=cpu, **{**known, **nothing, "iterations": 0, "named": "", "said": "", **found}
    )


def _oriented(flight: Flight, cameras: Cameras, relative: RelativeOrientations, given=None) -> BlockTables:
    interior: InteriorChoice = WeightedInterior(kind="weighted")
    choices = BlockChoices(interior=interior, gnss_shift="auto", vertical_sigma=VERTICAL, rejection=REJECTION)
    return orient_block(flight.photos, cameras, flight.tie_points, Control(), relative, "EPSG:2100", choices, given)


def _noise_bend(flight: Flight, relative: RelativeOrientations) -> float:
    """The bend that the same measurements give with the true camera: that of noise and shared errors alone."""
    known = Cameras(cameras={"cam": _certain(flight.camera)}, of_photo=flight.cameras.of_photo)
    poses = {view.name: ForeignPose(view.rotation, view.centre) for view in flight.views}
    right = relative.model_copy(update={"start_k1": {}})
    try:
        return _ground_bend(flight, _oriented(flight, known, right, poses).points)[0]
    except GeometryError:
        return float("nan")


def _certain(camera: Camera) -> Camera:
    return camera.model_copy(update={"source": "given"})


def _ground_bend(flight: Flight, points: GroundPoints) -> tuple[float, float, float]:
    """Bend of the ground, its largest deviation, and the stated standard error of the height there, m."""
    found, truth = np.column_stack([points.x, points.y, points.z]), flight.ground[points.track]
    well = (points.rays >= 3) & (points.sigma_z < 3 * np.median(points.sigma_z))
    found, truth = found[well], truth[well]
    middle = truth.mean(axis=0)
    error = _placed(found - found.mean(axis=0), truth - middle) - (truth - middle)
    form = quadratic_part(truth[:, :2], error[:, 2])
    low, high = np.percentile(form, [1, 99])
    place = int(np.abs(np.clip(form, low, high)).argmax())
    return float(high - low), float(max(-low, high)), float(points.sigma_z[well][place])


def _centre_bend(flight: Flight, block: Block) -> float:
    """Bend of the projection centres."""
    truth = {view.name: view.centre for view in flight.views}
    centres = np.array([truth[name] for name in block.names])
    if len(centres) < 7:
        return float("nan")
    found = np.array([photo.centre for photo in block.photos])
    middle = centres.mean(axis=0)
    error = _placed(found - found.mean(axis=0), centres - middle) - (centres - middle)
    return float(np.ptp(quadratic_part(centres[:, :2], error[:, 2])))


def _told(flight: Flight, block: Block) -> float:
    """m: the standard error of a bend of the centres by positions or attitudes, whichever tell it better; inf without either."""
    own = {photo.name: photo for photo in flight.photos.photos}
    photos = [own[name] for name in block.names]
    centres = np.array([photo.centre for photo in block.photos])
    sigmas = [np.inf]
    has = np.array([photo.position is not None for photo in photos])
    given = np.array([photo.position for photo in photos if photo.position is not None]).reshape(-1, 3)
    if heights := height_trend(centres[has, :2], centres[has, 2] - given[:, 2]):
        sigmas.append(float(heights.sigma[3]) * heights.radius**2)
    turned = np.array([rotation_matrix(*np.radians(photo.omega_phi_kappa)) for photo in block.photos])
    has = np.array([photo.attitude is not None for photo in photos])
    up = np.array([rotation_matrix(*np.radians(photo.attitude))[:, 2] for photo in photos if photo.attitude is not None])
    if views := view_trend(centres[has, :2], turned[has], up.reshape(-1, 3)):
        sigmas.append(views.sigma * views.extent**2 / 8.0)
    return min(sigmas)


def _placed(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """The points after the similarity that fits them best to the truth: place, tilt and scale are no bend."""
    free = VerticalityConstraint(np.array([0.0, 0.0, 1.0]), 0.0)
    return fit_similarity(found, truth, np.full(len(found), 1e6), free).apply(found)


def quadratic_part(xy: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """(N,) the quadratic surface that fits `heights` (N,) at `xy` (N, 2), less its own plane."""
    from_middle = xy - xy.mean(axis=0)
    axes = np.linalg.svd(from_middle, full_matrices=False)
    u, v = (from_middle @ axes[2].T / (axes[1] / np.sqrt(len(xy)))).T
    # Centres of a single strip lie on a line: across it nothing can be said.
    line = axes[1][1] < 0.05 * axes[1][0]
    plane = np.column_stack([np.ones_like(u), u] if line else [np.ones_like(u), u, v])
    forms = np.column_stack([u * u] if line else [u * u, u * v, v * v])
    forms = forms - plane @ np.linalg.lstsq(plane, forms, rcond=None)[0]
    rest = heights - plane @ np.linalg.lstsq(plane, heights, rcond=None)[0]
    weight = np.ones(len(xy))
    for _ in range(10):
        root = np.sqrt(weight)[:, None]
        part = forms @ np.linalg.lstsq(forms * root, rest * root[:, 0], rcond=None)[0]
        size = np.abs(rest - part)
        weight = 1.0 / np.maximum(size / max(2.0 * float(np.median(size)), 1e-9), 1.0)
    return part


def _stated_shape(tables: BlockTables) -> float:
    """The stated standard error of the bend, NaN where the product states none."""
    return float(tables.precision.bend_sigma or np.nan)
