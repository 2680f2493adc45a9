"""Rolling shutters: how far the aircraft moves while the rows of one photograph are exposed, in pixels on the ground.

Rows are exposed one after another; at 10 m/s and 30 ms the last one sees the ground from 0.3 m farther on. The block absorbs the
part that is common to all photographs, and what differs bends the rays. Read-out times are those that OpenDroneMap lists
(`rollingshutter.py`), in ms of the whole frame, measured by its users; a camera that is not listed has none here, as those with a
mechanical or global shutter.
"""

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from itertools import pairwise

import numpy as np

from orthomill.schemas.photo import Photo, tag_text

READOUT_MS = {
    "FC300S": 33.0,
    "FC300X": 33.0,
    "FC300C": 33.0,
    "FC330": 33.0,
    "FC220": 64.0,
    "FC3170": 27.0,
    "FC3411": 32.0,
    "FC3682": 23.0,
    "L1D-20C": 47.0,
    "L2D-20C": 16.6,
    "XT701": 25.0,
    "XT705": 30.0,
    "XL724": 29.0,
    "ANAFI": 39.0,
    "E90": 44.0,
}
"""ms by model"""
_MOST_PX = 1.0
_LONGEST_GAP, _LEAST_GAP, _LEAST_WHOLE = 20.0, 0.2, 2.0
"""s between neighbouring photographs of a strip from which a speed follows; the last where tags have whole seconds only"""


def readout_s(tags: Mapping[str, str], rows: int) -> float | None:
    """Seconds between the first and the last row, by the tags or the model; None where it is not known."""
    stated = next((value for name, value in tags.items() if name.rpartition(":")[2] == "LineReadoutTime"), "")
    if match := re.match(r"\d+(?:\.\d+)?", stated):
        return float(match[0]) * 1e-9 * rows  # nanoseconds for a row
    found = READOUT_MS.get(tag_text(tags, "Model").upper())
    return found / 1000.0 if found else None


def stated_speed(tags: Mapping[str, str]) -> float | None:
    """m/s over the ground by the components of the speed in the tags."""
    east, north = (re.fullmatch(r"[-+]?\d+(?:\.\d+)?", _speed(tags, axis)) for axis in "XY")
    return float(np.hypot(float(east[0]), float(north[0]))) if east and north else None


def _speed(tags: Mapping[str, str], axis: str) -> str:
    names = (f"Flight{axis}Speed", f"Speed{axis}")
    return next((value.strip() for name, value in tags.items() if name.rpartition(":")[2] in names), "")


def rolling_shutter_sentences(photos: Iterable[Photo]) -> Iterator[str]:
    """A sentence for each camera whose photographs are displaced by more than a pixel while they are read out."""
    of_camera: dict[str, list[Photo]] = defaultdict(list)
    for photo in photos:
        of_camera[photo.camera].append(photo)
    for camera, own in of_camera.items():
        moved = displacement_px(own)
        if moved is not None and moved > _MOST_PX:
            ms = 1000.0 * next(photo.readout_s for photo in own if photo.readout_s)
            yield (
                f"{camera}: while a photograph is read out ({ms:.0f} ms), the aircraft moves by about {moved:.1f} pixels on the "
                "ground (rolling shutter); set 'variation' of the stage orientation, which estimates such errors of the "
                "image, or fly more slowly."
            )


def displacement_px(photos: list[Photo]) -> float | None:
    """Median movement during the read-out, in pixels on the ground, of the photographs of one camera; None where not known."""
    readouts = [photo.readout_s for photo in photos if photo.readout_s]
    pixels = [pixel for photo in photos if (pixel := _ground_pixel(photo))]
    speed = _median_speed(photos)
    return None if not readouts or not pixels or speed is None else float(speed * np.median(readouts) / np.median(pixels))


def _ground_pixel(photo: Photo) -> float | None:
    """m, from the height above the place of take-off and the camera constant that tags give."""
    diagonal = float(np.hypot(photo.width, photo.height))
    by_35mm = photo.focal_35mm / 43.27 * diagonal if photo.focal_35mm else None  # CIPA: by the diagonal of 36 x 24 mm
    c = photo.factory.c if photo.factory else by_35mm
    return photo.relative_height / c if c and photo.relative_height and photo.relative_height > 0 else None


def _median_speed(photos: list[Photo]) -> float | None:
    stated = [photo.speed for photo in photos if photo.speed is not None]
    found = stated if 2 * len(stated) > len(photos) else list(_speeds(photos))
    return float(np.median(found)) if found else None


def _speeds(photos: list[Photo]) -> Iterator[float]:
    """From positions and times of neighbouring photographs."""
    placed = sorted((photo.time, photo.position[:2]) for photo in photos if photo.time and photo.position)
    for (before, start), (after, end) in pairwise(placed):
        try:
            seconds = (datetime.fromisoformat(after) - datetime.fromisoformat(before)).total_seconds()
        except ValueError:  # cameras without a clock write months of zero
            continue
        if (_LEAST_GAP if "." in before + after else _LEAST_WHOLE) <= seconds <= _LONGEST_GAP:
            yield float(np.hypot(end[0] - start[0], end[1] - start[1])) / seconds
