"""From headers to the list of photographs: names, cameras, positions, and what is refused.

Everything that is wrong with any photograph is gathered and said at once. A photograph without GPS or focal length is not wrong:
later stages say what they need.
"""

from collections import Counter
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from orthomill.schemas.errors import PhotoError, some_of
from orthomill.schemas.photo import Header, Photo, Photos, tag_text
from orthomill.schemas.project import NoPositions, Positions
from orthomill.tasks.geometry.camera_change import QUARTER_TURNS
from orthomill.tasks.geometry.reference_system import ground_coordinates, ground_crs
from orthomill.tasks.imagery.pyramid import level_count
from orthomill.tasks.imagery.upright import exif_orientation, upright_shape
from orthomill.tasks.photos import exif
from orthomill.tasks.photos.coordinates import Digital, ImageCoordinates
from orthomill.tasks.photos.positions import Position, read_positions
from orthomill.tasks.photos.scans import Fitted, Scans, in_mark_frame, in_principal_frame
from orthomill.tasks.photos.sensors import sensor_width_mm

_DIGITAL = Digital(kind="digital")
_KM_PER_DEGREE = 111.2
_STRAY_KM, _STRAY_SHARE = 20.0, 20.0
"""A position strays when it is farther from the middle than so many km, and than so many times the median distance."""


@dataclass(frozen=True)
class Limits:
    """What a photograph may be."""

    megapixels: float
    smallest_side: int = 64


def photo_from_header(header: Header) -> Photo:
    """What the header of an image file says of the photograph; no position in the project's CRS yet."""
    tags = header.tags
    orientation = exif_orientation(tags)
    rows, cols = upright_shape(orientation, header.height, header.width)
    place = exif.longitude_latitude(tags)
    return Photo(
        name=PurePath(header.path).stem,
        path=header.path,
        width=cols,
        height=rows,
        bands=1 if header.bands == 1 else 3,
        dtype=header.dtype,
        exif_orientation=orientation,
        camera=_camera_name(header, orientation),
        focal_mm=exif.positive(tags, "FocalLength"),
        focal_35mm=exif.positive(tags, "FocalLengthIn35mmFilm"),
        pixel_um=_pixel_um(header),
        longitude=place[0] if place else None,
        latitude=place[1] if place else None,
        altitude=exif.altitude(tags),
        time=exif.time(tags),
        attitude=exif.gimbal_attitude(tags),
        levels=level_count((rows, cols)),
    )


def index_photos(
    headers: tuple[Header, ...],
    crs: str,
    positions: Positions,
    limits: Limits,
    positions_text: str | None = None,
    coordinates: ImageCoordinates = _DIGITAL,
    scan_texts: tuple[str, ...] = (),
) -> dict[str, Photos | Scans]:
    """All photographs of a project, in the order of `headers`, and how scans lay.

    positions_text: the CSV file, for the kinds that read one; scan_texts: the files of `coordinates`. Raises PhotoError naming
    every photograph that cannot be used, WorkflowError for the CRS and the positions file.
    """
    ground_crs(crs)
    refusals = [sentence for header in headers if (sentence := _refusal(header, limits))]
    photos = [photo_from_header(header) for header in headers]
    if refusals:
        raise PhotoError(" ".join(refusals))
    photos, remarks = _without_duplicates(photos)
    photos = _with_sensors(photos)
    remarks += _turned_without_a_flag(photos)
    if positions.kind == "exif":
        photos, strays = _without_strays(photos)
        remarks += strays
        photos = _placed_by_gps(photos, crs, (positions.sigma_plan, positions.sigma_plan, positions.sigma_height))
    elif not isinstance(positions, NoPositions):
        photos = _placed_by_file(photos, positions_text or "")
    fitted = _fitted(photos, coordinates, scan_texts)
    framed = [one.photo for one in fitted] or photos
    leveled = (photo.model_copy(update={"levels": level_count((photo.height, photo.width))}) for photo in framed)
    cut = coordinates.kind != "digital" and coordinates.picture_mm is not None
    scans = Scans(scans=tuple(one.scan for one in fitted), cut=cut)
    return {"photos": Photos(photos=tuple(leveled), remarks=tuple(remarks)), "scans": scans}


def _fitted(photos: list[Photo], coordinates: ImageCoordinates, texts: tuple[str, ...]) -> list[Fitted]:
    """Scans in their common frame; nothing for digital photographs."""
    if coordinates.kind == "digital":
        return []
    turned = [photo.name for photo in photos if photo.exif_orientation != 1]
    if turned:
        raise PhotoError(f"{', '.join(turned[:8])}: scans must not be turned by an EXIF flag; save them as they were scanned.")
    if coordinates.kind == "fiducial_marks":
        return in_mark_frame(photos, *texts, coordinates.pixel_um, coordinates.picture_mm)
    return in_principal_frame(photos, *texts, coordinates.pixel_um, coordinates.picture_mm)


def _refusal(header: Header, limits: Limits) -> str | None:
    megapixels = header.width * header.height / 1e6
    if megapixels > limits.megapixels:
        return (
            f"{header.path} has {megapixels:.1f} megapixels ({header.width} x {header.height}), "
            f"more than the {limits.megapixels:g} that are allowed; raise max_megapixels of the stage photos if the file is meant."
        )
    if min(header.width, header.height) < limits.smallest_side:
        size = f"{header.width} x {header.height} pixels"
        return f"{header.path} is only {size}, too small for a photograph ({limits.smallest_side} at least)."
    if header.bands not in (1, 3, 4):
        return f"{header.path} has {header.bands} bands; grey (1), RGB (3) and RGB with alpha (4) can be read."
    if header.dtype not in ("uint8", "uint16"):
        return (
            f"{header.path} has pixels of type {header.dtype}; unsigned integers of 8 or 16 bits can be read, so convert it first."
        )
    return None


