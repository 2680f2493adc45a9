"""What the report says of the photographs: how many, where, with which camera, how exposed, and what they lack."""

from collections import Counter

import numpy as np

from orthomill.schemas.errors import some_of
from orthomill.schemas.photo import Photo, Photos, photo_raster
from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture, StageReport
from orthomill.tasks.photos.pixels import Exposure
from orthomill.tasks.photos.scans import Scans

PICTURES = 6


def photos_report(
    photos: Photos, scans: Scans, exposures: tuple[Exposure, ...], positions_kind: str, cameras_kind: str = "exif"
) -> StageReport:
    """The report of the stage. exposures: in the order of the photographs."""
    return StageReport(
        figures=_figures(photos),
        grids=(_photo_grid(photos, exposures), _camera_grid(photos), *((_scan_grid(scans),) if scans.scans else ())),
        charts=_charts(photos),
        pictures=_pictures(photos),
        warnings=(
            *photos.remarks,
            *_header_warnings(photos, positions_kind, cameras_kind),
            *_exposure_warnings(exposures),
            *_scan_warnings(scans),
        ),
    )


def _scan_grid(scans: Scans) -> Grid:
    rows = tuple(
        (one.photo, one.marks, one.rms_um, *(one.sigma_um or (None, None)), one.turn_deg, one.col_um, one.row_um)
        for one in scans.scans
    )
    return Grid(
        title="Scans",
        columns=(
            "photo", "marks", "sigma of a mark, micrometres", "sigma of a coordinate in the middle, micrometres",
            "sigma of a coordinate at the outermost mark, micrometres", "turn of the scan, degrees",
            "pixel along rows, micrometres", "pixel along columns, micrometres",
        ),
        rows=rows,
        note="The affine transformation from the scan to the calibrated marks; three marks fit without a residual. Its errors are "
        "those of one photograph alone and partly go into its orientation; the block's standard errors do not count them.",
    )  # fmt: skip


def _scan_warnings(scans: Scans) -> list[str]:
    pixel = [max(one.col_um or 0.0, one.row_um or 0.0) for one in scans.scans]
    bad = [f"{one.photo} ({one.rms_um:.0f})" for one, p in zip(scans.scans, pixel, strict=True) if (one.rms_um or 0.0) > 2 * p]
    found = [
        f"The fiducial mark {mark} of {one.photo} lies {off:.1f} px from where the others put it and took no part: it was measured "
        "wrongly or exchanged."
        for one in scans.scans
        for mark, off in one.wrong.items()
    ]
    if any(one.marks for one in scans.scans) and not scans.cut:
        found.append(
            "The scans are used out to their outermost fiducial marks. If these stand in the margin of the film, give picture_mm, "
            "width and height of the exposed picture, or the margin gets into the surface and the orthoimage."
        )
    if bad:
        found.append(
            f"The fiducial marks of {', '.join(bad[:8])} fit an affine transformation worse than two pixels (micrometres in "
            "brackets): a mark was measured wrongly or exchanged, or the film is deformed unevenly. Five marks or more would tell "
            "which."
        )
    behind = [one.photo for one in scans.scans if one.mirrored]
    if behind:
        found.append(
            f"{_named(behind)} mirrored against the calibrated marks: right only where film was scanned from behind; else y of the "
            "calibrated marks must count upwards, and marks keep their names."
        )
    return found


def _figures(photos: Photos) -> tuple[Figure, ...]:
    megapixels = sum(photo.width * photo.height for photo in photos.photos) / 1e6
    placed = sum(photo.position is not None for photo in photos.photos)
    base = _median_base(photos)
    return (
        Figure(name="photographs", value=len(photos.photos), sentence="Photographs read.", headline=True),
        Figure(name="megapixels", value=round(megapixels, 1), unit="megapixels", sentence="Pixels of all photographs together."),
        Figure(
            name="cameras",
            value=len({photo.camera for photo in photos.photos}),
            sentence="Different cameras, focal lengths or image sizes.",
        ),
        Figure(name="with_position", value=placed, sentence="Photographs whose projection centre is known before the adjustment."),
        Figure(name="nearest_distance", value=base, unit="m", sentence="Median distance of a photograph to the nearest other one."),
    )


def _median_base(photos: Photos) -> float | None:
    centres = np.array([photo.position for photo in photos.photos if photo.position is not None])
    if len(centres) < 2:
        return None
    nearest = [np.sort(np.linalg.norm(centres - centre, axis=1))[1] for centre in centres]
    return round(float(np.median(nearest)), 2)


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
        note="Grey values in per cent of the full range, measured on the coarsest level.",
    )


def _kind(photo: Photo) -> str:
    turn = "" if photo.exif_orientation == 1 else f", turned upright (EXIF orientation {photo.exif_orientation})"
    return f"{'grey' if photo.bands == 1 else 'RGB'}, {8 if photo.dtype == 'uint8' else 16} bit{turn}"


def _xyz(photo: Photo) -> tuple[float | None, ...]:
    return tuple(round(value, 2) for value in photo.position) if photo.position else (None, None, None)


def _camera_grid(photos: Photos) -> Grid:
    counts = Counter(photo.camera for photo in photos.photos)
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
    step = max(1, len(photos.photos) // PICTURES)
    return tuple(
        Picture(title=photo.name, raster=photo_raster(photo.name, photo.levels - 1), style="rgb")
        for photo in photos.photos[::step][:PICTURES]
    )


def _header_warnings(photos: Photos, positions_kind: str, cameras_kind: str) -> list[str]:
    warnings = []
    homeless = [photo.name for photo in photos.photos if photo.position is None]
    if homeless and positions_kind != "none":
        source = "GPS tags with longitude, latitude and altitude" if positions_kind == "exif" else "line in the positions file"
        warnings.append(f"{_named(homeless)} without a position: no {source}.")
    blind = [photo.name for photo in photos.photos if photo.focal_mm is None and photo.focal_35mm is None]
    if blind and cameras_kind == "exif":
        warnings.append(
            f"{_named(blind)} without a focal length in EXIF: the workflow has to give the camera, or other photographs lend it."
        )
    cameras = {photo.camera for photo in photos.photos}
    if len(cameras) > 1:
        warnings.append(
            f"The photographs come from {len(cameras)} cameras, focal lengths or image sizes; "
            "each gets its own interior orientation."
        )
    if len({photo.bands for photo in photos.photos}) > 1:
        warnings.append("Grey and colour photographs are mixed; the orthoimage shows grey where only grey ones see the ground.")
    return warnings


def _exposure_warnings(exposures: tuple[Exposure, ...]) -> list[str]:
    burnt = [exposure.photo for exposure in exposures if exposure.white > 0.1]
    drowned = [exposure.photo for exposure in exposures if exposure.black > 0.1]
    flat = [exposure.photo for exposure in exposures if exposure.contrast < 0.03]
    warnings = []
    if burnt:
        warnings.append(f"{_named(burnt)} with more than 10 % of the pixels fully white: nothing can be matched there.")
    if drowned:
        warnings.append(f"{_named(drowned)} with more than 10 % of the pixels fully black: nothing can be matched there.")
    if flat:
        warnings.append(f"{_named(flat)} with very little contrast: expect few tie points.")
    return warnings


def _named(names: list[str]) -> str:
    return f"{len(names)} photograph{'s' if len(names) > 1 else ''} ({some_of(names)})"
