"""Which camera took a photograph, beyond its model: serial number, digital zoom, spectral band."""

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping

from orthomill.schemas.photo import FactoryCamera, Photo, PhotoRemark, PhotoRemarkCode, tag_text
from orthomill.tasks.imagery.focal_length_constants import agrees_with_focal_length, constant_by_focal_length
from orthomill.tasks.photos import exif
from orthomill.tasks.photos.tags.makers import maker_text

_UNKNOWN = re.compile(r"0*|none|unknown|undefined|n/?a", re.IGNORECASE)
_LONGEST_NAME = 24
_COLOUR = {"", "rgb", "visible", "wide", "color", "colour"}
_MOST_ZOOM = 200.0


def serial_of(tags: Mapping[str, str]) -> str | None:
    """Serial number of the camera, or of the drone where it is not told."""
    words = (
        tag_text(tags, "BodySerialNumber"),
        maker_text(tags, "CameraSerialNumber"),
        tag_text(tags, "exifEX:BodySerialNumber"),
        tag_text(tags, "aux:SerialNumber"),
        maker_text(tags, "DroneSerialNumber", "SerialNumber"),
    )
    return next((word[:64] for word in words if not _UNKNOWN.fullmatch(word)), None)


def zoom_of(tags: Mapping[str, str]) -> float:
    """How many times the picture was enlarged in the camera; 1 without zoom (EXIF writes 0 for that, too)."""
    zoom = exif.positive(tags, "DigitalZoomRatio") or 1.0
    return zoom if 1.0 < zoom < _MOST_ZOOM else 1.0


def band_of(tags: Mapping[str, str]) -> str | None:
    """Name of the spectral band; None for colour. Where only a wavelength is told, that."""
    # Parrot's colour camera writes three names, DJI's bands one each.
    name = maker_text(tags, "BandName") or tag_text(tags, "FLIR:BandName")
    if not name and (wavelength := maker_text(tags, "CentralWavelength")) and "," not in wavelength:
        name = f"{wavelength} nm"
    return None if name.lower() in _COLOUR or "," in name else name[:_LONGEST_NAME]


def without_contradicted(photos: list[Photo]) -> tuple[list[Photo], list[PhotoRemark]]:
    """Photographs without calibrations in their tags that contradict the focal length beside them, as those of another size or
    another lens do; and what is to be said."""
    wrong = {photo.name: photo for photo in photos if _is_contradicted(photo)}
    if not wrong:
        return photos, []
    first = next(iter(wrong.values()))
    constants = first.factory.c * first.zoom if first.factory else 0.0, (constant_by_focal_length(first) or (0.0, 0.0))[0]
    words = tuple(f"{c:.0f}" for c in constants)
    kept = [photo.model_copy(update={"factory": None}) if photo.name in wrong else photo for photo in photos]
    return kept, [PhotoRemark(code=PhotoRemarkCode.FACTORY_CONTRADICTED, photos=tuple(wrong), words=words)]


def _is_contradicted(photo: Photo) -> bool:
    factory = photo.factory
    return factory is not None and factory.kind == "calibrated" and not agrees_with_focal_length(factory.c * photo.zoom, photo)


def with_calibrations(photos: list[Photo]) -> list[Photo]:
    """Photographs whose cameras are told apart by the calibrations in their tags, where these differ and no serial number does."""
    found: defaultdict[str, dict[FactoryCamera, int]] = defaultdict(dict)
    for photo in photos:
        if photo.factory and photo.factory.kind == "calibrated":
            found[photo.camera].setdefault(photo.factory, len(found[photo.camera]) + 1)
    return [
        photo.model_copy(update={"camera": _named(photo.camera, f"calibration {found[photo.camera][photo.factory]}")})
        if photo.factory in found[photo.camera] and len(found[photo.camera]) > 1
        else photo
        for photo in photos
    ]


def with_serials(photos: list[Photo]) -> list[Photo]:
    """Photographs whose cameras have their serial numbers in their names, where two of one name have different ones."""
    serials: defaultdict[str, set[str | None]] = defaultdict(set)
    for photo in photos:
        serials[photo.camera].add(photo.serial)
    several = {camera for camera, own in serials.items() if len(own - {None}) > 1}
    return [
        photo.model_copy(update={"camera": _named(photo.camera, f"no. {_plain(photo.serial)}")})
        if photo.serial and photo.camera in several
        else photo
        for photo in photos
    ]


def _plain(serial: str) -> str:
    """The letters and digits at its end, by which bodies of one series differ."""
    return re.sub(r"[^A-Za-z0-9-]", "", serial)[-_LONGEST_NAME:]


def _named(camera: str, words: str) -> str:
    """The name of a camera with more words before the size, which ends it."""
    size = re.search(r"\d+ x \d+( turned \d)?$", camera)
    start = camera[: size.start()] if size else f"{camera} "
    return f"{start}{words} {camera[len(start) :]}".strip()


def shared_equivalents(photos: list[Photo]) -> list[Photo]:
    """Photographs with digital zoom, with the 35 mm equivalent of what they show.

    Phones include the zoom in the tag, drones do not: where another photograph of the lens with another zoom has the same
    equivalent, it is not included.
    """
    zooms: defaultdict[tuple[float | None, float | None, int, int], set[float]] = defaultdict(set)
    for photo in photos:
        zooms[_lens(photo)].add(photo.zoom)
    return [
        photo.model_copy(update={"focal_35mm": photo.focal_35mm * photo.zoom})
        if photo.focal_35mm and photo.zoom > 1.0 and len(zooms[_lens(photo)]) > 1
        else photo
        for photo in photos
    ]


def _lens(photo: Photo) -> tuple[float | None, float | None, int, int]:
    return photo.focal_mm, photo.focal_35mm, photo.width, photo.height


def several_serials(photos: Iterable[Photo]) -> tuple[str, ...]:
    """The cameras whose names hold a serial number."""
    return tuple(dict.fromkeys(photo.camera for photo in photos if photo.serial and " no. " in f" {photo.camera}"))
