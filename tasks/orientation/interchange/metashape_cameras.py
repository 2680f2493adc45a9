"""Cameras of Agisoft Metashape (XML, "Import Cameras"): sensors, poses in the chunk, and the chunk's place on the earth.

The chunk has topocentric axes (east, north, up in the middle of the block), from which its transform leads to geocentric
coordinates, as in projects of Metashape itself; heights stand for ellipsoidal ones. A block that lies nowhere is in its own
coordinates. A camera's transform leads from its axes (x right, y down, z forward) to the chunk. Its principal point is relative to
the image centre, y down, p1 and p2 are exchanged, b1 and b2 are affinity and skew in px.
Source: Agisoft Metashape's manual, appendix D "Camera models", and files of version 2.
"""

from xml.sax.saxutils import escape, quoteattr

import numpy as np
from pyproj import CRS

from orthomill.schemas.camera import Camera
from orthomill.schemas.errors import WorkflowError
from orthomill.tasks.geometry.reference_system import on_earth
from orthomill.tasks.geometry.topocentric import Topocentric, reference_of
from orthomill.tasks.orientation.interchange.foreign_block import Y_DOWN, ForeignBlock

_MODELS = {"brown": ("frame", ("k1", "k2", "k3")), "fisheye": ("fisheye", ("k1", "k2", "k3", "k4"))}


def metashape_cameras(block: ForeignBlock, files: dict[str, str], crs: str) -> str:
    """The document; `files`: photograph -> file name. Raises WorkflowError for lenses that Metashape lacks."""
    cameras = list({camera.name: camera for camera in block.cameras.values()}.values())
    number = {camera.name: k for k, camera in enumerate(cameras)}
    centre = np.mean([pose.centre for pose in block.poses.values()], axis=0)
    frame = Topocentric(reference_of(crs, np.array([*centre[:2], 0.0])), crs) if on_earth(crs) else None
    poses = []
    for k, (name, pose) in enumerate(block.poses.items()):
        place = frame.from_map(pose.centre[None])[0] if frame else pose.centre
        to_camera = Y_DOWN @ pose.rotation @ (frame.turn(place) if frame else np.eye(3))
        transform = np.eye(4)
        transform[:3, :3], transform[:3, 3] = to_camera.T, place
        label, sensor = quoteattr(files[name].rpartition(".")[0] or files[name]), number[block.cameras[name].name]
        poses.append(
            f'<camera id="{k}" sensor_id="{sensor}" component_id="0" label={label}>'
            f"<transform>{_numbers(transform)}</transform><orientation>1</orientation></camera>"
        )
    ids = " ".join(map(str, range(len(poses))))
    component = (
        f'<component id="0" label="Component 1">{_place(frame)}<partition><camera_ids>{ids}</camera_ids></partition></component>'
    )
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<document version="2.0.0"><chunk label="orthomill" enabled="true">',
        f'<sensors next_id="{len(cameras)}">',
        *(_sensor(k, camera) for k, camera in enumerate(cameras)),
        "</sensors>",
        f'<components next_id="1" active_id="0">{component}</components>',
        f'<cameras next_id="{len(poses)}" next_group_id="0">',
        *poses,
        "</cameras>",
        f"<reference>{escape(_system(crs))}</reference>" if frame else "",
        "</chunk></document>",
    ]
    return "\n".join(line for line in lines if line) + "\n"


def _system(crs: str) -> str:
    plan = CRS.from_user_input(crs)
    return str((plan.sub_crs_list[0] if plan.is_compound else plan.to_2d()).to_wkt("WKT1_GDAL"))


def _place(frame: Topocentric | None) -> str:
    """From the chunk to geocentric coordinates."""
    if frame is None:
        return ""
    turn, origin = frame.on_earth
    return (
        f"<transform><rotation>{_numbers(turn)}</rotation><translation>{_numbers(origin)}</translation>"
        "<scale>1.0</scale></transform>"
    )


def _sensor(number: int, camera: Camera) -> str:
    if camera.lens.kind not in _MODELS:
        raise WorkflowError(
            f"Metashape has no lens of the kind {camera.lens.kind} of the camera {camera.name}; export undistorted photographs "
            "(--as colmap)."
        )
    kind, names = _MODELS[camera.lens.kind]
    size = f'<resolution width="{camera.width}" height="{camera.height}"/>'
    values = {
        "f": camera.c,
        "cx": camera.x0,
        "cy": 0.0 - camera.y0,
        "b1": camera.c * camera.affinity,
        "b2": 0.0 - camera.c * camera.skew,
        **{name: camera.value(name) for name in names},
        "p1": camera.value("p2"),
        "p2": camera.value("p1"),
    }
    inner = "".join(f"<{name}>{float(value)!r}</{name}>" for name, value in values.items())
    return (
        f'<sensor id="{number}" label={quoteattr(camera.name)} type="{kind}">{size}'
        f'<calibration type="{kind}" class="adjusted">{size}{inner}</calibration></sensor>'
    )


def _numbers(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))