def _without_duplicates(photos: list[Photo]) -> tuple[list[Photo], list[str]]:
    """The first photograph of every name, and a sentence for each one that was set aside."""
    first: dict[str, Photo] = {}
    sentences = []
    for photo in photos:
        twin = first.setdefault(photo.name, photo)
        if twin is not photo:
            sentences.append(
                f"{twin.path} and {photo.path} have the same name {photo.name}, by which everything refers to them: the second was "
                "set aside; rename it if it is another photograph."
            )
    return list(first.values()), sentences


def _without_strays(photos: list[Photo]) -> tuple[list[Photo], list[str]]:
    """Photographs without the GPS positions that lie far from all others: a receiver that had no fix yet, or a photograph of
    another place. Where half of them stray, nobody knows who is right, and all are kept."""
    tagged = [photo for photo in photos if photo.longitude is not None]
    if len(tagged) < 4:
        return photos, []
    degrees = np.array([(photo.longitude, photo.latitude) for photo in tagged])
    middle = np.median(degrees, axis=0)
    east = (degrees[:, 0] - middle[0] + 180.0) % 360.0 - 180.0
    km = _KM_PER_DEGREE * np.hypot(east * np.cos(np.radians(middle[1])), degrees[:, 1] - middle[1])
    far = km > max(_STRAY_KM, _STRAY_SHARE * float(np.median(km)))
    strays = {tagged[i].name: float(km[i]) for i in np.flatnonzero(far)} if 2 * far.sum() < len(tagged) else {}
    nowhere = {"longitude": None, "latitude": None}
    kept = [photo.model_copy(update=nowhere) if photo.name in strays else photo for photo in photos]
    return kept, [
        f"The GPS tag of {name} lies {distance:.0f} km from the other photographs and was left out; the "
        "photograph itself takes part."
        for name, distance in strays.items()
    ]


def _camera_name(header: Header, orientation: int) -> str:
    make, model = tag_text(header.tags, "Make"), tag_text(header.tags, "Model")
    maker = "" if model.upper().startswith(make.upper()) else make
    focal = exif.positive(header.tags, "FocalLength")
    words = [maker, model, f"{focal:g} mm" if focal else "", f"{header.width} x {header.height}"]
    if orientation not in (1, *QUARTER_TURNS):
        words.append(f"turned {orientation}")
    return " ".join(word for word in words if word)


def _with_sensors(photos: list[Photo]) -> list[Photo]:
    """Photographs whose pixels were turned in the file, and which EXIF turns back, with the camera of those that nobody turned."""
    untouched = {photo.camera for photo in photos if photo.exif_orientation == 1}
    found = []
    for photo in photos:
        upright_word = _swapped(photo)
        own = photo.exif_orientation in QUARTER_TURNS and photo.camera not in untouched and upright_word in untouched
        found.append(photo.model_copy(update={"camera": upright_word, "as_taken": True}) if own else photo)
    return found


def _swapped(photo: Photo) -> str:
    """The camera's word with width and height exchanged."""
    words, _, height = photo.camera.rpartition(" x ")
    start, _, width = words.rpartition(" ")
    return " ".join(word for word in (start, f"{height} x {width}") if word)


def _turned_without_a_flag(photos: list[Photo]) -> list[str]:
    """A sentence about photographs that a program turned by a quarter without telling, beside more of the same camera that lie."""
    count = Counter(photo.camera for photo in photos)
    names = [
        photo.name
        for photo in photos
        if photo.focal_mm and photo.exif_orientation == 1 and 0 < count[photo.camera] < count[_swapped(photo)]
    ]
    if not names:
        return []
    return [
        f"{some_of(names)}: the size of the other photographs of this camera with width and height exchanged, and no EXIF flag "
        "that says why. A program turned the pixels; which way is not known, so the interior orientation cannot be shared with the "
        "others and is adjusted by itself. Take the files as the camera wrote them."
    ]


def _pixel_um(header: Header) -> float | None:
    """Side of a pixel in micrometres: the maker's sensor width goes before the focal plane tags, which many cameras get wrong."""
    longer_side = max(header.width, header.height)
    width = sensor_width_mm(tag_text(header.tags, "Model"))
    return 1000.0 * width / longer_side if width else exif.focal_plane_pixel_um(header.tags, longer_side)


def _placed_by_gps(photos: list[Photo], crs: str, sigma: tuple[float, float, float]) -> list[Photo]:
    tagged = [photo for photo in photos if photo.longitude is not None and photo.altitude is not None]
    if not tagged:
        return photos
    xy = ground_coordinates(crs, np.array([(photo.longitude, photo.latitude) for photo in tagged]))
    places = {photo.name: (float(x), float(y), photo.altitude) for photo, (x, y) in zip(tagged, xy, strict=True)}
    return [_placed(photo, places.get(photo.name), sigma) for photo in photos]


def _placed_by_file(photos: list[Photo], text: str) -> list[Photo]:
    positions = read_positions(text)
    return [_placed_as(photo, positions.get(photo.name)) for photo in photos]


def _placed_as(photo: Photo, position: Position | None) -> Photo:
    if position is None:
        return photo
    placed = _placed(photo, position.xyz, position.sigma)
    return placed if position.attitude is None else placed.model_copy(update={"attitude": position.attitude})


def _placed(photo: Photo, xyz: tuple[float, float, float] | None, sigma: tuple[float, float, float]) -> Photo:
    return photo if xyz is None else photo.model_copy(update={"position": xyz, "position_sigma": sigma})
