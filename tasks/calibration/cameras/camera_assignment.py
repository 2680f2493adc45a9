"""Which photograph was taken with which camera, and whether the camera fits it."""

from collections.abc import Mapping

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.errors import PhotoError
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.geometry.camera_change import scaled, sensor_size, turned, upright_name

# Reduced copies are rounded to integer pixels: the aspect ratio of even a small one changes by less than half a percent, while the
# common formats (3:2, 4:3, 16:9) are 12 % and more apart.
_SAME_SHAPE = 0.005
"""Largest relative difference between the aspect ratios of a camera and its photographs."""


def cameras_for(photos: Photos, sources: Mapping[str, Camera]) -> Cameras:
    """Every photograph with its camera. sources: the camera of the sensor by the name of `Photo.camera`.

    Raises PhotoError naming the photographs whose shape does not fit.
    """
    misfits = [photo for photo in photos.photos if not fits(sources[photo.camera], photo)]
    if misfits:
        camera = sources[misfits[0].camera]
        names = ", ".join(f"{photo.name} ({photo.width} x {photo.height})" for photo in misfits[:8])
        raise PhotoError(
            f"The camera {camera.name} has {camera.width} x {camera.height} pixels, another aspect ratio than {len(misfits)} "
            f"photographs: {names}; take them out of the workflow, give the camera that took them, or say which photographs this "
            "one serves (serves)."
        )
    first = {upright_name(photo): photo for photo in reversed(photos.photos)}
    cameras = {name: fitted(sources[photo.camera], photo) for name, photo in sorted(first.items())}
    return Cameras(cameras=cameras, of_photo={photo.name: upright_name(photo) for photo in photos.photos})


def fits(camera: Camera, photo: Photo) -> bool:
    """Whether the photograph has the camera's aspect ratio, in any size."""
    width, height = sensor_size(photo)
    return abs(width / camera.width * camera.height / height - 1.0) < _SAME_SHAPE


def fitted(camera: Camera, photo: Photo) -> Camera:
    """The camera of the sensor scaled and turned to this photograph, under the name of the upright photograph's camera."""
    own = turned(scaled(camera, sensor_size(photo)), photo.sensor_orientation)
    return own.model_copy(update={"name": upright_name(photo), "pixel_um": own.pixel_um or photo.pixel_um})
