"""From image headers to the list of photographs: names, cameras, positions, and which files are refused.

The faults of all photographs are collected and reported together. A photograph without GPS or focal length is not faulty: the
stages that need them ask for them.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePath
from typing import NamedTuple

import numpy as np

from orthomill.schemas.errors import PhotoError, some_of
from orthomill.schemas.findings.position_findings import HeightsOfPositions, PositionsRead
from orthomill.schemas.photo import Header, Photo, PhotoRemark, PhotoRemarkCode, Photos, Soundness, tag_text
from orthomill.schemas.project import NoPositions, Positions, PositionsFromExif
from orthomill.tasks.geometry.camera_change import QUARTER_TURNS
from orthomill.tasks.geometry.reference_system import ground_coordinates, ground_crs
from orthomill.tasks.imagery.pyramid import level_count
from orthomill.tasks.imagery.upright import exif_orientation, upright_shape
from orthomill.tasks.photos import exif
from orthomill.tasks.photos.coordinates import Digital, ImageCoordinates
from orthomill.tasks.photos.mask_files import with_masks
from orthomill.tasks.photos.pair_names import refuse_ambiguous
from orthomill.tasks.photos.position_files.photographs_by_file import placed_by_file
from orthomill.tasks.photos.position_files.tag_heights import refuse_unfit_map, with_heights_of_crs
from orthomill.tasks.photos.rolling_shutter import readout_s, stated_speed
from orthomill.tasks.photos.scans import Fitted, Scans, in_mark_frame, in_principal_frame
from orthomill.tasks.photos.sensors import sensor_width_mm
from orthomill.tasks.photos.sorting.names_apart import named_apart
from orthomill.tasks.photos.sorting.set_aside import without_damaged, without_others, without_unusable
from orthomill.tasks.photos.tags.attitudes import attitude_of, on_map
from orthomill.tasks.photos.tags.factory_cameras import PictureFrame, factory_camera, was_dewarped, written_width
from orthomill.tasks.photos.tags.fixes import Sigma, fix_of, position_sigma
from orthomill.tasks.photos.tags.flights import with_flights
from orthomill.tasks.photos.tags.heights import height_of, with_one_sign
from orthomill.tasks.photos.tags.instruments import (
    band_of,
    serial_of,
    shared_equivalents,
    with_calibrations,
    with_serials,
    without_contradicted,
    zoom_of,
)
from orthomill.tasks.photos.tags.places import place_of
from orthomill.tasks.photos.tags.remarks import SAME_SHAPE, file_remarks, tag_remarks
from orthomill.tasks.photos.tags.repeated_places import counted_once, repetitions
from orthomill.tasks.photos.tags.times import with_one_clock

_DIGITAL = Digital(kind="digital")
_KM_PER_DEGREE = 111.2  # of a meridian; enough to tell kilometres from continents
# A position is a stray when it lies farther from the median position than this, in km and in multiples of the median distance.
# Both are needed: a block of a few hectares has a median distance of metres, a country-wide one of hundreds of kilometres.
# Photographs whose neighbours are within 50 m do not overlap with one a kilometre away.
_STRAY_KM, _STRAY_SHARE = 1.0, 20.0
# Photographs that are farther than so many median distances between neighbours from all others show other ground, from whatever
# height they were taken; between a flight of metres and one for mapping from an airliner, whose frames are 20 km wide (m).
_APART_BASES, _APART = 20.0, (1_000.0, 50_000.0)
_SAMPLE = 200  # photographs by which the distance between neighbours is known well enough
_ONE_COUNTRY = 10.0  # degrees; what lies farther apart is on no map of one block
_FEWEST_TO_JUDGE = 3  # of two, either may be wrong


@dataclass(frozen=True)
class Limits:
    """Which photographs are accepted: of `megapixels` at most and `smallest_side` px at least, and of several bands those of one
    `band`; None: the one that serves best."""

    megapixels: float
    smallest_side: int = 64
    band: str | None = None


class PhotoIndex(NamedTuple):
    """All photographs of a project, and how their scans were transformed (empty for digital photographs)."""

    photos: Photos
    scans: Scans


class Positioned(NamedTuple):
    """Photographs with positions, remarks about these, the file that they come from, and what their heights refer to."""

    photos: list[Photo]
    remarks: list[PhotoRemark]
    read: PositionsRead | None = None
    heights: HeightsOfPositions | None = None


def photo_from_header(header: Header) -> Photo:
    """The photograph as the header of its file describes it; without a position in the project's CRS."""
    tags = header.tags
    orientation = exif_orientation(tags)
    rows, cols = upright_shape(orientation, header.height, header.width)
    place, height, attitude = place_of(tags), height_of(tags), attitude_of(tags)
    return Photo(
        name=PurePath(header.path).stem,
        path=header.path,
        width=cols,
        height=rows,
        bands=header.bands,
        masked=header.masked,
        dtype=header.dtype,
        decoding=header.decoding,
        exif_orientation=orientation,
        camera=_camera_name(header, orientation),
        original=_original(header, orientation),
        focal_mm=exif.positive(tags, "FocalLength"),
        focal_35mm=exif.positive(tags, "FocalLengthIn35mmFilm"),
        pixel_um=_pixel_um(header),
        longitude=place[0] if place else None,
        latitude=place[1] if place else None,
        altitude=height.value,
        height_kind=height.kind,
        relative_height=height.above_start,
        fix=fix_of(tags),
        attitude=attitude.angles if attitude else None,
        attitude_of=attitude.of if attitude else None,
        serial=serial_of(tags),
        factory=factory_camera(tags, _frame(header)),
        dewarped=was_dewarped(tags),
        zoom=zoom_of(tags),
        band=band_of(tags),
        readout_s=readout_s(tags, header.height),
        speed=stated_speed(tags),
        levels=level_count((rows, cols)),
    )


