"""The report on the photographs: number, positions, cameras, exposure, and what is missing."""

from collections import Counter
from collections.abc import Iterator

from orthomill.schemas.errors import some_of
from orthomill.schemas.photo import Photo, PhotoRemark, PhotoRemarkCode, Photos, photo_raster
from orthomill.schemas.stage_report import Answer, Chart, Figure, Grid, Picture, StageReport, Topic, Verdict
from orthomill.tasks.photos.bases import median_base
from orthomill.tasks.photos.pixels import Exposure
from orthomill.tasks.photos.report.position_sentences import assumptions, what_was_read
from orthomill.tasks.photos.rolling_shutter import rolling_shutter_sentences
from orthomill.tasks.photos.scans import Scans
from orthomill.tasks.photos.sorting.set_aside import SET_ASIDE, set_aside_sentence

PICTURES = 6
# Shares of clipped pixels and a contrast from which on matching suffers visibly; measured on the coarsest level, where noise has
# been averaged away and only the scene's own contrast is left.
_MOST_CLIPPED, _LEAST_CONTRAST = 0.1, 0.03
_MOST_MASKED = 0.9
# Marks are measured to half a pixel or so; twice the pixel is more than careless measuring explains.
_WORST_FIT_PX = 2.0
# What was set aside may be what the user relies on.
_GRAVE = (
    PhotoRemarkCode.POSITIONS_FAR_APART,
    PhotoRemarkCode.STRAY_POSITION,
    PhotoRemarkCode.UNUSABLE_FILE,
    PhotoRemarkCode.DAMAGED_PICTURE,
    PhotoRemarkCode.NO_ALTITUDE,
    PhotoRemarkCode.NO_HEMISPHERE,
    PhotoRemarkCode.CUT,
    PhotoRemarkCode.DAMAGED_TAGS,
    PhotoRemarkCode.FIX_CONTRADICTED,
    PhotoRemarkCode.PLACE_IMPOSSIBLE,
    PhotoRemarkCode.PLACES_DIFFER,
    PhotoRemarkCode.HEIGHT_KINDS_MIXED,
    PhotoRemarkCode.FACTORY_CONTRADICTED,
)
# These say themselves that there are several cameras.
_APART = (PhotoRemarkCode.DIGITAL_ZOOM, PhotoRemarkCode.SEVERAL_SERIALS)
_SCAN_COLUMNS = (
    "photo",
    "marks",
    "sigma of a mark, micrometres",
    "sigma of a coordinate in the middle, micrometres",
    "sigma of a coordinate at the outermost mark, micrometres",
    "rotation of the scan, degrees",
    "pixel along rows, micrometres",
    "pixel along columns, micrometres",
)


