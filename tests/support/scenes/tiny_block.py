"""A tiny block with known truth: six views of a smooth textured surface, rendered by intersecting every ray with it."""

from functools import lru_cache

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from orthomill.schemas.camera import Camera
from orthomill.schemas.observations import ImageResiduals
from orthomill.schemas.orientation import Block, ExteriorOrientation
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.geometry.view import View, block_view

EAST, NORTH, HEIGHT, FLYING = 400_000.0, 4_300_000.0, 50.0, 400.0
BASE = 110.0


def surface(x, y):
    """True height (m) at ground points."""
    u, v = x - EAST, y - NORTH
    return HEIGHT + 0.02 * u - 0.015 * v + 4.0 * np.sin(u / 45.0) * np.cos(v / 60.0) + 1.5 * np.sin((u + v) / 23.0)


@lru_cache
def _texture() -> np.ndarray:
    random = np.random.default_rng(7)
    layers = [w * gaussian_filter(random.standard_normal((2000, 2000)), s) * s for s, w in ((1.2, 1.0), (3.0, 1.0), (8.0, 1.0))]
    total = sum(layers)
    return 120 + 38 * total / total.std()


def texture(x, y):
    """Grey value at ground points (texels of 0.4 m)."""
    return map_coordinates(_texture(), [1000 - (y - NORTH) / 0.4, 1000 + (x - EAST) / 0.4], order=3, mode="mirror")


def camera() -> Camera:
    return Camera(name="tiny", width=480, height=460, c=700.0, x0=3.0, y0=-2.0, k1=-0.04, k2=0.02, p1=4e-4, p2=-3e-4)


@lru_cache
def block() -> Block:
    """Two strips of three photographs, 60 % overlap both ways; the second strip is flown back."""
    random = np.random.default_rng(11)
    photos = []
    for strip in range(2):
        for number in range(3):
            centre = np.array([EAST + (number - 1) * BASE, NORTH + (strip - 0.5) * 105.0, HEIGHT + FLYING]) + random.normal(0, 2, 3)
            angles = random.normal(0, 1.5, 3) + np.array([0, 0, 180.0 * strip])
            photos.append(
                ExteriorOrientation(
                    photo=f"{'ab'[strip]}{number + 1}",
                    centre=tuple(centre),
                    omega_phi_kappa=tuple(angles),
                    covariance=tuple(map(tuple, np.diag([0.02**2] * 3 + [5e-5**2] * 3))),
                    observations=100,
                    residual_px=0.2,
                )
            )
    return Block(
        crs="EPSG:2100",
        cameras={"tiny": camera()},
        of_photo={p.photo: "tiny" for p in photos},
        photos=tuple(photos),
        datum="truth",
        sigma0_px=0.3,
        redundancy=100,
        iterations=3,
        ground_low=HEIGHT - 8,
        ground_high=HEIGHT + 8,
    )


def views() -> dict[str, View]:
    return {name: block_view(block(), name) for name in block().names}


def photos() -> Photos:
    return Photos(
        photos=tuple(
            Photo(name=n, path=f"{n}.png", width=480, height=460, bands=1, dtype="uint8", camera="tiny") for n in block().names
        )
    )


def see(view: View, pixels: np.ndarray) -> np.ndarray:
    """True ground points (N, 3) that the pixels (N, 2) show."""
    z = np.full(len(pixels), HEIGHT)
    for _ in range(12):
        ground = view.at_height(pixels, z)
        z = surface(ground[:, 0], ground[:, 1])
    return view.at_height(pixels, z)


@lru_cache
def photograph(name: str) -> np.ndarray:
    """(460, 480, 1) uint8"""
    view = views()[name]
    col, row = np.meshgrid(np.arange(480.0), np.arange(460.0))
    ground = see(view, np.column_stack([col.ravel(), row.ravel()]))
    noise = np.random.default_rng(sum(map(ord, name))).normal(0, 1.5, col.size)
    grey = texture(ground[:, 0], ground[:, 1]) + noise
    return np.clip(np.rint(grey), 1, 255).astype(np.uint8).reshape(460, 480, 1)


def tie_points(sigma: float = 0.0, count: int = 400) -> ImageResiduals:
    """Measurements of random ground points in every photograph that sees them, sorted by track and photo."""
    random = np.random.default_rng(3)
    x, y = EAST + random.uniform(-250, 250, count), NORTH + random.uniform(-200, 200, count)
    ground = np.column_stack([x, y, surface(x, y)])
    rows = []
    for number, view in enumerate(views().values()):
        pixels = view.project(ground)
        inside = np.flatnonzero(view.contains(pixels))
        measured = pixels[inside] + random.normal(0, sigma, (len(inside), 2))
        rows.append(np.column_stack([inside, np.full(len(inside), number), measured]))
    table = np.concatenate(rows)
    table = table[np.lexsort((table[:, 1], table[:, 0]))]
    nothing = np.zeros(len(table), np.float32)
    return ImageResiduals(
        track=table[:, 0].astype(np.int32),
        photo=table[:, 1].astype(np.int32),
        col=table[:, 2],
        row=table[:, 3],
        v_col=nothing,
        v_row=nothing,
        standardised=nothing,
        used=np.ones(len(table), bool),
    )