def _original(header: Header, orientation: int) -> tuple[int, int] | None:
    """Width and height, upright, before the file was reduced, by its tags; None where it was not, or was cut as well."""
    written = _written(header)
    if written is None:
        return None
    height, width = upright_shape(orientation, round(written[1]), round(written[0]))
    return width, height


def _written(header: Header) -> tuple[float, float] | None:
    """Width and height, not turned, before the file was reduced, by its tags."""
    width, height = exif.positive(header.tags, "PixelXDimension"), exif.positive(header.tags, "PixelYDimension")
    if width is None or height is None:
        return None
    along, across = width / header.width, height / header.height
    return None if along <= 1.0 or abs(across / along - 1.0) > SAME_SHAPE else (width, height)


def _frame(header: Header) -> PictureFrame:
    written = _written(header)
    return PictureFrame(header.width, header.height, written[0] if written else written_width(header.tags, header.width))


def index_photos(
    headers: tuple[Header, ...],
    crs: str,
    positions: Positions,
    limits: Limits,
    positions_text: str | None = None,
    coordinates: ImageCoordinates = _DIGITAL,
    scan_texts: tuple[str, ...] = (),
    pictures: tuple[Soundness, ...] = (),
    masks: tuple[Header, ...] = (),
) -> PhotoIndex:
    """All photographs of a project, in the order of `headers`, and how scans were transformed.

    positions_text: the CSV file, for the kinds that read one; scan_texts: the files of `coordinates`;
    pictures: whether those of the photographs are whole; masks: the headers of their masks. Raises PhotoError naming every
    photograph that cannot be used, WorkflowError for the CRS and the positions file.
    """
    ground_crs(crs)
    headers, unusable = without_unusable(headers, limits.smallest_side)
    headers, damaged = without_damaged(headers, pictures)
    headers, aside = without_others(headers, limits.band)
    refusals = [sentence for header in headers if (sentence := _refusal(header, limits))]
    if refusals:
        raise PhotoError(" ".join(refusals))
    photos, remarks = _without_duplicates(named_apart([photo_from_header(header) for header in headers]))
    refuse_ambiguous([photo.name for photo in photos])
    photos, of_masks = with_masks(photos, masks)
    remarks += of_masks
    photos, contradicted = without_contradicted(shared_equivalents(photos))
    photos = _with_sensors(with_calibrations(with_serials(photos)))
    photos = with_flights(with_one_clock(photos, headers))
    photos, about_heights = with_one_sign(photos)
    remarks += [*unusable, *damaged, *aside, *_rotated_without_flag(photos)]
    remarks += [*_about_tags(headers, photos, positions), *about_heights, *contradicted]
    found = _placed(on_map(photos, crs), crs, positions, positions_text or "", _own_sigmas(headers))
    photos = found.photos
    refuse_unfit_map(photos, crs)
    remarks += [*found.remarks, *_far_apart(photos), *tag_remarks(headers, photos, positions), *file_remarks(headers)]
    fitted = _fitted(photos, coordinates, scan_texts)
    framed = [one.photo for one in fitted] or photos
    # The frame of a scan differs in size from its file, so the number of pyramid levels is counted again.
    leveled = (photo.model_copy(update={"levels": level_count((photo.height, photo.width))}) for photo in framed)
    cut = coordinates.kind != "digital" and coordinates.picture_mm is not None
    scans = Scans(scans=tuple(one.scan for one in fitted), cut=cut)
    indexed = Photos(photos=tuple(leveled), remarks=tuple(remarks), positions_read=found.read, heights=found.heights)
    return PhotoIndex(indexed, scans)