_SENTENCES = {
    PhotoRemarkCode.OWN_PRECISION: "Positions by the tags: {words}; each has its own standard error.",
    PhotoRemarkCode.BELOW_SEA: (
        "EXIF says of {count} ({names}) that they were taken below the sea, other tags or the other photographs that they were "
        "not: their heights were taken as above it."
    ),
    PhotoRemarkCode.ALL_BELOW_SEA: (
        "EXIF says of {count} that they were taken below the sea, at {words}: some cameras write so by mistake. If the place is "
        "not below the sea, give the positions in a file."
    ),
    PhotoRemarkCode.HEIGHT_ABOVE_START: (
        "The GPS altitude of {count} ({names}) is their height above the take-off; the absolute height of the maker's own tags is "
        "used."
    ),
    PhotoRemarkCode.HEIGHTS_DIFFER: (
        "EXIF and the maker's own tags give different heights of {count} ({names}); those of EXIF are used. If these were not "
        "corrected afterwards, give the positions in a file."
    ),
    PhotoRemarkCode.RELATIVE_HEIGHTS: (
        "The only heights in the tags of {count} are those above the place of take-off: all heights of the products are too, "
        "unless control points say otherwise."
    ),
    PhotoRemarkCode.FACTORY_CAMERA: (
        "The tags of {count} hold the factory's calibration of the camera: the adjustment starts from it, and may move it."
    ),
    PhotoRemarkCode.MASKED: "What the alpha channel or mask of {count} ({names}) marks as transparent is not used.",
    PhotoRemarkCode.ON_THE_GROUND: (
        "Taken on the ground, by their heights above the take-off: {count} ({names}). Leave out what does not show the site from "
        "above."
    ),
    PhotoRemarkCode.CUT: (
        "Cut after they were taken: {count} ({names}), by the tags of {words} before. The focal length no longer tells the camera "
        "constant, nor where the principal point is: use the files as the camera wrote them, or give the camera."
    ),
    PhotoRemarkCode.NO_HEMISPHERE: (
        "The GPS tags of {count} ({names}) do not say whether they are {words}: east and north were taken. If that is wrong, give "
        "the positions in a file."
    ),
    PhotoRemarkCode.SEVERAL_PICTURES: ("Only the first picture is used of files that hold {words} of one size: {count} ({names})."),
    PhotoRemarkCode.MASK_FILES: "What is black in the masks of {count} ({names}) is not used.",
    PhotoRemarkCode.IDLE_MASK: (
        "Masks that are named like no photograph of the project mask nothing: {names}. Name them like the photographs: IMG_1.png "
        "or IMG_1_mask.png."
    ),
    PhotoRemarkCode.DEWARPED: "The lens distortion of {count} was removed in the camera.",
    PhotoRemarkCode.DIGITAL_ZOOM: (
        "{count} ({names}) were enlarged in the camera by digital zoom ({words} times) and have a camera of their own."
    ),
    PhotoRemarkCode.FIX_CONTRADICTED: (
        "The tags of {count} ({names}) tell a fixed solution of carrier phases and standard errors of {words}, which contradict "
        "each other: the standard errors were taken, as metres. If they are millimetres or wrong, state the true ones "
        "(positions > sigma_plan, sigma_height)."
    ),
    PhotoRemarkCode.PLACE_IMPOSSIBLE: (
        "The GPS tags of {count} ({names}) hold degrees that are nowhere on the Earth{words}: these positions are not used; give "
        "them in a file."
    ),
    PhotoRemarkCode.PLACES_DIFFER: (
        "EXIF and the maker's own tags give different places of {count} ({names}), up to {words} apart; those of EXIF are used. If "
        "these were not corrected afterwards, give the positions in a file."
    ),
    PhotoRemarkCode.MAP_DATUM: (
        "The GPS tags of {count} ({names}) name the datum {words}, which may lie hundreds of metres from WGS 84, as which they "
        "were taken. If the name is right, give the positions in a file with their system."
    ),
    PhotoRemarkCode.EQUIVALENTS_DIFFER: (
        "The 35 mm equivalents of photographs with one camera and one focal length differ ({words} mm; not as most: {count}, "
        "{names}), as a digital zoom without its tag makes them. Keep photographs of different zooms apart: they share one camera."
    ),
    PhotoRemarkCode.SAME_PLACE: (
        "By their GPS tags {count} ({names}) were taken at one and the same place, to the last digit: the receiver stood still, or "
        "repeated its last position. Together they weigh as one position; where photographs of a flight repeat a place that they "
        "have left, leave these positions out (a file of positions without them)."
    ),
    PhotoRemarkCode.HEIGHT_KINDS_MIXED: (
        "The heights of the photographs refer to different surfaces ({words}), which may be tens of metres apart: bring them to "
        "one of them in a file of positions, or give control points."
    ),
    PhotoRemarkCode.FACTORY_CONTRADICTED: (
        "The calibration in the tags of {count} ({names}) contradicts their focal length ({words} px): the focal length is "
        "used. Files that were reduced, and tags of another camera, look like that; if the camera is known, give it ('cameras')."
    ),
    PhotoRemarkCode.SEVERAL_SERIALS: (
        "Cameras of one model have different serial numbers, and each has its own interior orientation: {names}."
    ),
}

_JOINED = {PhotoRemarkCode.FACTORY_CONTRADICTED: " and ", PhotoRemarkCode.FIX_CONTRADICTED: " and "}
"""between the words of a remark"""


