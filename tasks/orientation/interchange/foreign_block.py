"""A block of another program in the conventions of this project: the value that all readers return and all writers take.

Other programs open image files as stored and ignore the EXIF orientation; photographs here are upright. Imported poses and cameras
are rotated upright, exported ones are rotated back. A camera of another size than the photographs (resized since) is scaled.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.findings.block_findings import BlockFinding
from orthomill.schemas.findings.foreign_findings import PhotosUnknown
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.survey_files.photograph_names import PhotographNames
from orthomill.tasks.geometry.camera_change import TURN, file_size, scaled, turned

Y_DOWN = np.diag([1.0, -1.0, -1.0])
"""From a camera that looks along +z with y down to one that looks along -z with y up, and back."""
MIRRORED = (2, 4, 5, 7)
"""EXIF orientations that mirror a photograph"""
_SAME_SHAPE = 0.01
"""Relative difference of the aspect ratios that rounding to whole pixels explains, even in small previews."""


@dataclass(frozen=True, eq=False)
class ForeignPose:
    """`rotation` (3, 3) world to image, `centre` (3,) of a photograph; `sigma` (6,) standard errors of X, Y, Z (m) and omega, phi,
    kappa (rad) where the file states them."""

    rotation: np.ndarray
    centre: np.ndarray
    sigma: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class ForeignBlock:
    """Poses by the name of the photograph, its camera by the same name (none: the project's own), points (N, 3) that the program
    found, the mean reprojection error that it states (px), and findings on what could not be taken over."""

    poses: dict[str, ForeignPose]
    cameras: dict[str, Camera]
    points: np.ndarray
    error_px: float | None = None
    findings: tuple[BlockFinding, ...] = ()
    upright: bool = False
    """whether poses and cameras are those of the upright photographs already"""


def upright_block(block: ForeignBlock, photos: Photos) -> ForeignBlock:
    """The block reduced to the project's photographs, upright and in their size. Raises WorkflowError when it has none of them, or
    when a camera has another aspect ratio than its photograph."""
    block = _in_own_words(block, photos)
    known = {photo.name: photo for photo in photos.photos if photo.name in block.poses}
    if not known:
        raise WorkflowError(
            f"None of the {len(photos.photos)} photographs of the project ({', '.join(photos.names[:3])}, ...) is in the block to "
            f"be read, which has {', '.join(list(block.poses)[:3])}, ...; photographs are joined by their file names."
        )
    stored = {n: photo.model_copy(update={"exif_orientation": 1}) if block.upright else photo for n, photo in known.items()}
    poses = {name: _turned_pose(block.poses[name], photo, "to upright") for name, photo in stored.items()}
    cameras = {name: _upright_camera(block.cameras[name], photo) for name, photo in stored.items() if name in block.cameras}
    return ForeignBlock(poses, cameras, block.points, block.error_px, (*block.findings, *_left_out(block, known)))


def _in_own_words(block: ForeignBlock, photos: Photos) -> ForeignBlock:
    """The block with photographs named as in the project, where names differ in capitals only."""
    names = PhotographNames(photos.names)
    word = {name: names.find(name) or name for name in block.poses}
    # Where capitals distinguish two photographs of the file, names are left as they are.
    if len(set(word.values())) < len(word):
        return block
    cameras = {word.get(name, name): camera for name, camera in block.cameras.items()}
    return replace(block, poses={word[name]: pose for name, pose in block.poses.items()}, cameras=cameras)


def _left_out(block: ForeignBlock, known: dict[str, Photo]) -> tuple[PhotosUnknown, ...]:
    """Photographs of the block that the project does not have."""
    others = tuple(name for name in block.poses if name not in known)
    return (PhotosUnknown(photos=others),) if others else ()


def file_view(photo: Photo, camera: Camera, pose: ForeignPose) -> tuple[Camera, ForeignPose]:
    """Camera and pose of a photograph for a program that opens the file as stored."""
    turn = _inverse_flag(photo.exif_orientation)
    return turned(camera, turn), _turned_pose(pose, photo, "to file")


def _inverse_flag(orientation: int) -> int:
    """The EXIF orientation that undoes another one: quarter turns undo each other, all others themselves."""
    return {6: 8, 8: 6}.get(orientation, orientation)


def _turned_pose(pose: ForeignPose, photo: Photo, way: str) -> ForeignPose:
    flag = photo.exif_orientation if way == "to upright" else _inverse_flag(photo.exif_orientation)
    turn = np.eye(3)
    turn[:2, :2] = TURN[flag]
    if np.linalg.det(turn) < 0:
        raise WorkflowError(
            f"{photo.name} is mirrored by its EXIF orientation {flag}, which no orientation in space can express for another "
            "program; save the photograph upright first."
        )
    return ForeignPose(turn @ pose.rotation, pose.centre, pose.sigma)


def _upright_camera(camera: Camera, photo: Photo) -> Camera:
    width, height = file_size(photo)
    if photo.scan is not None and (camera.width, camera.height) != (width, height):
        raise WorkflowError(
            f"{photo.name} is a scan that was put into a frame of {width} x {height} pixels, but the camera {camera.name} of the "
            f"block to be read has {camera.width} x {camera.height}: a camera of the scan itself does not fit. Read its exterior "
            "orientation as CSV, with the camera of the frame."
        )
    if abs(width / camera.width * camera.height / height - 1.0) > _SAME_SHAPE:
        raise WorkflowError(
            f"The camera {camera.name} of the block to be read has {camera.width} x {camera.height} pixels, but {photo.name} has "
            f"{width} x {height}: another shape; read the block of these photographs."
        )
    return turned(scaled(camera, (width, height)), photo.exif_orientation)
