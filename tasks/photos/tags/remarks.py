"""What is said of the tags of a block: one remark of a kind, whatever the number of photographs."""

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from pathlib import PurePath
from statistics import median

from orthomill.schemas.photo import Header, Photo, PhotoRemark, PhotoRemarkCode, tag_text
from orthomill.schemas.project import Positions
from orthomill.tasks.photos import exif
from orthomill.tasks.photos.tags.fixes import BY_CODE, position_sigma
from orthomill.tasks.photos.tags.heights import height_of
from orthomill.tasks.photos.tags.instruments import several_serials
from orthomill.tasks.photos.tags.places import places_apart
from orthomill.tasks.photos.tags.repeated_places import LEAST, repetitions

_FOUND = {"fixed": "fixed", "float": "float", "single": "without corrections", "none": "without RTK", None: "of unknown precision"}
_STATED = "of stated accuracy"
_NO_FIX = 1.0
"""m: no standard error of a fixed solution of carrier phases is as large"""
_ELSEWHERE = 50.0
"""m in plan: two tags that are farther apart are not one place rounded or taken a moment later"""
_OTHER_EQUIVALENT = 1.1
"""35 mm equivalents are rounded to whole millimetres; beyond this ratio they are different ones"""
_OF_SATELLITES = re.compile(r"WGS|ETRS|NAD.?83|GDA|ITRF|JGD|CGCS|SIRGAS|GRS|unknown|undefined|none", re.IGNORECASE)
"""datums within metres of WGS 84, and words for none"""
_KINDS = {
    "ellipsoidal": "above the ellipsoid",
    "sea_level": "above the sea",
    "barometric": "barometric",
    "relative": "above the place of take-off",
}
ON_GROUND, IN_THE_AIR = 2.5, 15.0
"""m above the take-off: held in the hand or standing, with the noise of a barometer; and in flight"""
SAME_SHAPE = 0.01
"""Part by which the sides of a reduced photograph may be reduced differently: they are rounded to pixels."""


def tag_remarks(headers: tuple[Header, ...], photos: list[Photo], positions: Positions) -> Iterator[PhotoRemark]:
    """Remarks about positions, heights and cameras by tags; about positions only where they come from the tags."""
    if positions.kind == "exif":
        tags = {header.path: header.tags for header in headers}
        yield from _precision([photo for photo in photos if photo.position], tags, positions.sigma_plan is None)
        yield from _heights([photo for photo in photos if photo.altitude is not None], tags)
        yield from _impossible(photos, tags)
        yield from _of_other_places(photos, tags)
        yield from _same_place(photos)
    calibrated = [photo for photo in photos if photo.factory and photo.factory.kind == "calibrated"]
    yield from _of(PhotoRemarkCode.FACTORY_CAMERA, calibrated)
    yield from _of(PhotoRemarkCode.ON_THE_GROUND, _on_the_ground(photos))
    yield from _other_equivalents(photos)
    yield from _of(PhotoRemarkCode.MASKED, [photo for photo in photos if photo.masked and not photo.mask])
    yield from _of(PhotoRemarkCode.DEWARPED, [photo for photo in photos if photo.dewarped])
    zoomed = [photo for photo in photos if photo.zoom != 1.0]
    zooms = sorted({photo.zoom for photo in zoomed})
    yield from _of(PhotoRemarkCode.DIGITAL_ZOOM, zoomed, (f"{zoom:g}" for zoom in zooms[:4]))
    if serials := several_serials(photos):
        yield PhotoRemark(code=PhotoRemarkCode.SEVERAL_SERIALS, photos=serials)


def _on_the_ground(photos: list[Photo]) -> list[Photo]:
    """The few photographs that were taken at the height of the take-off, in a flight well above it."""
    known = [photo for photo in photos if photo.relative_height is not None]
    low = [photo for photo in known if abs(photo.relative_height or 0.0) < ON_GROUND]
    high = len(known) > 2 * len(low) and median(photo.relative_height or 0.0 for photo in known) > IN_THE_AIR
    return low if high else []


def file_remarks(headers: tuple[Header, ...]) -> Iterator[PhotoRemark]:
    """Remarks about files that hold something else than their tags say, or tags that do not say all."""
    cut = {header.path: size for header in headers if (size := _size_before_cut(header))}
    if cut:
        sizes = dict.fromkeys(f"{width} x {height} px" for width, height in cut.values())
        yield PhotoRemark(code=PhotoRemarkCode.CUT, photos=_stems(cut), words=tuple(sizes))
    lacking = {header.path: words for header in headers if (words := _lacking_hemispheres(header.tags))}
    if lacking:
        both = dict.fromkeys(word for own in lacking.values() for word in own)
        yield PhotoRemark(code=PhotoRemarkCode.NO_HEMISPHERE, photos=_stems(lacking), words=tuple(both))
    if several := {header.path: header.pictures for header in headers if header.pictures > 1}:
        counts = sorted(set(several.values()))
        yield PhotoRemark(code=PhotoRemarkCode.SEVERAL_PICTURES, photos=_stems(several), words=tuple(map(str, counts)))


def _stems(paths: Iterable[str]) -> tuple[str, ...]:
    return tuple(PurePath(path).stem for path in paths)


def _size_before_cut(header: Header) -> tuple[int, int] | None:
    """Width and height by the tags, where those of the file have another ratio and are smaller; turned files are not cut."""
    width, height = exif.positive(header.tags, "PixelXDimension"), exif.positive(header.tags, "PixelYDimension")
    if width is None or height is None:
        return None
    short, long = sorted((header.width, header.height))
    shorter, longer = sorted((width, height))
    same = abs((longer / shorter) / (long / short) - 1.0) <= SAME_SHAPE
    # Tags of a preview, or of a part that was joined with others to a larger picture, tell nothing of this one.
    return None if same or longer < long or shorter < short else (round(width), round(height))