def photos_report(
    photos: Photos, scans: Scans, exposures: tuple[Exposure, ...], positions_kind: str, cameras_kind: str = "exif"
) -> StageReport:
    """The report of the stage. exposures: in the order of the photographs."""
    read = "1 photograph is" if len(photos.photos) == 1 else f"All {len(photos.photos)} photographs are"
    return StageReport(
        verdict=Verdict(level="good", sentence=f"{read} readable, of {_cameras(photos)}."),
        answers=(Answer(topic=Topic.PHOTOGRAPHS, text=f"{len(photos.photos)} read"),),
        figures=_figures(photos),
        grids=(_photo_grid(photos, exposures), _camera_grid(photos), *((_scan_grid(scans),) if scans.scans else ())),
        charts=_charts(photos),
        pictures=_pictures(photos),
        warnings=(*header_warnings(photos, positions_kind, cameras_kind), *_exposure_warnings(exposures), *_scan_warnings(scans)),
        losses=tuple(_exposure_warnings(exposures)),
        doubts=tuple(remark_sentence(remark) for remark in photos.remarks if remark.code in _GRAVE),
    )


def photo_remarks(photos: Photos, positions_kind: str, cameras_kind: str) -> Iterator[str]:
    """What is noticed about files, positions and cameras before anything runs, and what was read."""
    yield from header_warnings(photos, positions_kind, cameras_kind)
    yield from what_was_read(photos)


def _cameras(photos: Photos) -> str:
    count = len({photo.camera for photo in photos.photos})
    return "one camera" if count == 1 else f"{count} cameras, focal lengths or image sizes"


def remark_sentence(remark: PhotoRemark) -> str:
    """What a remark of the index says to a person."""
    if remark.code is PhotoRemarkCode.DUPLICATE_NAME:
        return _same_names(remark.photos)
    if remark.code is PhotoRemarkCode.STRAY_POSITION:
        if len(remark.photos) > 1:
            return (
                f"The GPS tags of {_count(remark.photos)} ({some_of(remark.photos)}) lie {remark.distance_km or 0.0:.0f} km or "
                "more from the others and are not used; the photographs themselves are. Leave them out if they show another place."
            )
        return (
            f"The GPS tag of {remark.photos[0]} lies {remark.distance_km or 0.0:.0f} km from the other photographs and is not "
            "used; the photograph itself is."
        )
    if remark.code is PhotoRemarkCode.POSITIONS_FAR_APART:
        return (
            f"The positions of {some_of(remark.photos)} lie {remark.distance_km or 0.0:.0f} km or more from all others, too far "
            "for one block; correct the positions, or make two projects of them."
        )
    if remark.code is PhotoRemarkCode.POSITION_WITHOUT_PHOTOGRAPH:
        return (
            f"The positions file has lines for photographs that the project does not have, which are skipped: "
            f"{some_of(remark.photos)}."
        )
    if remark.code is PhotoRemarkCode.DAMAGED_TAGS:
        return (
            f"{some_of(remark.photos)}: the EXIF tags are damaged and not used; copy the files again from the camera, or state "
            "camera and positions in the workflow."
        )
    if remark.code is PhotoRemarkCode.NO_ALTITUDE:
        return (
            f"{some_of(remark.photos)}: the GPS tags hold no possible altitude, so that these positions are not used; give "
            "positions in a file if the block depends on them."
        )
    if remark.code in _SENTENCES:
        return _SENTENCES[remark.code].format(
            names=some_of(remark.photos), count=_count(remark.photos), words=_JOINED.get(remark.code, ", ").join(remark.words)
        )
    if remark.code in SET_ASIDE:
        return set_aside_sentence(remark)
    return (
        f"{some_of(remark.photos)}: the size of the other photographs of this camera with width and height exchanged, and no EXIF "
        "flag that explains it. A program rotated the pixels; in which direction is unknown, so the interior orientation cannot be "
        "shared with the others and is adjusted separately. Use the files as the camera wrote them."
    )


def _same_names(paths: tuple[str, ...]) -> str:
    """paths: of each file that is used, followed by that of the one that is set aside."""
    if len(paths) > 2:
        return (
            f"{len(paths) // 2} files have the names of others, by which photographs are identified, and were set aside: "
            f"{some_of(paths[1::2], 3)}. Rename those that are other photographs."
        )
    used, set_aside = paths
    return (
        f"{used} and {set_aside} have the same name {used.rpartition('/')[2].rpartition('.')[0]}, by which photographs are "
        "identified: the second was set aside; rename it if it is another photograph."
    )


def _count(photos: tuple[str, ...]) -> str:
    return f"{len(photos)} photograph{'s' if len(photos) > 1 else ''}"


