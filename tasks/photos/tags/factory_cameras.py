"""The camera that the tags describe: calibrated at the factory, or as its drawings have it.

What makes these tags dangerous: DJI's principal point counts from the centre of the picture, Skydio's from its corner; a thermal
camera of DJI writes micrometres for pixels; where nothing was calibrated the same tags hold the design values; all are for the
picture as the camera wrote it, larger than a file that was reduced; and a picture whose distortion was taken out keeps the numbers
of the lens. A constant that is far from what the focal length says is none.

DJI's cx, cy count to the right and down from the centre: its guide to image processing (Mavic 3M, 2023, step 2) gives OpenCV's
matrix as ((fx, 0, CenterX + cx), (0, fy, CenterY + cy), (0, 0, 1)). A block tells less of it than it seems: a principal point and a
decentring are alike, and 19 px of the former are p = 0.004 of the latter where k1 is -0.4, so that an adjustment whose y0 has the
other sign contradicts nothing; held fixed, the documented sign fits the yard's photographs better (0.176 px against 0.208).

Seen in files: DJI, Parrot's Sequoia. By documentation only: Skydio (its support pages: focal lengths and optical centre in pixels
from the corner, three numbers k1, k2, k3), MicaSense (Pix4D's words for cameras, in millimetres).
"""

from collections.abc import Mapping
from dataclasses import dataclass

from orthomill.schemas.photo import FactoryCamera, tag_text
from orthomill.tasks.photos import exif
from orthomill.tasks.photos.tags.makers import maker_number, maker_numbers

_WIDEST, _LONGEST = 0.2, 30.0
"""Camera constants in units of the width: nothing that flies is outside of this"""
_ECCENTRIC = 0.1
"""Farthest principal point from the centre in units of the width"""
_OTHER_SIZE = 0.15
"""Twice the optical centre differs by more than this part from the width only where it is that of another size"""
_MOST_DISTORTION = 20.0
"""A coefficient beyond this is another number"""


@dataclass(frozen=True)
class PictureFrame:
    """Width and height of a file, px, not turned; `width_written`: that of the picture before the file was reduced."""

    width: int
    height: int
    width_written: float

    @property
    def scale(self) -> float:
        """Pixels of the file for one of the picture as it was written."""
        return self.width / self.width_written


def written_width(tags: Mapping[str, str], width: int) -> float:
    """The width, px, of the picture that these numbers are for, by the optical centre, which lies near its middle; that of the file
    where this is hardly another one."""
    col = maker_number(tags, "CalibratedOpticalCenterX")
    return 2.0 * col if col and col > 0 and abs(2.0 * col / width - 1.0) > _OTHER_SIZE else float(width)


def was_dewarped(tags: Mapping[str, str]) -> bool:
    """Whether the distortion was removed in the camera."""
    return maker_number(tags, "DewarpFlag") == 1


def factory_camera(tags: Mapping[str, str], frame: PictureFrame) -> FactoryCamera | None:
    """The interior orientation in pixels of the file; None without one, or where its numbers cannot be one."""
    found = _dji(tags, frame) or _skydio(tags, frame) or _pix4d(tags, frame) or _design(tags, frame)
    return found if found is not None and _possible(found, frame) else None


def _dji(tags: Mapping[str, str], frame: PictureFrame) -> FactoryCamera | None:
    """DewarpData: date; fx, fy, cx, cy, k1, k2, p1, p2, k3; the centre from that of the picture."""
    numbers = exif.listed(tag_text(tags, "drone-dji:DewarpData").rpartition(";")[2])
    if len(numbers) != 9 or min(numbers[:2]) <= 0:
        return None
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = numbers
    return _calibrated(frame, fx, fy, cx, cy, (k1, k2, k3, p1, p2), was_dewarped(tags))


def _skydio(tags: Mapping[str, str], frame: PictureFrame) -> FactoryCamera | None:
    """Focal lengths and optical centre in pixels from the middle of the corner pixel, and k1, k2, k3."""
    pair = maker_number(tags, "CalibratedFocalLengthX"), maker_number(tags, "CalibratedFocalLengthY")
    centre = maker_number(tags, "CalibratedOpticalCenterX"), maker_number(tags, "CalibratedOpticalCenterY")
    fx, fy, col, row = *pair, *centre
    if not fx or not fy or not col or not row or min(fx, fy) <= 0:
        return None
    height_written = frame.height / frame.scale
    cx, cy = col - (frame.width_written - 1) / 2, row - (height_written - 1) / 2
    k = maker_numbers(tags, "DewarpData")
    k1, k2, k3 = k if len(k) == 3 else (0.0, 0.0, 0.0)
    return _calibrated(frame, fx, fy, cx, cy, (k1, k2, k3, 0.0, 0.0), was_dewarped(tags))


def _pix4d(tags: Mapping[str, str], frame: PictureFrame) -> FactoryCamera | None:
    """Pix4D's perspective camera, in mm: focal length, principal point from the corner, k1, k2, k3, p1, p2; its pixel by EXIF.

    A fisheye is another model; none of its numbers is one of ours.
    """
    if tag_text(tags, "Camera:ModelType").lower() not in ("", "perspective"):
        return None
    focal, centre = exif.numbers(tags, "Camera:PerspectiveFocalLength"), exif.numbers(tags, "Camera:PrincipalPoint")
    distortion = exif.numbers(tags, "Camera:PerspectiveDistortion")
    per_mm = exif.pixels_per_mm(tags)
    if not focal or focal[0] <= 0 or len(centre) != 2 or len(distortion) != 5 or per_mm is None:
        return None
    c = focal[0] * per_mm
    cx, cy = centre[0] * per_mm - frame.width_written / 2, centre[1] * per_mm - frame.height / frame.scale / 2
    k1, k2, k3, p1, p2 = distortion
    return _calibrated(frame, c, c, cx, cy, (k1, k2, k3, p1, p2), was_dewarped(tags))


def _design(tags: Mapping[str, str], frame: PictureFrame) -> FactoryCamera | None:
    """CalibratedFocalLength of DJI, px: that of the drawings. Thermal cameras have it in micrometres, with a centre of 0."""
    c, col = maker_number(tags, "CalibratedFocalLength"), maker_number(tags, "CalibratedOpticalCenterX")
    if c is None or c <= 0 or not col:
        return None
    return FactoryCamera(kind="design", c=c * frame.scale)


def _calibrated(
    frame: PictureFrame, fx: float, fy: float, cx: float, cy: float, lens: tuple[float, ...], dewarped: bool
) -> FactoryCamera:
    """cx, cy: right of and below the centre of the picture, px; `lens`: k1, k2, k3, p1, p2 as in OpenCV."""
    c = fy * frame.scale
    if dewarped:
        # The picture was made anew, about its centre and with one constant.
        return FactoryCamera(kind="calibrated", c=c)
    k1, k2, k3, p1, p2 = lens
    return FactoryCamera(
        kind="calibrated", c=c, affinity=fx / fy - 1.0, x0=cx * frame.scale, y0=-cy * frame.scale, k1=k1, k2=k2, k3=k3, p1=p1, p2=p2
    )


def _possible(camera: FactoryCamera, frame: PictureFrame) -> bool:
    coefficients = (camera.k1, camera.k2, camera.k3, camera.p1, camera.p2)
    return (
        _WIDEST < camera.c / frame.width < _LONGEST
        and abs(camera.affinity) < _ECCENTRIC
        and max(abs(camera.x0), abs(camera.y0)) < _ECCENTRIC * frame.width
        and max(map(abs, coefficients)) < _MOST_DISTORTION
    )
