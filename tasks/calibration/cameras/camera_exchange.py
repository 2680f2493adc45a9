"""The calibrated camera in the formats of other programs.

OpenCV, COLMAP and OpenSfM have y downwards; their principal point is in pixels of the file (COLMAP: from the corner of the
upper-left pixel, not from its centre). Distortion coefficients are OpenCV's in all of them; Agisoft's p1 and p2 are exchanged, and
its b1, b2 are affinity and skew in px.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.camera import INTERIOR, Camera


def _centre(camera: Camera) -> tuple[float, float]:
    """Principal point (col, row), the centre of the upper-left pixel being (0, 0)."""
    return (camera.width - 1) / 2 + camera.x0, (camera.height - 1) / 2 - camera.y0


def _skew_px(camera: Camera) -> float:
    """Skew in px for y downwards: an x that grows with y upwards shrinks with y downwards."""
    # 0.0 - value instead of -value: the file of a camera without skew shows 0.0, not -0.0.
    return 0.0 - camera.c * camera.skew


def opencv_yaml(camera: Camera) -> str:
    """For cv2.FileStorage: camera_matrix and distortion_coefficients (k1 k2 p1 p2 k3), with standard errors where known."""
    col, row = _centre(camera)
    matrix = [camera.c * (1 + camera.affinity), _skew_px(camera), col, 0.0, camera.c, row, 0.0, 0.0, 1.0]
    lens = [camera.k1, camera.k2, camera.p1, camera.p2, camera.k3]
    lines = [
        "%YAML:1.0",
        "---",
        f"image_width: {camera.width}",
        f"image_height: {camera.height}",
        *_matrix("camera_matrix", matrix, 3),
        *_matrix("distortion_coefficients", lens, 5),
    ]
    if camera.covariance is not None:
        sigma = dict(zip(INTERIOR, np.sqrt(np.diag(np.array(camera.covariance))).tolist(), strict=True))
        order = ("c", "x0", "y0", "k1", "k2", "p1", "p2", "k3")
        lines += ["# standard errors of c, x0, y0, k1, k2, p1, p2, k3", *_matrix("standard_errors", [sigma[n] for n in order], 8)]
    return "\n".join(lines) + "\n"


def _matrix(name: str, values: list[float], columns: int) -> list[str]:
    data = ", ".join(repr(float(value)) for value in values)
    return [
        f"{name}: !!opencv-matrix",
        f"   rows: {len(values) // columns}",
        f"   cols: {columns}",
        "   dt: d",
        f"   data: [ {data} ]",
    ]


def colmap_cameras(camera: Camera) -> str:
    """cameras.txt: OPENCV (fx fy cx cy k1 k2 p1 p2), or FULL_OPENCV where k3 is not zero. COLMAP has no parameter for skew."""
    col, row = _centre(camera)
    # COLMAP's origin is the corner of the upper-left pixel, hence + 0.5.
    numbers = [camera.c * (1 + camera.affinity), camera.c, col + 0.5, row + 0.5, camera.k1, camera.k2, camera.p1, camera.p2]
    model = "OPENCV"
    if camera.k3:
        # k4, k5 and k6 of the rational model stay zero, which makes its denominator 1.
        model, numbers = "FULL_OPENCV", [*numbers, camera.k3, 0.0, 0.0, 0.0]
    values = " ".join(repr(float(number)) for number in numbers)
    return f"# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n1 {model} {camera.width} {camera.height} {values}\n"


def opensfm_camera(camera: Camera) -> str:
    """camera_models.json with the projection `brown`: lengths in units of the longer side."""
    longer = max(camera.width, camera.height)
    return (
        json.dumps(
            {
                camera.name: {
                    "projection_type": "brown",
                    "width": camera.width,
                    "height": camera.height,
                    "focal_x": camera.c * (1 + camera.affinity) / longer,
                    "focal_y": camera.c / longer,
                    "c_x": camera.x0 / longer,
                    "c_y": -camera.y0 / longer,
                    "k1": camera.k1,
                    "k2": camera.k2,
                    "k3": camera.k3,
                    "p1": camera.p1,
                    "p2": camera.p2,
                }
            },
            indent=2,
        )
        + "\n"
    )


def agisoft_xml(camera: Camera) -> str:
    """Agisoft Metashape's calibration XML: f, cx and cy from the image centre, b1 and b2 in px."""
    numbers = {
        "f": camera.c,
        "cx": camera.x0,
        "cy": -camera.y0,
        "b1": camera.c * camera.affinity,
        "b2": _skew_px(camera),
        "k1": camera.k1,
        "k2": camera.k2,
        "k3": camera.k3,
        "p1": camera.p2,
        "p2": camera.p1,
    }
    body = "\n".join(f"  <{name}>{value!r}</{name}>" for name, value in numbers.items())
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<calibration>\n  <projection>frame</projection>\n  <width>{camera.width}</width>'
        f"\n  <height>{camera.height}</height>\n{body}\n</calibration>\n"
    )


@dataclass(frozen=True)
class CameraFormat:
    """Name of the exported file, and the function that writes a camera as its text."""

    file: str
    text: Callable[[Camera], str]


FORMATS = {
    "opencv": CameraFormat("camera_opencv.yaml", opencv_yaml),
    "colmap": CameraFormat("camera_colmap.txt", colmap_cameras),
    "opensfm": CameraFormat("camera_opensfm.json", opensfm_camera),
    "agisoft": CameraFormat("camera_agisoft.xml", agisoft_xml),
}
"""The formats of other programs, by the name of the program."""