def _placed(photos: list[Photo], crs: str, positions: Positions, text: str, own: dict[str, Sigma]) -> Positioned:
    """The photographs with their positions in the project's CRS, as far as these are known, and remarks about stray ones.

    own: the standard errors that the tags give, by the path of the photograph.
    """
    if isinstance(positions, NoPositions):
        return Positioned(photos, [])
    if positions.kind != "exif":
        # The tags say how the position was found that they hold, not the one of the file.
        plain = [photo.model_copy(update={"fix": None, "height_kind": None}) for photo in photos]
        return Positioned(*placed_by_file(plain, text, positions if positions.kind == "file" else None, crs))
    # Strays are removed before projecting: a tag in another hemisphere would lie outside the CRS and refuse the whole project.
    photos, strays = _without_strays(photos)
    stated = {photo.path: _stated(positions, own[photo.path]) for photo in photos}
    placed = _placed_by_gps(photos, crs, counted_once(stated, repetitions(photos)))
    placed, heights = with_heights_of_crs(placed, crs, positions.crs)
    return Positioned(placed, strays, None, heights)


def _own_sigmas(headers: tuple[Header, ...]) -> dict[str, Sigma]:
    return {header.path: position_sigma(header.tags) for header in headers}


def _stated(positions: PositionsFromExif, own: Sigma) -> Sigma:
    """The standard errors that the workflow states, of all photographs, or a photograph's own."""
    plan, height = positions.sigma_plan, positions.sigma_height
    return plan or own[0], plan or own[1], height or own[2]


def _fitted(photos: list[Photo], coordinates: ImageCoordinates, texts: tuple[str, ...]) -> list[Fitted]:
    """Scans in their common frame; empty for digital photographs."""
    if coordinates.kind == "digital":
        return []
    # Marks are measured in the pixels of the file; a flag would put them elsewhere without anybody noticing.
    rotated = [photo.name for photo in photos if photo.exif_orientation != 1]
    if rotated:
        raise PhotoError(
            f"{', '.join(rotated[:8])}: scans must not be rotated by an EXIF flag; save them without it, as they were scanned."
        )
    if coordinates.kind == "fiducial_marks":
        marks, measured = texts
        return in_mark_frame(photos, marks, measured, coordinates.pixel_um, coordinates.picture_mm)
    return in_principal_frame(photos, texts[0], coordinates.pixel_um, coordinates.picture_mm)


def _refusal(header: Header, limits: Limits) -> str | None:
    megapixels = header.width * header.height / 1e6
    if megapixels > limits.megapixels:
        return (
            f"{header.path} has {megapixels:.1f} megapixels ({header.width} x {header.height}), "
            f"more than the {limits.megapixels:g} that are allowed; raise max_megapixels of the stage photos if the file is meant."
        )
    if header.bands not in (1, 3):
        return f"{header.path} has {header.bands} bands; grey (1) and RGB (3) can be read, with an alpha band or without."
    if header.dtype not in ("uint8", "uint16"):
        return (
            f"{header.path} has pixels of type {header.dtype}; unsigned integers of 8 or 16 bits can be read, so convert it first."
        )
    return None


def _without_duplicates(photos: list[Photo]) -> tuple[list[Photo], list[PhotoRemark]]:
    """The first photograph of every name, and a remark about those that are set aside."""
    first: dict[str, Photo] = {}
    pairs: list[str] = []
    for photo in photos:
        twin = first.setdefault(photo.name, photo)
        if twin is not photo:
            pairs += [twin.path, photo.path]
    return list(first.values()), [PhotoRemark(code=PhotoRemarkCode.DUPLICATE_NAME, photos=tuple(pairs))] if pairs else []


