"""Cameras as other programs write them: what lies beside photographs and may have been meant."""

import re

_KINDS: tuple[tuple[str, str], ...] = (
    (r"\"projection_type\"\s*:", "OpenSfM or OpenDroneMap"),
    (r"<calibration>\s*<projection>", "Metashape (Agisoft)"),
    (r"<CalibrationInternConique>", "MicMac"),
    (r"camera_matrix\s*:", "OpenCV"),
    (r"#\s*(Focal Length mm assuming|Camera radial distortion)|FOCAL\s+\d|# Camera list with one line of data", "Pix4D or COLMAP"),
    (
        r"\A\s*(?:[-+]?\d+(?:\.\d*)?\s+){2}[-+]?\d+(?:\.\d*)?\s*\n\s*-?0(?:\.0*)?\s+[-+]?\d+(?:\.\d*)?\s+[-+]?\d+(?:\.\d*)?\s*\n"
        r"\s*-?0(?:\.0*)?\s+-?0(?:\.0*)?\s+1(?:\.0*)?\s*\Z",
        "a program that writes its matrix K",
    ),
)
_HEAD = 4000
"""letters in which a file says what it is"""


def foreign_camera(text: str) -> str | None:
    """The program whose camera a text is; None where it is none that is known."""
    head = text[:_HEAD]
    return next((program for mark, program in _KINDS if re.search(mark, head)), None)
