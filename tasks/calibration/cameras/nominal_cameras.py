"""Cameras that are not calibrated here: nominal ones from EXIF, typed ones, and ones from a file.

A nominal camera is an initial value with wide standard errors; the block adjustment refines it.
"""

import json

import numpy as np
from pydantic import ValidationError

from orthomill.schemas.camera import INTERIOR, LENSES, Camera, Cameras, lens_parameters
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.project import CameraGiven
from orthomill.tasks.calibration.cameras.possible_cameras import camera_mistake
from orthomill.tasks.geometry.camera_change import QUARTER_TURNS, sensor_name, sensor_size, turned

# EXIF holds the marked focal length, not the one at the focused distance; a 35 mm equivalent is rounded to whole millimetres, and
# makers disagree whether it refers to the width or to the diagonal of the frame.
_SHARE_FROM_PIXEL, _SHARE_FROM_35MM = 0.02, 0.05
"""Relative standard error of a camera constant from a focal length and a pixel size, and from a 35 mm equivalent."""
# As large as the distortion of consumer lenses: a block must be able to move the coefficients from zero to there.
_LENS_SIGMA = {"k1": 0.1, "k2": 0.1, "p1": 0.002, "p2": 0.002}
_PRINCIPAL_POINT_SHARE = 0.01
"""Standard error of the principal point as a share of the width."""
_WIDTH_35MM = 36.0
"""mm: width of a 35 mm film frame"""


def nominal_constant(photo: Photo) -> tuple[float, float] | None:
    """Camera constant and its standard error, px; None when the EXIF tags do not suffice."""
    if photo.focal_mm and photo.pixel_um:
        c = 1000.0 * photo.focal_mm / photo.pixel_um
        return c, _SHARE_FROM_PIXEL * c
    if photo.focal_35mm:
        c = photo.focal_35mm / _WIDTH_35MM * max(photo.width, photo.height)
        return c, _SHARE_FROM_35MM * c
    return None


def nominal_camera(photo: Photo) -> Camera:
    """The camera according to the EXIF tags of a photograph."""
    width, height = sensor_size(photo)
    c, sigma_c = nominal_constant(photo) or (0.0, 0.0)
    sigma = {"c": sigma_c, "x0": _PRINCIPAL_POINT_SHARE * width, "y0": _PRINCIPAL_POINT_SHARE * width, **_LENS_SIGMA}
    pixel_um = photo.pixel_um or (1000.0 * photo.focal_mm / c if photo.focal_mm else None)
    return Camera(name=photo.camera, width=width, height=height, c=c, source="exif", pixel_um=pixel_um, covariance=_diagonal(sigma))


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