def _lacking_hemispheres(tags: Mapping[str, str]) -> tuple[str, ...]:
    """Which directions the GPS tags leave open, where they hold a place by unsigned numbers."""
    place = exif.longitude_latitude(tags)
    if place is None:
        return ()
    pairs = (("GPSLongitude", "east or west", place[0]), ("GPSLatitude", "north or south", place[1]))
    return tuple(words for name, words, value in pairs if value > 0 and not tag_text(tags, f"{name}Ref"))


def _precision(photos: list[Photo], tags: dict[str, dict[str, str]], own: bool) -> Iterator[PhotoRemark]:
    """How the positions were found, where any of them tells more than that it is one."""
    words = [_found(photo, tags[photo.path]) for photo in photos]
    if own and set(words) - {_FOUND["none"], _FOUND[None]}:
        count = Counter(words)
        yield from _of(PhotoRemarkCode.OWN_PRECISION, photos, (f"{count[word]} {word}" for word in dict.fromkeys(words)))
    sigma = {photo.name: position_sigma(tags[photo.path]) for photo in photos if photo.fix == "fixed"}
    contradicted = [photo for photo in photos if own and max(sigma.get(photo.name, (0.0,))) > _NO_FIX]
    largest = [max(sigma[photo.name][i] for photo in contradicted) for i in (0, 2)] if contradicted else []
    yield from _of(PhotoRemarkCode.FIX_CONTRADICTED, contradicted, (f"{value:g} m" for value in largest))


def _found(photo: Photo, tags: dict[str, str]) -> str:
    return _STATED if photo.fix is None and position_sigma(tags) != BY_CODE else _FOUND[photo.fix]


def _heights(photos: list[Photo], tags: dict[str, dict[str, str]]) -> Iterator[PhotoRemark]:
    by_code = defaultdict(list)
    for photo in photos:
        if remark := height_of(tags[photo.path]).remark:
            by_code[remark].append(photo)
    for code, own in by_code.items():
        yield from _of(code, own)
    yield from _of(PhotoRemarkCode.RELATIVE_HEIGHTS, [photo for photo in photos if photo.height_kind == "relative"])
    kinds = Counter(photo.height_kind for photo in photos if photo.height_kind and photo.position)
    if len(kinds) > 1:
        words = (f"{count} {_KINDS[kind]}" for kind, count in kinds.most_common())
        yield from _of(PhotoRemarkCode.HEIGHT_KINDS_MIXED, [photo for photo in photos if photo.height_kind], words)


def _impossible(photos: list[Photo], tags: dict[str, dict[str, str]]) -> Iterator[PhotoRemark]:
    """Photographs whose degrees are out of range, and whether they would be in range exchanged."""
    written = {photo.name: exif.written_place(tags[photo.path]) for photo in photos if photo.longitude is None}
    places = {name: place for name, place in written.items() if place and (abs(place[0]) > 180 or abs(place[1]) > 90)}
    exchanged = all(abs(longitude) <= 90 and abs(latitude) <= 180 for longitude, latitude in places.values())
    words = [", with latitude and longitude exchanged"] if exchanged else []
    yield from _of(PhotoRemarkCode.PLACE_IMPOSSIBLE, [photo for photo in photos if photo.name in places], words)


def _of_other_places(photos: list[Photo], tags: dict[str, dict[str, str]]) -> Iterator[PhotoRemark]:
    """Photographs whose tags give two places, or name a datum of maps."""
    apart = {photo.name: places_apart(tags[photo.path]) for photo in photos if photo.position}
    differ = [photo for photo in photos if apart.get(photo.name, 0.0) > _ELSEWHERE]
    if differ:
        yield from _of(PhotoRemarkCode.PLACES_DIFFER, differ, [f"{max(apart.values()):.0f} m"])
    datum = {photo.name: tag_text(tags[photo.path], "GPSMapDatum") for photo in photos if photo.position}
    named = {name: text for name, text in datum.items() if text.strip() and not _OF_SATELLITES.search(text)}
    yield from _of(PhotoRemarkCode.MAP_DATUM, [photo for photo in photos if photo.name in named], sorted(set(named.values()))[:3])


def _other_equivalents(photos: list[Photo]) -> Iterator[PhotoRemark]:
    """Photographs of one camera and zoom whose 35 mm equivalent is not that of most of them."""
    for camera in dict.fromkeys(photo.camera for photo in photos):
        own = [photo for photo in photos if photo.camera == camera and photo.focal_35mm]
        count = Counter(photo.focal_35mm or 0.0 for photo in own)
        if len(count) > 1 and max(count) > _OTHER_EQUIVALENT * min(count):
            usual = count.most_common(1)[0][0]
            odd = [photo for photo in own if photo.focal_35mm != usual]
            yield from _of(PhotoRemarkCode.EQUIVALENTS_DIFFER, odd, (f"{value:g}" for value in sorted(count)[:4]))


def _same_place(photos: list[Photo]) -> Iterator[PhotoRemark]:
    """Photographs that share their place to the last digit, in a block of several places."""
    times = repetitions([photo for photo in photos if photo.position])
    repeated = [photo for photo in photos if times.get(photo.path, 1) > 1]
    if len({(photo.longitude, photo.latitude) for photo in photos if photo.position}) >= LEAST:
        yield from _of(PhotoRemarkCode.SAME_PLACE, repeated)


def _of(code: PhotoRemarkCode, photos: list[Photo], words: Iterable[str] = ()) -> Iterator[PhotoRemark]:
    if photos:
        yield PhotoRemark(code=code, photos=tuple(photo.name for photo in photos), words=tuple(words))
