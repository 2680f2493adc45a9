"""What lies beside the photographs and belongs to them: a GCP list, surveyed positions, a calibrated camera.

Looked for in the folder of the photographs and in the one above it, where surveyors put it. A file is recognised by what it holds,
the GCP list by its usual name as well, because many texts hold six numbers to a line.
"""

import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from pyproj import CRS
from pyproj.exceptions import CRSError

GCP_LIST = "gcp_list.txt"
POSITION_COLUMNS = {"photo", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z"}
CAMERA_KEYS = {"name", "width", "height", "c"}
LARGEST = 1_000_000
"""bytes: what is larger is no camera and no list of positions"""


@dataclass(frozen=True)
class Beside:
    """Files found beside the photographs, relative to the project's root (None: none): the GCP list with the `system` that its
    first line names, that system where it is `projected` in metres, and whether PROJ does not know it; the CSV file of the
    positions; the camera file."""

    gcp_list: str | None = None
    system: str | None = None
    projected: str | None = None
    unknown_system: bool = False
    positions: str | None = None
    camera: str | None = None


NOTHING = Beside()
"""Only photographs lie there."""


def look_beside(folder: Path, root: Path, sizes: set[tuple[int, int]]) -> Beside:
    """What lies in the `folder` of the photographs or above it, but inside of the `root`; cameras only of one of these `sizes`
    (width, height) px. Files that cannot be read are no finds."""
    folder = Path(os.path.normpath(folder))
    # Photographs outside of the project come with what lies beside them.
    outside = not folder.is_relative_to(root)
    places = [place for place in (folder, folder.parent) if outside or place.is_relative_to(root)]
    gcp_list = _first(places, "*.txt", root, lambda text, path: path.name.lower() == GCP_LIST and len(text.splitlines()) > 1)
    system = _system_line((root / gcp_list).read_text("utf-8-sig")) if gcp_list else None
    crs = _crs(system) if system else None
    return Beside(
        gcp_list,
        system,
        _projected(crs) if crs else None,
        gcp_list is not None and crs is None,
        _first(places, "*.csv", root, lambda text, _: _header(text) >= POSITION_COLUMNS),
        _first(places, "*.json", root, lambda text, _: _is_camera(text, sizes)),
    )


def _first(places: list[Path], pattern: str, root: Path, fits: Callable[[str, Path], bool]) -> str | None:
    """The first file, by place and name, that `fits`."""
    for path in (path for place in places for path in sorted(place.glob(pattern))):
        if any(fits(text, path) for text in _text(path)):
            return Path(os.path.relpath(path, root)).as_posix()
    return None


def _text(path: Path) -> Iterator[str]:
    """The text of a file, if it is one and of a moderate size."""
    try:
        if path.is_file() and path.stat().st_size <= LARGEST:
            yield path.read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError):
        return


def _header(text: str) -> set[str]:
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    return {cell.strip() for cell in lines[0].split(",")} if lines else set()


def _is_camera(text: str, sizes: set[tuple[int, int]]) -> bool:
    try:
        found = json.loads(text)
    except ValueError:
        return False
    # The calibration of another camera, or of photographs that were reduced since, would be refused later.
    return isinstance(found, dict) and found.keys() >= CAMERA_KEYS and (found["width"], found["height"]) in sizes


def _system_line(text: str) -> str:
    """The first line that is no comment: the reference system of a GCP list."""
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    return lines[0] if lines else ""


def _crs(system: str) -> CRS | None:
    """The system of a GCP list; None where it is unknown."""
    words = system.upper().split()
    # OpenDroneMap's own way to name a UTM zone, as "WGS84 UTM 16N".
    if len(words) == 3 and words[:2] == ["WGS84", "UTM"]:
        system = f"+proj=utm +zone={words[2][:-1]} +datum=WGS84{' +south' * (words[2][-1] == 'S')}"
    try:
        return CRS.from_user_input(system)
    except CRSError:
        return None


def _projected(crs: CRS) -> str | None:
    """The system as a project names it; None where it is geographic or not in metres."""
    if not crs.is_projected or crs.axis_info[0].unit_conversion_factor != 1.0:
        return None
    # PROJ strings lack what an authority's code tells; 70 % is PROJ's own limit for a plausible match.
    code = crs.to_epsg(min_confidence=70)
    return f"EPSG:{code}" if code else crs.srs
