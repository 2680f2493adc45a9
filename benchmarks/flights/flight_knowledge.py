"""What the camera of a flight is, and what is known of it and of where it was: the truth, and what the tags say."""

from dataclasses import dataclass

import numpy as np

from benchmarks.flights.flown_layouts import Scene
from orthomill.schemas.camera import BrownLens, Camera
from orthomill.schemas.photo import Fix, Photo
from orthomill.tasks.calibration.cameras.nominal_cameras import nominal_camera, nominal_constant
from orthomill.tasks.geometry.rotation import angles, rotation_matrix

WIDTH, HEIGHT, CONSTANT = 1600, 1300, 1955.0
"""px: a frame of a drone for surveying"""
GIMBAL = 0.3
"""degrees: noise of the attitudes of a gimbal"""


@dataclass(frozen=True)
class Receiver:
    """Standard errors (3,) m of positions as stated; `common`: the share of them, as a standard error, that a whole flight has in
    common; `single`: that of each position by itself."""

    fix: Fix
    sigma: tuple[float, float, float]
    common: float
    single: float


RECEIVERS = {
    "RTK fixed": Receiver("fixed", (0.01, 0.015, 0.02), 0.3, 0.95),
    "RTK float": Receiver("float", (0.3, 0.3, 0.3), 0.8, 0.3),
    "GPS": Receiver("single", (3.0, 3.0, 5.0), 0.9, 0.15),
    "none": Receiver("none", (np.nan, np.nan, np.nan), 0.0, 0.0),
}


def true_camera(rng: np.random.Generator, sound: bool) -> Camera:
    """The camera that flies; a `sound` one is nearly what nominal cameras assume."""
    k1, k3 = (rng.uniform(-0.02, 0.02), 0.0) if sound else (rng.uniform(-0.35, 0.1), rng.uniform(-0.3, 0.0))
    k2 = rng.normal(0, 0.005) if sound else -0.3 * k1 + rng.normal(0, 0.02)
    aside = 0.001 if sound else 0.01
    x0, y0 = rng.uniform(-aside, aside, 2) * WIDTH
    lens = BrownLens(k1=k1, k2=k2, k3=k3, p1=rng.normal(0, 5e-4), p2=rng.normal(0, 5e-4))
    return Camera(name="cam", width=WIDTH, height=HEIGHT, c=CONSTANT, x0=x0, y0=y0, lens=lens, source="truth")


def tagged_photos(scene: Scene, receiver: Receiver, gimbal: bool, wrong: float, rng: np.random.Generator) -> tuple[Photo, ...]:
    """The photographs with what their tags say; `wrong`: the error of the tagged camera constant in units of it."""
    common, sigma = receiver.common * rng.standard_normal(3), np.array(receiver.sigma)
    # Errors of satellites and troposphere drift during a flight; a tenth of the common ones does.
    drift = np.linspace(-0.1, 0.1, len(scene.views))[:, None] * receiver.common * rng.standard_normal(3)
    error = sigma * (common + drift + receiver.single * rng.standard_normal((len(scene.views), 3)))
    return tuple(
        _photo(view.name, error_of + view.centre, receiver, _attitude(view.rotation, rng) if gimbal else None, wrong)
        for view, error_of in zip(scene.views, error, strict=True)
    )


def _attitude(rotation: np.ndarray, rng: np.random.Generator) -> tuple[float, float, float]:
    found = rotation_matrix(*np.radians(rng.normal(0, GIMBAL, 3))) @ rotation
    omega, phi, kappa = map(float, np.degrees(angles(found)))
    return omega, phi, kappa


def _photo(name: str, position: np.ndarray, receiver: Receiver, attitude: tuple[float, float, float] | None, wrong: float) -> Photo:
    known = {} if receiver.fix == "none" else {"position": tuple(position), "position_sigma": receiver.sigma, "fix": receiver.fix}
    turned = {} if attitude is None else {"attitude": attitude, "attitude_of": "gimbal"}
    size = {"width": WIDTH, "height": HEIGHT, "bands": 3, "dtype": "uint8"}
    photo = Photo(name=name, path=f"{name}.jpg", camera="cam", focal_35mm=1.0, **size, **known, **turned)
    # The length that the product turns into the wanted constant, whatever its rule for that.
    per_mm = (nominal_constant(photo) or (1.0, 0.0))[0]
    return photo.model_copy(update={"focal_35mm": CONSTANT * (1.0 + wrong) / per_mm})


def camera_by_tags(photos: tuple[Photo, ...]) -> Camera:
    """The camera as the product takes it from the tags."""
    return nominal_camera(photos[0])
