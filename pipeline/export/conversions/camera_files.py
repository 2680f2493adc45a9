"""Where the photographs were taken, what they show, and the surveyed points: GeoPackage."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orthomill.pipeline.export.vectors.geopackage import write_geopackage
from orthomill.pipeline.export.vectors.map_features import Feature, Layer
from orthomill.schemas.maps.map_page import MapCamera
from orthomill.schemas.observations import ControlPoint
from orthomill.schemas.orientation import Block, GroundResidual

LENGTHENED = 1000
"""times: residuals of millimetres as lines of metres"""


@dataclass(frozen=True)
class MappedBlock:
    """What is known of photographs and surveyed points on the map."""

    block: Block
    cameras: tuple[MapCamera, ...]
    control: tuple[ControlPoint, ...] = ()
    residuals: tuple[GroundResidual, ...] = ()


def write_camera_geopackage(path: Path, known: MappedBlock) -> None:
    """Projection centres with their standard errors and angles (degrees), footprints at the mean height of the ground, surveyed
    points with what the block differs from them, and these differences as lines a thousand times as long."""
    points = tuple(_surveyed(known))
    layers = [
        Layer("cameras", "point", tuple(_centres(known))),
        Layer("footprints", "area", tuple(_footprints(known))),
        *([Layer("surveyed_points", "point", points)] if points else ()),
        *([Layer("residuals", "line", lines)] if (lines := tuple(_residual_lines(known))) else ()),
    ]
    write_geopackage(path, layers, known.block.crs)


def _centres(known: MappedBlock) -> Iterator[Feature]:
    for camera in known.cameras:
        oriented = known.block.of(camera.name)
        sigma = np.sqrt(np.diag(oriented.covariance)[:3]) if oriented.covariance is not None else [None] * 3
        omega, phi, kappa = (round(angle, 6) for angle in oriented.omega_phi_kappa)
        yield Feature(
            np.array([camera.centre]),
            {
                "photograph": camera.name,
                "taken": camera.taken,
                **dict(zip(("sigma_x", "sigma_y", "sigma_z"), (_rounded(s) for s in sigma), strict=True)),
                "omega": omega,
                "phi": phi,
                "kappa": kappa,
                "residual_px": _rounded(oriented.residual_px),
            },
        )


def _footprints(known: MappedBlock) -> Iterator[Feature]:
    for camera in known.cameras:
        if camera.outline:
            ring = np.array([(*place, known.block.ground_mean) for place in (*camera.outline, camera.outline[0])])
            yield Feature(ring, {"photograph": camera.name, "taken": camera.taken})


def _surveyed(known: MappedBlock) -> Iterator[Feature]:
    by_name = {(one.role, one.name): one for one in known.residuals}
    for point in known.control:
        # A tie point has no coordinates of its own.
        if point.role == "tie":
            continue
        found = by_name.get((point.role, point.name))
        differences = found.difference if found else (None,) * 3
        promised = found.predicted if found else (None,) * 3
        yield Feature(
            np.array([point.xyz]),
            {
                "point": point.name,
                "role": point.role,
                **{f"d{axis}": _rounded(value) for axis, value in zip("xyz", differences, strict=True)},
                **{f"promised_{axis}": _rounded(value) for axis, value in zip("xyz", promised, strict=True)},
                "photographs": found.photos if found else len(point.measurements),
            },
        )


def _residual_lines(known: MappedBlock) -> Iterator[Feature]:
    place = {(point.role, point.name): np.array(point.xyz) for point in known.control}
    for one in known.residuals:
        if (start := place.get((one.role, one.name))) is not None:
            end = start + LENGTHENED * np.array([*one.difference[:2], 0.0])
            length = round(float(np.hypot(*one.difference[:2])), 4)
            yield Feature(np.array([start, end]), {"point": one.name, "role": one.role, "plan_m": length, "lengthened": LENGTHENED})


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(float(value), 4)
