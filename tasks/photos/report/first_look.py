"""What the tags of photographs tell before anything is computed: cameras, positions, heights, and what is set aside.

Everything is said of the photographs as the stage will use them, so that `init` and a run cannot disagree.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import suppress
from itertools import chain

from orthomill.schemas.errors import WorkflowError, some_of
from orthomill.schemas.findings.flight_findings import FirstLook, PositionsBeside
from orthomill.schemas.photo import Header, Photo, PhotoRemarkCode, Photos
from orthomill.schemas.project import ANY_CRS, NoPositions, Positions, PositionsFromExif, PositionsFromFile
from orthomill.tasks.photos.index import Limits, index_photos
from orthomill.tasks.photos.report.photos_report import remark_sentence
from orthomill.tasks.photos.rolling_shutter import rolling_shutter_sentences
from orthomill.tasks.photos.tags.fixes import BY_CODE

_FIX = {
    "fixed": "with a fixed solution",
    "float": "with a float solution",
    "single": "without corrections",
    "none": "without a fix",
}
_HEIGHT = {
    "ellipsoidal": "above the ellipsoid",
    "sea_level": "above the sea",
    "barometric": "barometric, with an unknown constant that all heights of the products share",
    "relative": "above the place of take-off",
}

_SAID = (PhotoRemarkCode.OWN_PRECISION, PhotoRemarkCode.FACTORY_CAMERA)
"""remarks that say less than the lines of cameras and positions here"""


def first_look(headers: tuple[Header, ...], crs: str | None, beside: PositionsBeside | None = None) -> FirstLook:
    """The findings in photographs and in the positions `beside` them. Without a CRS nothing is placed. Raises OrthomillError for
    photographs that no run can use."""
    photos = _placed_photos(headers, crs, beside)
    told = _listed(photos, beside) if beside and photos.positions_read else _positions(photos)
    findings = chain(
        _cameras(photos),
        told,
        _heights(photos),
        (remark_sentence(remark) for remark in photos.remarks if remark.code not in _SAID),
        rolling_shutter_sentences(photos.photos),
    )
    bands = (remark.words[-1] for remark in photos.remarks if remark.code is PhotoRemarkCode.OTHER_BANDS)
    return FirstLook(
        findings=tuple(findings),
        used=tuple(photo.path for photo in photos.photos),
        band=next(bands, None),
        ellipsoidal=_ellipsoidal(photos),
    )


def _placed_photos(headers: tuple[Header, ...], crs: str | None, beside: PositionsBeside | None) -> Photos:
    limits = Limits(float("inf"))
    if crs and beside:
        # A file that cannot be used is refused by the run, whose workflow names it: the tags are looked at meanwhile.
        with suppress(WorkflowError):
            return index_photos(headers, crs, PositionsFromFile(kind="file", path=beside.path), limits, beside.text).photos
    positions: Positions = PositionsFromExif(kind="exif") if crs else NoPositions(kind="none")
    return index_photos(headers, crs or ANY_CRS, positions, limits).photos


def _listed(photos: Photos, beside: PositionsBeside) -> Iterator[str]:
    """What the file of positions says."""
    placed = [photo for photo in photos.photos if photo.position is not None]
    fixes = Counter(photo.fix for photo in placed if photo.fix)
    said = [f"{number} {_FIX[fix]}" for fix, number in fixes.most_common()]
    sigmas = [photo.position_sigma for photo in placed if photo.position_sigma]
    known = f"standard errors {_span([max(s[:2]) for s in sigmas])} m in plan, {_span([s[2] for s in sigmas])} m in height"
    assumed = photos.positions_read is not None and photos.positions_read.defaults is not None
    words = "; ".join([*([", ".join(said)] if said else []), known + " (assumed, for the file states none)" * assumed])
    yield f"Positions: in {beside.path}, of {len(placed)} of {len(photos.photos)}; {words}."


def _ellipsoidal(photos: Photos) -> bool:
    """Whether tags say of all heights that they are above the ellipsoid."""
    kinds = {photo.height_kind for photo in photos.photos if photo.position is not None}
    return kinds == {"ellipsoidal"}


def _cameras(photos: Photos) -> Iterator[str]:
    """A line for all cameras of which the same is known."""
    count = Counter(photo.camera for photo in photos.photos)
    first = {photo.camera: photo for photo in reversed(photos.photos)}
    alike = defaultdict(list)
    for camera, number in count.most_common():
        alike[_interior(first[camera])].append(f"{camera} ({number})")
    for interior, cameras in alike.items():
        yield f"Camera{'s' * (len(cameras) > 1)}: {some_of(cameras, 4)}; {interior}."


def _interior(photo: Photo) -> str:
    if photo.factory and photo.factory.kind == "calibrated":
        return f"the tags hold its factory calibration, c {photo.factory.c:.1f} px"
    if photo.factory:
        return f"the tags hold its design, c {photo.factory.c:.1f} px, and no calibration"
    if photo.focal_mm or photo.focal_35mm:
        return "no factory calibration in the tags: c follows from the focal length, and the block refines it"
    return "no focal length in the tags: c is guessed, and the block refines it"


def _positions(photos: Photos) -> Iterator[str]:
    placed = [photo for photo in photos.photos if photo.longitude is not None]
    if not placed:
        yield "Positions: none in the tags."
        return
    fixes = Counter(photo.fix for photo in placed if photo.fix)
    errors = _errors(placed)
    said = [f"{number} {_FIX[fix]}" for fix, number in fixes.most_common()]
    known = "; ".join([", ".join(said), *errors] if said else errors) or "the tags do not say how good they are"
    yield f"Positions: in the tags of {len(placed)} of {len(photos.photos)}; {known}."


def _errors(placed: list[Photo]) -> list[str]:
    """The range of standard errors where tags state them."""
    stated = [photo.position_sigma for photo in placed if photo.position_sigma and (photo.fix or photo.position_sigma != BY_CODE)]
    if not stated:
        return []
    plan, height = [max(sigma[:2]) for sigma in stated], [sigma[2] for sigma in stated]
    return [f"standard errors {_span(plan)} m in plan, {_span(height)} m in height"]


def _span(values: list[float]) -> str:
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return low if low == high else f"{low} to {high}"


def _heights(photos: Photos) -> Iterator[str]:
    known = [photo for photo in photos.photos if photo.altitude is not None]
    if not known:
        return
    kinds = Counter(photo.height_kind for photo in known if photo.height_kind)
    said = ", ".join(f"{number} {_HEIGHT[kind]}" for kind, number in kinds.most_common())
    unknown = "the tags do not say what they refer to, so that all heights of the products may be off by tens of metres"
    yield f"Heights of the positions: {said or unknown}."