def _scan_grid(scans: Scans) -> Grid:
    rows = tuple(
        (one.photo, one.marks, one.rms_um, *(one.sigma_um or (None, None)), one.turn_deg, one.col_um, one.row_um)
        for one in scans.scans
    )
    return Grid(
        title="Scans",
        columns=_SCAN_COLUMNS,
        rows=rows,
        note="The affine transformation from the scan to the calibrated marks; three marks fit without residuals. Its errors are "
        "common to all points of one photograph and are partly absorbed by its orientation; the standard errors of the block do "
        "not include them.",
    )


def _scan_warnings(scans: Scans) -> Iterator[str]:
    for one in scans.scans:
        for mark, off in one.wrong.items():
            yield (
                f"The fiducial mark {mark} of {one.photo} lies {off:.1f} px from where the others place it and was rejected: it "
                "was measured wrongly or exchanged with another."
            )
    if any(one.marks for one in scans.scans) and not scans.cut:
        yield (
            "The scans are used out to their outermost fiducial marks. If these lie in the margin of the film, give picture_mm, "
            "the width and height of the exposed picture; otherwise the margin enters the surface and the orthoimage."
        )
    # Where no marks were measured there is no standard error, and nothing to judge.
    fits = [(one.photo, one.rms_um or 0.0, max(one.col_um or 0.0, one.row_um or 0.0)) for one in scans.scans]
    bad = [f"{photo} ({rms:.0f})" for photo, rms, pixel in fits if rms > _WORST_FIT_PX * pixel]
    if bad:
        yield (
            f"The fiducial marks of {', '.join(bad[:8])} fit an affine transformation worse than two pixels (micrometres in "
            "brackets): a mark was measured wrongly or exchanged, or the film is deformed irregularly. Five marks or more would "
            "show which."
        )
    mirrored = [one.photo for one in scans.scans if one.mirrored]
    if mirrored:
        yield (
            f"{_named(mirrored)} mirrored with respect to the calibrated marks: correct only where film was scanned from the back; "
            "otherwise let y of the calibrated marks count upwards and check the names of the marks."
        )


def _figures(photos: Photos) -> tuple[Figure, ...]:
    megapixels = sum(photo.width * photo.height for photo in photos.photos) / 1e6
    placed = sum(photo.position is not None for photo in photos.photos)
    base = median_base(photos)
    return (
        Figure(name="photographs", value=len(photos.photos), sentence="Photographs read.", headline=True),
        Figure(name="megapixels", value=round(megapixels, 1), unit="megapixels", sentence="Total number of pixels."),
        Figure(
            name="cameras",
            value=len({photo.camera for photo in photos.photos}),
            sentence="Different cameras, focal lengths or image sizes.",
        ),
        Figure(name="with_position", value=placed, sentence="Photographs whose projection centre is known before the adjustment."),
        Figure(name="nearest_distance", value=base, unit="m", sentence="Median distance between nearest projection centres."),
    )


def _photo_grid(photos: Photos, exposures: tuple[Exposure, ...]) -> Grid:
    rows = tuple(
        (
            photo.name,
            f"{photo.width} x {photo.height}",
            _kind(photo),
            photo.focal_mm,
            photo.time,
            *_xyz(photo),
            round(100 * exposure.mean, 1),
            round(100 * exposure.contrast, 1),
        )
        for photo, exposure in zip(photos.photos, exposures, strict=True)
    )
    columns = ("photo", "pixels", "kind", "focal length (mm)", "taken", "X (m)", "Y (m)", "Z (m)", "mean grey (%)", "contrast (%)")
    return Grid(
        title="Photographs",
        columns=columns,
        rows=rows,
        note="Grey values in per cent of the full range, measured on the coarsest pyramid level.",
    )


def _kind(photo: Photo) -> str:
    rotated = "" if photo.exif_orientation == 1 else f", rotated upright (EXIF orientation {photo.exif_orientation})"
    return f"{'grey' if photo.bands == 1 else 'RGB'}, {8 if photo.dtype == 'uint8' else 16} bit{rotated}"


def _xyz(photo: Photo) -> tuple[float | None, ...]:
    return tuple(round(value, 2) for value in photo.position) if photo.position else (None, None, None)


