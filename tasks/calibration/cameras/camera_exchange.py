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
from orthomill.tasks.geometry.distortion import principal_place


def _skew_px(camera: Camera) -> float:
    """Skew in px for y downwards: an x that grows with y upwards shrinks with y downwards."""
    # 0.0 - value instead of -value: the file of a camera without skew shows 0.0, not -0.0.
    return 0.0 - camera.c * camera.skew


def _constants(camera: Camera) -> tuple[float, float]:
    """Camera constants along x and y, px."""
    return camera.c * (1 + camera.affinity), camera.c


def _values(camera: Camera, names: str) -> list[float]:
    """Interior parameters by their names, separated by spaces; 0 for what the lens lacks."""
    return [camera.value(name) for name in names.split()]


def _unknown_there(camera: Camera, program: str) -> str:
    return f"{program} has no model of the kind {camera.lens.kind}: calibrate with the model brown, rational or fisheye for it"


_OPENCV_ORDER = {
    "brown": "k1 k2 p1 p2 k3",
    "rational": "k1 k2 p1 p2 k3 k4 k5 k6",
    "thin_prism": "k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4",
    "fisheye": "k1 k2 k3 k4",
}


def opencv_yaml(camera: Camera) -> str:
    """For cv2.FileStorage: camera_matrix and distortion_coefficients in OpenCV's order (those of a fisheye are for cv2.fisheye),
    with standard errors where known."""
    if camera.lens.kind not in _OPENCV_ORDER:
        return f"%YAML:1.0\n---\n# {_unknown_there(camera, 'OpenCV')}\n"
    (fx, fy), (col, row), order = _constants(camera), principal_place(camera), _OPENCV_ORDER[camera.lens.kind]
    lens = _values(camera, order)
    lines = [
        "%YAML:1.0",
        "---",
        f"image_width: {camera.width}",
        f"image_height: {camera.height}",
        f"distortion_model: {camera.lens.kind}",
        *_matrix("camera_matrix", [fx, _skew_px(camera), col, 0.0, fy, row, 0.0, 0.0, 1.0], 3),
        *_matrix("distortion_coefficients", lens, len(lens)),
    ]
    if camera.covariance is not None:
        sigma = dict(zip(INTERIOR, np.sqrt(np.diag(np.array(camera.covariance))).tolist(), strict=True))
        names = ["c", "x0", "y0", *order.split()]
        lines.append(f"# standard errors of {', '.join(names)}")
        lines += _matrix("standard_errors", [sigma[name] for name in names], len(names))
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
    """cameras.txt: OPENCV (fx fy cx cy k1 k2 p1 p2), FULL_OPENCV for more coefficients, OPENCV_FISHEYE. COLMAP has no parameter for
    skew."""
    head = "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
    models = {"rational": ("FULL_OPENCV", "k1 k2 p1 p2 k3 k4 k5 k6"), "fisheye": ("OPENCV_FISHEYE", "k1 k2 k3 k4")}
    # k4, k5 and k6 of the rational model stay zero, which makes its denominator 1.
    models["brown"] = models["rational"] if camera.value("k3") else ("OPENCV", "k1 k2 p1 p2")
    if camera.lens.kind not in models:
        return f"{head}# {_unknown_there(camera, 'COLMAP')}\n"
    col, row = principal_place(camera)
    model, names = models[camera.lens.kind]
    # COLMAP's origin is the corner of the upper-left pixel, hence + 0.5.
    numbers = [*_constants(camera), col + 0.5, row + 0.5, *_values(camera, names)]
    values = " ".join(repr(float(number)) for number in numbers)
    return f"{head}1 {model} {camera.width} {camera.height} {values}\n"


def opensfm_camera(camera: Camera) -> str:
    """camera_models.json with the projection `brown` or `fisheye_opencv`: lengths in units of the longer side."""
    models = {"brown": ("brown", "k1 k2 k3 p1 p2"), "fisheye": ("fisheye_opencv", "k1 k2 k3 k4")}
    if camera.lens.kind not in models:
        return json.dumps({"note": _unknown_there(camera, "OpenSfM")}, indent=2) + "\n"
    longer = max(camera.width, camera.height)
    (fx, fy), (projection, names) = _constants(camera), models[camera.lens.kind]
    values = {
        "projection_type": projection,
        "width": camera.width,
        "height": camera.height,
        "focal_x": fx / longer,
        "focal_y": fy / longer,
        "c_x": camera.x0 / longer,
        "c_y": -camera.y0 / longer,
        **dict(zip(names.split(), _values(camera, names), strict=True)),
    }
    return json.dumps({camera.name: values}, indent=2) + "\n"


def agisoft_xml(camera: Camera) -> str:
    """Agisoft Metashape's calibration XML: f, cx and cy from the image centre, b1 and b2 in px."""
    models = {"brown": ("frame", "k1 k2 k3"), "fisheye": ("fisheye", "k1 k2 k3 k4")}
    head = '<?xml version="1.0" encoding="UTF-8"?>\n'
    if camera.lens.kind not in models:
        return f"{head}<!-- {_unknown_there(camera, 'Metashape')} -->\n<calibration/>\n"
    projection, names = models[camera.lens.kind]
    numbers = {
        "f": camera.c,
        "cx": camera.x0,
        "cy": -camera.y0,
        "b1": camera.c * camera.affinity,
        "b2": _skew_px(camera),
        **dict(zip(names.split(), _values(camera, names), strict=True)),
        "p1": camera.value("p2"),
        "p2": camera.value("p1"),
    }
    body = "\n".join(f"  <{name}>{value!r}</{name}>" for name, value in numbers.items())
    return (
        f"{head}<calibration>\n  <projection>{projection}</projection>\n  <width>{camera.width}</width>"
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
