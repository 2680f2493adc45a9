"""The folder "params" of Pix4Dmapper: cameras and poses as text, and matrices of projection.

Angles are those of PATB, which are ours; matrices K [R | -R t] take a camera that looks along z with y down, in px of the file.
Radial and tangential coefficients are those of OpenCV. The matrices of projection are of undistorted photographs, with the offset
taken off.
Source: Pix4D's documentation, "How are the internal and external camera parameters defined?" and "Contents of the params folder".
"""

import numpy as np

from orthomill.schemas.camera import Camera
from orthomill.schemas.errors import WorkflowError
from orthomill.tasks.geometry.distortion import principal_place
from orthomill.tasks.geometry.rotation import angles
from orthomill.tasks.orientation.interchange.foreign_block import Y_DOWN, ForeignBlock

_HEAD = """fileName imageWidth imageHeight
camera matrix K [3x3]
radial distortion [3x1]
tangential distortion [2x1]
camera position t [3x1]
camera rotation R [3x3]
camera model m = K [R|-Rt] X

"""


def pix4d_params(block: ForeignBlock, files: dict[str, str], origin: np.ndarray, project: str) -> dict[str, bytes]:
    """Contents by file name; `files`: photograph -> file name; `origin` (3,): the offset. Raises WorkflowError for lenses that
    Pix4D lacks."""
    external, internal, matrices = ["imageName X Y Z Omega Phi Kappa\n"], [_HEAD], []
    for name, pose in block.poses.items():
        camera, file = block.cameras[name], files[name]
        omega, phi, kappa = np.degrees(angles(pose.rotation))
        x, y, z = pose.centre
        external.append(f"{file} {x:.6f} {y:.6f} {z:.6f} {omega:.10f} {phi:.10f} {kappa:.10f}\n")
        turn, inner = Y_DOWN @ pose.rotation, _matrix(camera)
        # Positions of these two files have the offset taken off, as the folder's own have.
        shifted = pose.centre - origin
        lens = [_row([camera.value(k) for k in ("k1", "k2", "k3")]), _row([camera.value(k) for k in ("p1", "p2")])]
        internal.append(
            "\n".join([f"{file} {camera.width} {camera.height}", _rows(inner), *lens, _row(shifted), _rows(turn)]) + "\n"
        )
        matrices.append(f"{file} {_row((inner @ np.column_stack([turn, -turn @ shifted])).ravel())}\n")
    texts = {
        "calibrated_external_camera_parameters.txt": "".join(external),
        "calibrated_camera_parameters.txt": "".join(internal),
        "pmatrix.txt": "".join(matrices),
        "offset.xyz": " ".join(f"{value:.3f}" for value in origin) + "\n",
    }
    return {f"{project}_{name}": text.encode() for name, text in texts.items()}


def _matrix(camera: Camera) -> np.ndarray:
    if camera.lens.kind != "brown":
        raise WorkflowError(
            f"These files of Pix4D have no lens of the kind {camera.lens.kind} of the camera {camera.name}; export undistorted "
            "photographs (--as colmap)."
        )
    col, row = principal_place(camera)
    return np.array(
        [[camera.c * (1.0 + camera.affinity), 0.0 - camera.c * camera.skew, col], [0.0, camera.c, row], [0.0, 0.0, 1.0]]
    )


def _rows(matrix: np.ndarray) -> str:
    return "\n".join(map(_row, matrix))


def _row(values: np.ndarray | list[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
