"""A small block with all its tables, made by hand: two vertical photographs 20 m apart, 100 m above level ground."""

from dataclasses import replace

import numpy as np
import pytest

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.observations import Control, ControlPoint, GroundPoints, ImageResiduals
from orthomill.schemas.orientation import (
    Block,
    BlockPrecision,
    ExteriorOrientation,
    GroundResidual,
    GroundResiduals,
    RelativeOrientations,
)
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.orientation.examined.block_facts import Facts

CAMERA = Camera(name="cam", width=1000, height=1000, c=1000.0, pixel_um=5.0, source="given")
SIGMA = (0.3, 0.4, 0.2, 1e-4, 1e-4, 1e-4)


def exterior(name, x, residual_px=0.5):
    covariance = tuple(map(tuple, np.diag(np.square(SIGMA))))
    return ExteriorOrientation(
        photo=name, centre=(x, 0.0, 100.0), omega_phi_kappa=(0.0, 0.0, 0.0), covariance=covariance, residual_px=residual_px
    )


def measurements(per_photo=36):
    """Tie points on a regular grid of the frame, the same tracks in both photographs, residuals of 0.3 and 0.4 px."""
    side = int(np.sqrt(per_photo))
    place = (np.arange(side) + 0.5) / side * CAMERA.width
    col, row = (np.tile(v.ravel(), 2) for v in np.meshgrid(place, place))
    count = len(col)
    return ImageResiduals(
        track=np.tile(np.arange(count // 2, dtype=np.int32), 2),
        photo=np.repeat(np.arange(2, dtype=np.int32), count // 2),
        col=col,
        row=row,
        v_col=np.full(count, 0.3, np.float32),
        v_row=np.full(count, -0.4, np.float32),
        standardised=np.ones(count, np.float32),
        used=np.ones(count, bool),
    )


def tie_points(count=40):
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-40, 60, count), rng.uniform(-50, 50, count)
    sigma = np.full(count, 0.03, np.float32)
    rays, residual = np.full(count, 2, np.int16), np.full(count, 0.5, np.float32)
    return GroundPoints(np.arange(count, dtype=np.int32), x, y, np.zeros(count), sigma, 4 / 3 * sigma, 2 * sigma, rays, residual)


def surveyed(name, role, xyz):
    return ControlPoint(name=name, role=role, xyz=xyz, sigma=(0.02,) * 3, measurements={"a": (1.0, 2.0, 0.5), "b": (3.0, 2.0, 0.5)})


def compared(name, role, difference, predicted=(0.1, 0.1, 0.1), photos=2):
    return GroundResidual(name=name, role=role, difference=difference, predicted=predicted, photos=photos, residual_px=0.4)


@pytest.fixture
def facts():
    photo = {"width": 1000, "height": 1000, "bands": 3, "dtype": "uint8", "camera": "cam"}
    photos = Photos(photos=tuple(Photo(name=n, path=f"{n}.jpg", **photo) for n in "ab"))
    block = Block(
        crs="EPSG:2100",
        cameras={"cam": CAMERA},
        of_photo={"a": "cam", "b": "cam"},
        photos=(exterior("a", 0.0), exterior("b", 20.0)),
        datum="Control: the block is held by 4 ground control points.",
        sigma0_px=0.5,
        redundancy=100,
        iterations=7,
        ground_low=-1.0,
        ground_high=1.0,
    )
    corners = [(-35.0, -45.0), (55.0, -45.0), (55.0, 45.0), (-35.0, 45.0)]
    control = tuple(surveyed(f"C{i}", "control", (x, y, 0.0)) for i, (x, y) in enumerate(corners))
    points = (*control, surveyed("K1", "check", (10.0, 0.0, 0.0)))
    rows = tuple(compared(p.name, p.role, (0.03, -0.04, 0.1)) for p in points)
    precision = BlockPrecision(image_factor=1.1, position_factor=1.0, control_factor=1.0, rays=72, rejected=3)
    return Facts(
        photos=photos,
        before=Cameras(cameras={"cam": CAMERA}, of_photo=block.of_photo),
        control=Control(points=points),
        relative=RelativeOrientations(),
        block=block,
        points=tie_points(),
        image=measurements(),
        ground=GroundResiduals(points=rows),
        precision=precision,
    )


@pytest.fixture
def with_block(facts):
    """The facts with fields of the block changed."""
    return lambda **changes: replace(facts, block=facts.block.model_copy(update=changes))


@pytest.fixture
def with_precision(facts):
    """The facts with fields of the precision changed."""
    return lambda **changes: replace(facts, precision=facts.precision.model_copy(update=changes))
