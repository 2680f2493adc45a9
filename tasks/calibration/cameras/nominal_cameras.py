"""Cameras that are not calibrated here: nominal ones from the tags, typed ones, and ones from a file.

A nominal camera is an initial value with wide standard errors; the block adjustment refines it. Where the tags hold a calibration,
it is one with lens distortion and narrower standard errors.
"""

import json
from typing import Literal

import numpy as np
from pydantic import ValidationError

from orthomill.schemas.camera import INTERIOR, LENSES, Camera, Cameras, lens_parameters
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.photo import FactoryCamera, Photo, Photos
from orthomill.schemas.project import CameraGiven
from orthomill.tasks.calibration.cameras.possible_cameras import camera_mistake
from orthomill.tasks.geometry.camera_change import QUARTER_TURNS, sensor_name, sensor_size, turned
from orthomill.tasks.imagery.focal_length_constants import agrees_with_focal_length, constant_by_focal_length

_SHARE_CALIBRATED, _SHARE_DESIGN = 0.015, 0.03
"""Relative standard error of a camera constant from a calibration in the tags, and from the drawings of the lens"""
# As large as the distortion of consumer lenses: a block must be able to move the coefficients from zero to there.
_LENS_SIGMA = {"k1": 0.1, "k2": 0.1, "p1": 0.002, "p2": 0.002}
# A factory measures one lens on one day, at one temperature and often without the frame's own focus: held, such a camera leaves
# residuals of several times the noise, so that everything may move by what separates lenses of one kind.
_CALIBRATED_SIGMA = {"k1": 0.05, "k2": 0.1, "k3": 0.1, "p1": 0.003, "p2": 0.003, "affinity": 0.005}
_DEWARPED_SIGMA = {"k1": 0.01, "k2": 0.01, "p1": 0.001, "p2": 0.001}
_PRINCIPAL_POINT_SHARE = 0.01
"""Standard error of the principal point as a share of the width."""


def nominal_constant(photo: Photo) -> tuple[float, float] | None:
    """Camera constant and its standard error, px; None when the tags do not suffice.

    A calibration in the tags is best, then focal length and pixel size, the lens's drawings, and the 35 mm equivalent.
    """
    kind = constant_of_maker(photo)
    if photo.factory is None or kind is None:
        return constant_by_focal_length(photo)
    c = photo.factory.c * photo.zoom
    return c, (_SHARE_CALIBRATED if kind == "calibrated" else _SHARE_DESIGN) * c


def constant_of_maker(photo: Photo) -> Literal["calibrated", "design"] | None:
    """Whether the camera constant is that of a calibration in the tags or of the lens's drawings; None: of neither."""
    if _calibration(photo) is not None:
        return "calibrated"
    measured = photo.focal_mm and photo.pixel_um
    by_design = photo.factory and not measured and agrees_with_focal_length(photo.factory.c * photo.zoom, photo)
    return "design" if by_design else None


def _calibration(photo: Photo) -> FactoryCamera | None:
    """The calibration in the tags, unless its constant contradicts the focal length."""
    factory = photo.factory
    if factory is None or factory.kind != "calibrated":
        return None
    return factory if agrees_with_focal_length(factory.c * photo.zoom, photo) else None


def nominal_camera(photo: Photo) -> Camera:
    """The camera according to the tags of a photograph: a start with standard errors that let the block move it."""
    width, height = sensor_size(photo)
    c, sigma_c = nominal_constant(photo) or (0.0, 0.0)
    lens = _LENS_SIGMA
    values: dict[str, float] = {}
    if photo.dewarped:
        lens = _DEWARPED_SIGMA
    elif (calibration := _calibration(photo)) is not None:
        lens = _CALIBRATED_SIGMA
        values = {name: getattr(calibration, name) for name in ("k1", "k2", "k3", "p1", "p2", "affinity")}
        values |= {"x0": calibration.x0 * photo.zoom, "y0": calibration.y0 * photo.zoom}
    sigma = {"c": sigma_c, "x0": _PRINCIPAL_POINT_SHARE * width, "y0": _PRINCIPAL_POINT_SHARE * width, **lens}
    pixel_um = photo.pixel_um or (1000.0 * photo.focal_mm / c if photo.focal_mm and c else None)
    camera = Camera(
        name=photo.camera, width=width, height=height, c=c, source="exif", pixel_um=pixel_um, covariance=_diagonal(sigma)
    )
    return camera.changed(**values)