def _without_strays(photos: list[Photo]) -> tuple[list[Photo], list[PhotoRemark]]:
    """Photographs without the GPS positions that lie far from all others: a receiver that had no fix yet, or a photograph of
    another place. Where half of them are strays, either half may be right, and all positions are kept."""
    tagged = [photo for photo in photos if photo.longitude is not None]
    if len(tagged) < _FEWEST_TO_JUDGE:
        return photos, []
    degrees = np.array([(photo.longitude, photo.latitude) for photo in tagged])
    middle = np.median(degrees, axis=0)
    # Across the date line the difference of two longitudes of neighbours is nearly 360 degrees.
    east = (degrees[:, 0] - middle[0] + 180.0) % 360.0 - 180.0
    km = _KM_PER_DEGREE * np.hypot(east * np.cos(np.radians(middle[1])), degrees[:, 1] - middle[1])
    _refuse_two_places(tagged, degrees)
    far = km > max(_STRAY_KM, _STRAY_SHARE * float(np.median(km)))
    strays = {tagged[i].name: float(km[i]) for i in np.flatnonzero(far)} if 2 * far.sum() < len(tagged) else {}
    nowhere = {"longitude": None, "latitude": None}
    kept = [photo.model_copy(update=nowhere) if photo.name in strays else photo for photo in photos]
    return kept, (
        [PhotoRemark(code=PhotoRemarkCode.STRAY_POSITION, photos=tuple(strays), distance_km=min(strays.values()))] if strays else []
    )


def _refuse_two_places(tagged: list[Photo], degrees: np.ndarray) -> None:
    """Raises PhotoError where as many photographs lie on one side of the Earth as on another, so that no map holds them."""
    first = np.abs((degrees[:, 0] - degrees[0, 0] + 180.0) % 360.0 - 180.0) + np.abs(degrees[:, 1] - degrees[0, 1]) < _ONE_COUNTRY
    if 2 * first.sum() != len(tagged):
        return
    places = [
        f"{some_of([tagged[i].name for i in np.flatnonzero(own)], 4)} at longitude {degrees[own][0, 0]:.2f}, latitude "
        f"{degrees[own][0, 1]:.2f}"
        for own in (first, ~first)
    ]
    raise PhotoError(
        f"The GPS tags put half of the photographs elsewhere: {places[0]}, and {places[1]}. East and west, or north and south, may "
        "be exchanged in one half: give the positions in a file, or take one half out."
    )


