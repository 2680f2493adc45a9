"""What is said of the tags of a block: one remark of a kind, whatever the number of photographs."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator

from orthomill.schemas.photo import Header, Photo, PhotoRemark, PhotoRemarkCode
from orthomill.schemas.project import Positions
from orthomill.tasks.photos.tags.fixes import BY_CODE, position_sigma
from orthomill.tasks.photos.tags.heights import height_of
from orthomill.tasks.photos.tags.instruments import several_serials

_FOUND = {"fixed": "fixed", "float": "float", "single": "without corrections", "none": "without RTK", None: "of unknown precision"}
_STATED = "of stated accuracy"


def tag_remarks(headers: tuple[Header, ...], photos: list[Photo], positions: Positions) -> Iterator[PhotoRemark]:
    """Remarks about positions, heights and cameras by tags; about positions only where they come from the tags."""
    if positions.kind == "exif":
        tags = {header.path: header.tags for header in headers}
        yield from _precision([photo for photo in photos if photo.position], tags, positions.sigma_plan is None)
        yield from _heights([photo for photo in photos if photo.altitude is not None], tags)
    calibrated = [photo for photo in photos if photo.factory and photo.factory.kind == "calibrated"]
    yield from _of(PhotoRemarkCode.FACTORY_CAMERA, calibrated)
    yield from _of(PhotoRemarkCode.MASKED, [photo for photo in photos if photo.masked])
    yield from _of(PhotoRemarkCode.DEWARPED, [photo for photo in photos if photo.dewarped])
    zoomed = [photo for photo in photos if photo.zoom != 1.0]
    zooms = sorted({photo.zoom for photo in zoomed})
    yield from _of(PhotoRemarkCode.DIGITAL_ZOOM, zoomed, (f"{zoom:g}" for zoom in zooms[:4]))
    if serials := several_serials(photos):
        yield PhotoRemark(code=PhotoRemarkCode.SEVERAL_SERIALS, photos=serials)


def _precision(photos: list[Photo], tags: dict[str, dict[str, str]], own: bool) -> Iterator[PhotoRemark]:
    """How the positions were found, where any of them tells more than that it is one."""
    words = [_found(photo, tags[photo.path]) for photo in photos]
    if own and set(words) - {_FOUND["none"], _FOUND[None]}:
        count = Counter(words)
        yield from _of(PhotoRemarkCode.OWN_PRECISION, photos, (f"{count[word]} {word}" for word in dict.fromkeys(words)))


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


def _of(code: PhotoRemarkCode, photos: list[Photo], words: Iterable[str] = ()) -> Iterator[PhotoRemark]:
    if photos:
        yield PhotoRemark(code=code, photos=tuple(photo.name for photo in photos), words=tuple(words))
