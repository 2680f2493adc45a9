"""COLMAP's text model: cameras.txt, images.txt, points3D.txt.

COLMAP's pixels have their origin at the upper left corner of the upper left pixel, so that its centre is (0.5, 0.5); the camera
looks along +z with y down; a quaternion (w, x, y, z) and a translation take world to camera. Distortion is OpenCV's.
Source: COLMAP's documentation, "Output format" and camera models.
"""

import numpy as np

from orthomill.schemas.camera import LENSES, Camera, lens_parameters
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.survey_files.noted_origin import NotedOrigin, noted_origin, origin_note
from orthomill.schemas.survey_files.photograph_names import photo_stem
from orthomill.tasks.geometry.rotation_quaternion import quaternion, rotation_of_quaternion
from orthomill.tasks.orientation.interchange.foreign_block import Y_DOWN, ForeignBlock, ForeignPose

_LENS = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "FULL_OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "OPENCV_FISHEYE": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
}
"""Camera models that can be read and written, and the order of their parameters."""


def read_colmap(cameras: str, images: str, points: str = "") -> ForeignBlock:
    """The texts of cameras.txt, images.txt and (where there is one) points3D.txt as a block. Raises WorkflowError."""
    known = dict(_camera(line) for line in _lines(cameras))
    noted = noted_origin(images)
    origin = np.array(noted.xyz) if noted else np.zeros(3)
    poses, of_photo = _poses(images, known, origin)
    rows = [line.split() for line in _lines(points)]
    # COLMAP writes an error of -1 for points without one.
    errors = [float(row[7]) for row in rows if float(row[7]) >= 0.0]
    xyz = np.array([row[1:4] for row in rows], float).reshape(-1, 3) + origin
    return ForeignBlock(poses, of_photo, xyz, float(np.mean(errors)) if errors else None)


def _poses(images: str, known: dict[str, Camera], origin: np.ndarray) -> tuple[dict[str, ForeignPose], dict[str, Camera]]:
    """Poses and cameras by photograph."""
    poses, of_photo = {}, {}
    for line in _pose_lines(images):
        # The name comes last and may hold blanks.
        words = line.split(maxsplit=9)
        if len(words) < 10 or words[8] not in known:
            raise WorkflowError(
                f"A line of images.txt is not an image of COLMAP's text model: '{line[:80]}'; it must hold IMAGE_ID, QW QX QY QZ, "
                "TX TY TZ, CAMERA_ID of cameras.txt, and NAME. Binary models become text with `colmap model_converter`."
            )
        # x_camera = R X + t, so that the projection centre is -R' t.
        rotation = rotation_of_quaternion(np.array(words[1:5], float))
        name = photo_stem(words[9])
        poses[name] = ForeignPose(Y_DOWN @ rotation, origin - rotation.T @ np.array(words[5:8], float))
        of_photo[name] = known[words[8]]
    return poses, of_photo


def _lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.strip() and not line.startswith("#")]


def _pose_lines(text: str) -> list[str]:
    """The lines of images.txt that hold poses: every second one. The others list points and may be empty, so that dropping empty
    lines first would shift the count."""
    return [line for line in [line for line in text.splitlines() if not line.startswith("#")][::2] if line.strip()]


def _camera(line: str) -> tuple[str, Camera]:
    """CAMERA_ID and camera of a line of cameras.txt."""
    number, model, width, height, *numbers = line.split()
    value = _parameters(number, model, numbers)
    fx, fy = value.get("f", value.get("fx", 0.0)), value.get("f", value.get("fy", 0.0))
    # The image centre is half the size there, because the centre of the upper left pixel is (0.5, 0.5).
    place = {"x0": value["cx"] - int(width) / 2, "y0": int(height) / 2 - value["cy"]}
    kind = "fisheye" if model == "OPENCV_FISHEYE" else "rational" if any(value.get(k) for k in ("k4", "k5", "k6")) else "brown"
    camera = Camera(
        name=f"camera {number}", width=int(width), height=int(height), c=fy, lens=LENSES[kind](), source="file", **place
    )
    lens = {name: value.get(name, 0.0) for name in lens_parameters(kind) if name[0] in "kp"}
    return number, camera.changed(affinity=fx / fy - 1.0, **lens)


def _parameters(number: str, model: str, numbers: list[str]) -> dict[str, float]:
    """The parameters of a camera by name. Raises WorkflowError for a model that is not known here."""
    if model not in _LENS or len(numbers) != len(_LENS[model]):
        raise WorkflowError(
            f"Camera {number} of cameras.txt is of the model {model}; models that can be read are {', '.join(_LENS)}."
        )
    value = dict(zip(_LENS[model], map(float, numbers), strict=True))
    return value


def write_colmap(block: ForeignBlock, files: dict[str, str], origin: np.ndarray, crs: str) -> dict[str, str]:
    """The three texts by their file names; `files`: photograph -> file name; `origin` (3,) is subtracted from all
    coordinates, which would lose digits in the single precision of viewers."""
    number = {camera.name: i + 1 for i, camera in enumerate({c.name: c for c in block.cameras.values()}.values())}
    note = origin_note(NotedOrigin(tuple(origin.tolist()), crs))
    images = [note]
    for i, (name, pose) in enumerate(block.poses.items(), 1):
        rotation = Y_DOWN @ pose.rotation
        numbers = [*quaternion(rotation), *(-rotation @ (pose.centre - origin))]
        images.append(f"{i} {' '.join(repr(float(v)) for v in numbers)} {number[block.cameras[name].name]} {files[name]}\n\n")
    points = [f"{i} {x:.4f} {y:.4f} {z:.4f} 128 128 128 -1\n" for i, (x, y, z) in enumerate((block.points - origin).tolist(), 1)]
    cameras = {c.name: c for c in block.cameras.values()}
    return {
        "cameras.txt": "".join(_camera_line(number[name], camera) for name, camera in cameras.items()),
        "images.txt": "".join(images),
        "points3D.txt": note + "".join(points),
    }


def _camera_line(number: int, camera: Camera) -> str:
    # The centre of the upper left pixel is (0.5, 0.5) there: the image centre is half the size.
    cx, cy = camera.x0 + camera.width / 2, camera.height / 2 - camera.y0
    model, kinds = ("OPENCV_FISHEYE", ("fisheye",)) if camera.lens.kind == "fisheye" else ("FULL_OPENCV", ("brown", "rational"))
    if camera.lens.kind not in kinds:
        return f"# {number}: COLMAP has no lens of the kind {camera.lens.kind} of the camera {camera.name}\n"
    values = (camera.c * (1.0 + camera.affinity), camera.c, cx, cy, *map(camera.value, _LENS[model][4:]))
    return f"{number} {model} {camera.width} {camera.height} {' '.join(repr(float(v)) for v in values)}\n"