def _far_apart(photos: list[Photo]) -> list[PhotoRemark]:
    """A remark about the photographs that lie too far from most others to be one block with them."""
    placed = [photo for photo in photos if photo.position is not None]
    xy = np.array([photo.position[:2] for photo in placed if photo.position]).reshape(-1, 2)
    if len(placed) < 2:
        return []
    some = xy[:: max(len(xy) // _SAMPLE, 1)]
    bases = [np.partition(np.linalg.norm(xy - place, axis=1), 1)[1] for place in some]
    apart = float(np.clip(_APART_BASES * np.median(bases), *_APART))
    group = _groups(np.floor(xy / apart).astype(np.int64))
    others = np.flatnonzero(group != np.bincount(group).argmax())
    if not len(others):
        return []
    main = np.delete(xy, others, axis=0)
    gap = min(float(np.linalg.norm(main - place, axis=1).min()) for place in xy[others])
    names = tuple(placed[i].name for i in others)
    return [PhotoRemark(code=PhotoRemarkCode.POSITIONS_FAR_APART, photos=names, distance_km=gap / 1000.0)]


def _groups(cells: np.ndarray) -> np.ndarray:
    """Numbers (n,) of the groups of cells (n, 2) that touch each other, also at corners."""
    # By cells and not by pairs of photographs, of which ten thousand would have fifty million.
    open_, group, number = {tuple(cell) for cell in cells.tolist()}, {}, 0
    while open_:
        waiting = [open_.pop()]
        while waiting:
            col, row = waiting.pop()
            group[col, row] = number
            near = {(col + i, row + j) for i in (-1, 0, 1) for j in (-1, 0, 1)} & open_
            open_ -= near
            waiting += near
        number += 1
    return np.array([group[tuple(cell)] for cell in cells.tolist()], np.int64)


def _camera_name(header: Header, orientation: int) -> str:
    make, model = tag_text(header.tags, "Make"), tag_text(header.tags, "Model")
    # Canon and Nikon repeat the maker in the model, others do not.
    maker = "" if model.upper().startswith(make.upper()) else make
    focal = exif.positive(header.tags, "FocalLength")
    # The size is that of the file, so that a camera held upright (quarter turn by the flag alone) remains the same camera.
    zoom, band = zoom_of(header.tags), band_of(header.tags)
    words = [maker, model, f"{focal:g} mm" if focal else "", f"zoom {zoom:g}" if zoom != 1.0 else "", band or ""]
    words.append(f"{header.width} x {header.height}")
    if orientation not in (1, *QUARTER_TURNS):
        # A half turn or a mirror image moves the principal point and changes the sign of the decentring terms.
        words.append(f"turned {orientation}")
    return " ".join(word for word in words if word)


def _with_sensors(photos: list[Photo]) -> list[Photo]:
    """Photographs whose pixels were rotated in the file, and which EXIF rotates back, with the camera of the unrotated ones."""
    unrotated = {photo.camera for photo in photos if photo.exif_orientation == 1}
    found = []
    for photo in photos:
        upright_word = _swapped(photo)
        own = photo.exif_orientation in QUARTER_TURNS and photo.camera not in unrotated and upright_word in unrotated
        # A calibration in the tags is that of the file as the camera wrote it, not as it was turned.
        found.append(photo.model_copy(update={"camera": upright_word, "as_taken": True, "factory": None}) if own else photo)
    return found


def _swapped(photo: Photo) -> str:
    """The name of the camera with width and height exchanged."""
    words, _, height = photo.camera.rpartition(" x ")
    start, _, width = words.rpartition(" ")
    return " ".join(word for word in (start, f"{height} x {width}") if word)


def _rotated_without_flag(photos: list[Photo]) -> list[PhotoRemark]:
    """A remark about photographs that a program rotated by a quarter turn without a flag, where more of their camera are not."""
    count = Counter(photo.camera for photo in photos)
    # Without a focal length the name is a mere size, and two sizes of unknown origin say nothing about a rotation.
    names = [
        photo.name
        for photo in photos
        if photo.focal_mm and photo.exif_orientation == 1 and 0 < count[photo.camera] < count[_swapped(photo)]
    ]
    return [PhotoRemark(code=PhotoRemarkCode.ROTATED_WITHOUT_FLAG, photos=tuple(names))] if names else []


def _about_tags(headers: tuple[Header, ...], photos: list[Photo], positions: Positions) -> Iterator[PhotoRemark]:
    """Remarks about tags that cannot be read, and about GPS tags that are to be used and have no possible altitude."""
    if damaged := tuple(photo_from_header(header).name for header in headers if header.damaged_tags):
        yield PhotoRemark(code=PhotoRemarkCode.DAMAGED_TAGS, photos=damaged)
    low = tuple(photo.name for photo in photos if photo.longitude is not None and photo.altitude is None)
    if low and positions.kind == "exif":
        yield PhotoRemark(code=PhotoRemarkCode.NO_ALTITUDE, photos=low)


def _pixel_um(header: Header) -> float | None:
    """Side of a pixel in micrometres."""
    longer_side = max(header.width, header.height)
    # The maker's sensor width takes precedence: many cameras write wrong focal plane tags (of the preview, or in a wrong unit).
    width = sensor_width_mm(tag_text(header.tags, "Model"))
    return 1000.0 * width / longer_side if width else exif.focal_plane_pixel_um(header.tags, longer_side)


def _placed_by_gps(photos: list[Photo], crs: str, sigma: dict[str, Sigma]) -> list[Photo]:
    tagged = {p.name: (p.longitude, p.latitude, p.altitude) for p in photos if p.longitude is not None and p.altitude is not None}
    if not tagged:
        return photos
    # In one call: setting up a transformation costs more than a thousand points.
    geographic = np.array(list(tagged.values()), dtype=float)
    xy = ground_coordinates(crs, geographic[:, :2])
    places = {name: (float(x), float(y), float(height)) for name, (x, y), height in zip(tagged, xy, geographic[:, 2], strict=True)}
    return [_placed_at(photo, places.get(photo.name), sigma[photo.path]) for photo in photos]


def _placed_at(photo: Photo, xyz: tuple[float, float, float] | None, sigma: tuple[float, float, float]) -> Photo:
    return photo if xyz is None else photo.model_copy(update={"position": xyz, "position_sigma": sigma})