def _camera_grid(photos: Photos) -> Grid:
    counts = Counter(photo.camera for photo in photos.photos)
    # Reversed, so that the first photograph of a camera is the one that stays in the dictionary.
    first = {photo.camera: photo for photo in reversed(photos.photos)}
    rows = tuple(
        (name, count, first[name].focal_mm, first[name].focal_35mm, _rounded(first[name].pixel_um))
        for name, count in sorted(counts.items())
    )
    return Grid(
        title="Cameras",
        columns=("camera", "photographs", "focal length (mm)", "35 mm equivalent (mm)", "pixel (micrometres)"),
        rows=rows,
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)


def _charts(photos: Photos) -> tuple[Chart, ...]:
    placed = [photo for photo in photos.photos if photo.position is not None]
    if not placed:
        return ()
    x, y = (tuple(photo.position[axis] for photo in placed if photo.position) for axis in (0, 1))
    return (
        Chart(
            title="Where the photographs were taken",
            style="map",
            x_label="X (m)",
            y_label="Y (m)",
            x=x,
            series={"y": y},
            labels=tuple(photo.name for photo in placed),
        ),
    )


def _pictures(photos: Photos) -> tuple[Picture, ...]:
    # Spread over the block: neighbours look alike.
    step = max(1, len(photos.photos) // PICTURES)
    return tuple(
        Picture(title=photo.name, raster=photo_raster(photo.name, photo.levels - 1), style="rgb")
        for photo in photos.photos[::step][:PICTURES]
    )


def header_warnings(photos: Photos, positions_kind: str, cameras_kind: str) -> Iterator[str]:
    """What is noticed about files, positions and cameras before any pixel is read."""
    yield from assumptions(photos)
    yield from (remark_sentence(remark) for remark in photos.remarks)
    unplaced = [photo.name for photo in photos.photos if photo.position is None]
    if unplaced and positions_kind != "none":
        source = "GPS tags with longitude, latitude and altitude" if positions_kind == "exif" else "line in the positions file"
        yield f"{_named(unplaced)} without a position: no {source}."
    no_focal = [photo.name for photo in photos.photos if photo.focal_mm is None and photo.focal_35mm is None]
    if no_focal and cameras_kind == "exif":
        yield (
            f"{_named(no_focal)} without a focal length in EXIF: give the camera in the workflow, unless other photographs of the "
            "same camera have one."
        )
    cameras = {photo.camera for photo in photos.photos}
    if len(cameras) > 1 and not any(remark.code in _APART for remark in photos.remarks):
        yield (
            f"The photographs come from {len(cameras)} cameras, focal lengths or image sizes; "
            "each gets its own interior orientation."
        )
    yield from rolling_shutter_sentences(photos.photos)
    deep = [photo.name for photo in photos.photos if photo.dtype == "uint16"]
    if deep:
        yield (
            f"{_named(deep)} with 16 bits: points and heights are measured with all of them, and the orthoimage has 16, stretched "
            "alike for all photographs up to the brightest ground."
        )
    if len({photo.bands for photo in photos.photos}) > 1:
        yield "Grey and colour photographs are mixed; the orthoimage shows grey where only grey ones see the ground."


def _exposure_warnings(exposures: tuple[Exposure, ...]) -> Iterator[str]:
    white = [exposure.photo for exposure in exposures if exposure.white > _MOST_CLIPPED]
    black = [exposure.photo for exposure in exposures if exposure.black > _MOST_CLIPPED]
    flat = [exposure.photo for exposure in exposures if exposure.contrast < _LEAST_CONTRAST and exposure.masked <= _MOST_MASKED]
    empty = [exposure.photo for exposure in exposures if exposure.masked > _MOST_MASKED]
    if empty:
        yield (
            f"{_named(empty)} with hardly anything that is not transparent: save the photographs without alpha if their pixels are "
            "good."
        )
    if white:
        yield f"{_named(white)} with more than 10 % of the pixels fully white: nothing can be matched there."
    if black:
        yield f"{_named(black)} with more than 10 % of the pixels fully black: nothing can be matched there."
    if flat:
        yield f"{_named(flat)} with very little contrast: expect few tie points."


def _named(names: list[str]) -> str:
    return f"{len(names)} photograph{'s' if len(names) > 1 else ''} ({some_of(names)})"