def camera_given(given: CameraGiven, photos: Photos) -> dict[str, Camera]:
    """The camera typed into the workflow, by name of `Photo.camera`: its pixels are those of the first photograph, and it serves
    all."""
    width, height = sensor_size(photos.photos[0])
    covariance = _diagonal({"c": given.sigma_c}) if given.sigma_c else None
    camera = Camera(
        name="given",
        width=width,
        height=height,
        c=given.c,
        lens=LENSES[given.lens](),
        pixel_um=given.pixel_um,
        covariance=covariance,
        source="given",
    )
    camera = camera.changed(**{name: getattr(given, name) for name in lens_parameters(given.lens)})
    if mistake := camera_mistake(camera):
        raise WorkflowError(f"The camera given in the workflow {mistake}.")
    return dict.fromkeys((photo.camera for photo in photos.photos), camera)


def cameras_from_file(text: str, path: str, photos: Photos) -> dict[str, Camera]:
    """The camera or cameras of a file: one `Camera`, the `Cameras` of an earlier run, or those of its adjusted block
    (products/cameras.json).

    Of several cameras each photograph gets the one of its own name. Raises WorkflowError with what is wrong in the file.
    """
    found = _parsed(text, path)
    missing = sorted({photo.camera for photo in photos.photos} - found.keys())
    if len(found) == 1:
        only = next(iter(found.values()))
        return dict.fromkeys((photo.camera for photo in photos.photos), only)
    if missing:
        raise WorkflowError(
            f"{path} has the cameras {', '.join(sorted(found))}, but none called {', '.join(missing)}, which took "
            "photographs; add it."
        )
    return found


def _parsed(text: str, path: str) -> dict[str, Camera]:
    try:
        content = json.loads(text)
        if isinstance(content, dict) and "cameras" in content:
            known = {name: content[name] for name in ("cameras", "of_photo") if name in content}
            found = _file_cameras(Cameras.model_validate(known))
        else:
            camera = Camera.model_validate(content).model_copy(update={"source": "file"})
            found = {camera.name: camera}
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "the whole"
        raise WorkflowError(
            f"{path} is not a camera file: {place}: {first['msg']}; it must have at least name, width, height and c."
        ) from error
    except json.JSONDecodeError as error:
        raise WorkflowError(f"{path} is not a camera file: it is not JSON (line {error.lineno}: {error.msg}).") from error
    except (ValueError, RecursionError) as error:  # numbers of thousands of digits, brackets in brackets in brackets
        raise WorkflowError(f"{path} is not a camera file: it cannot be read as JSON ({error}).") from error
    for camera in found.values():
        if mistake := camera_mistake(camera):
            raise WorkflowError(f"The camera {camera.name} of {path} {mistake}; correct the file.")
    return found


def _file_cameras(cameras: Cameras) -> dict[str, Camera]:
    """By the names of their sensors: a block records the cameras of photographs that EXIF turned as these lie upright."""
    found: dict[str, Camera] = {}
    for name, camera in sorted(cameras.cameras.items()):
        sensor = sensor_name(name)
        if sensor != name:
            camera = turned(camera, QUARTER_TURNS[int(name.rpartition(" ")[2])])
        found.setdefault(sensor, camera.model_copy(update={"name": sensor, "source": "file"}))
    return found


def _diagonal(sigma: dict[str, float]) -> tuple[tuple[float, ...], ...]:
    variances = np.diag([sigma.get(name, 0.0) ** 2 for name in INTERIOR])
    return tuple(tuple(row) for row in variances.tolist())
