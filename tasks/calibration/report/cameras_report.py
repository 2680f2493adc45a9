"""What the report shows of cameras from any source: parameters with standard errors, the distortion curve, and warnings."""

from collections import Counter
from math import floor, log10, nan, sqrt

from orthomill.schemas.camera import INTERIOR, Camera, Cameras
from orthomill.schemas.errors import some_of
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.stage_report import Chart, Figure, Grid, StageReport, Verdict
from orthomill.tasks.calibration.cameras.camera_sharing import SharedCameras
from orthomill.tasks.calibration.cameras.nominal_cameras import constant_of_maker, nominal_constant
from orthomill.tasks.calibration.cameras.radial_curves import radial_curves
from orthomill.tasks.calibration.cameras.untagged_photographs import GUESS_SHARE, Substitute, UntaggedPhotos
from orthomill.tasks.geometry.camera_change import sensor_name

LENS_NAMES = {
    "brown": "Brown's lens",
    "rational": "rational lens",
    "thin_prism": "rational lens with thin prism",
    "fisheye": "fisheye (Kannala and Brandt)",
    "division": "division model",
}
"""The lens models as a reader knows them."""
_UNITS = {"c": "px", "x0": "px", "y0": "px"}
_SOURCES = {
    "exif": "nominal, from EXIF",
    "file": "from a file",
    "given": "typed into the workflow",
    "chessboards": "from chessboards",
    "block": "from a block adjustment",
    "truth": "the simulated truth",
}


_MAKER = "calibrated by the maker, from the tags"
_DEWARPED = "calibrated by the maker, whose distortion the camera has removed, from the tags"
_DESIGN = "camera constant from the maker's drawings of the lens, without distortion, from the tags"
# EXIF rounds both descriptions of one lens: an equivalent of 28 mm is good to 2 %, a pixel size from the sensor's format to a few
# percent. What differs by more is a wrong tag.
_CONTRADICTION = 0.15
"""Relative difference above which two camera constants of one photograph's tags contradict each other."""


def cameras_report(cameras: Cameras, shared: SharedCameras) -> StageReport:
    """The report of the cameras in use. shared: the photographs and the cameras of the sensors that they were made from."""
    shown = tuple(cameras.cameras.values())
    sources = _sources_in_tags(shared.photos)
    count = Figure(name="cameras", value=len(shown), sentence="Interior orientations in use.")
    warnings = [
        *map(untagged_sentence, shared.untagged),
        *_scale_warnings(cameras, shared.cameras),
        *_nominal_warnings(shown, shared.photos, sources),
    ]
    return StageReport(
        verdict=_verdict(shown, sources),
        figures=(count, *_camera_figures(shown, sources)),
        grids=_camera_grids(cameras, sources),
        charts=(_distortion_chart(shown),),
        warnings=tuple(warnings),
    )


def _verdict(cameras: tuple[Camera, ...], sources: dict[str, str]) -> Verdict:
    nominal = sum(_is_nominal(camera, sources) for camera in cameras)
    if nominal:
        which = "The camera is" if len(cameras) == 1 else f"{nominal} of {len(cameras)} cameras are"
        return Verdict(level="fair", sentence=f"{which} known from EXIF only, without lens distortion; a calibration is better.")
    known = sorted({_source(camera, sources) for camera in cameras})
    return Verdict(level="good", sentence=f"Interior orientation {' and '.join(known)}.")


def _is_nominal(camera: Camera, sources: dict[str, str]) -> bool:
    """Whether the tags gave a camera without distortion: not a calibration."""
    undistorted = not any(camera.value(name) for name in ("k1", "k2", "p1", "p2"))
    return camera.source == "exif" and undistorted and sources.get(camera.name) not in (_MAKER, _DEWARPED)


def _source(camera: Camera, sources: dict[str, str]) -> str:
    return sources.get(camera.name, _SOURCES[camera.source]) if camera.source == "exif" else _SOURCES[camera.source]


def _sources_in_tags(photos: Photos) -> dict[str, str]:
    """Camera -> where the maker's constant in the tags comes from, for those that have one."""
    out: dict[str, str] = {}
    for photo in photos.photos:
        if (kind := constant_of_maker(photo)) is not None:
            calibrated = _DEWARPED if photo.dewarped else _MAKER
            out.setdefault(photo.camera, calibrated if kind == "calibrated" else _DESIGN)
    return out


def _camera_figures(cameras: tuple[Camera, ...], sources: dict[str, str]) -> tuple[Figure, ...]:
    if len(cameras) != 1:
        return ()
    camera = cameras[0]
    calibrated = camera.source == "chessboards"
    return (
        Figure(
            name="c", label="Camera constant", value=round(camera.c, 3), unit="px", sentence="Camera constant.", headline=calibrated
        ),
        Figure(
            name="sigma_c",
            label="Its standard error",
            value=_rounded(_sigma(camera, "c"), 4),
            unit="px",
            sentence="Standard error of the camera constant.",
            headline=calibrated,
        ),
        Figure(name="source", value=_source(camera, sources), sentence="Where the interior orientation comes from."),
    )


def untagged_sentence(untagged: UntaggedPhotos) -> str:
    """Which photographs have no camera constant in their tags, which one they use instead, and what to do about it."""
    names = some_of(untagged.photos)
    if untagged.substitute is Substitute.SAME_SIZE:
        return (
            f"EXIF gives no focal length of {names}; taken as photographs of {untagged.camera}, which has their size. If another "
            "camera took them, give it a camera of its own or leave them out."
        )
    guessed = sorted({f"{constant:.0f} px" for constant in untagged.constants})
    return (
        f"EXIF gives no focal length of {names}, and no other photograph has their size: a camera constant of "
        f"{', '.join(guessed)} was guessed, with a standard error of {100 * GUESS_SHARE:.0f} %, which the block refines as far as "
        "its shape and control allow. Give their camera (cameras: {kind: given, c: ...}, or a file) if it is known."
    )


def _sigma(camera: Camera, name: str) -> float | None:
    if camera.covariance is None:
        return None
    at = INTERIOR.index(name)
    # A covariance that went through turns and scalings may have a variance of -1e-20 for a fixed parameter.
    return sqrt(max(camera.covariance[at][at], 0.0))


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else float(f"{value:.{digits}g}")


def _camera_grids(cameras: Cameras, sources: dict[str, str]) -> tuple[Grid, ...]:
    counts = Counter(cameras.of_photo.values())
    return tuple(_camera_grid(camera, counts[name], _source(camera, sources)) for name, camera in cameras.cameras.items())


def _camera_grid(camera: Camera, photographs: int, source: str) -> Grid:
    rows: list[tuple[float | int | str | None, ...]] = [
        (name, *_with_sigma(camera.value(name), _sigma(camera, name)), _UNITS.get(name, "")) for name in camera.parameters
    ]
    if camera.lens.kind == "brown":
        rows.append(("k1, calibration literature", *_with_sigma(camera.value("k1") / camera.c**2, _per_c2(camera)), "px^-2"))
    if camera.pixel_um:
        rows.append(("c", f"{camera.c * camera.pixel_um / 1000:.6g}", "", "mm"))
    serves = f", {photographs} photographs" if photographs else ""
    note = (
        f"{camera.width} x {camera.height} px, {source}{serves}; {LENS_NAMES[camera.lens.kind]}. Radius in units "
        "of c, numbers as in OpenCV; x right, y up, from the image centre."
    )
    return Grid(
        title=f"Camera {camera.name}", columns=("parameter", "value", "standard error", "unit"), rows=tuple(rows), note=note
    )


def _with_sigma(value: float, sigma: float | None) -> tuple[str, str]:
    """A parameter with the digits that its standard error supports, and the standard error; or that it is fixed or unknown."""
    if sigma is None:
        return f"{value:.7g}", "not known"
    if sigma == 0:
        return f"{value:.7g}", "fixed"
    # Two significant digits of the standard error. Coefficients in px^-2 would need a dozen decimals: these get an exponent
    # instead.
    decimals = max(0, 1 - floor(log10(sigma)))
    return (f"{value:.{decimals}f}", f"{sigma:.{decimals}f}") if decimals < 9 else (f"{value:.6g}", f"{sigma:.2g}")


def _per_c2(camera: Camera) -> float | None:
    sigma = _sigma(camera, "k1")
    return None if sigma is None else sigma / camera.c**2


def _distortion_chart(cameras: tuple[Camera, ...]) -> Chart:
    radius, curves = radial_curves(cameras)
    return Chart(
        title="Radial distortion",
        style="lines",
        x_label="distance from the principal point (px)",
        y_label="displacement (px)",
        x=radius,
        series=curves,
        caption="Observed minus ideal; negative is towards the centre (barrel).",
    )


def _scale_warnings(cameras: Cameras, sources: dict[str, Camera]) -> list[str]:
    warnings = []
    for name, camera in cameras.cameras.items():
        source = sources[sensor_name(name)]
        if {camera.width, camera.height} != {source.width, source.height}:
            warnings.append(
                f"The camera {source.name} has {source.width} x {source.height} pixels and was scaled to the {camera.width} x "
                f"{camera.height} of its photographs; this is right only if they were reduced, not cropped."
            )
    return warnings


def _nominal_warnings(cameras: tuple[Camera, ...], photos: Photos, sources: dict[str, str]) -> list[str]:
    warnings = []
    if any(_is_nominal(camera, sources) for camera in cameras):
        warnings.append(
            "The interior orientation is nominal, from EXIF tags, without lens distortion; the block adjustment has to refine it."
        )
    of_camera = {photo.camera: photo for photo in photos.photos}
    return warnings + [_contradiction(photo) for photo in of_camera.values() if _contradicts(photo)]


def _two_constants(photo: Photo) -> tuple[float, float] | None:
    """The camera constant (px) by focal length and pixel size, and by the 35 mm equivalent, where the tags give both."""
    plain = photo.model_copy(update={"factory": None})
    by_pixel, by_35mm = nominal_constant(plain), nominal_constant(plain.model_copy(update={"pixel_um": None}))
    return (by_pixel[0], by_35mm[0]) if by_pixel and by_35mm and photo.pixel_um else None


def _contradicts(photo: Photo) -> bool:
    both = _two_constants(photo)
    return both is not None and abs(both[0] / both[1] - 1.0) > _CONTRADICTION


def _contradiction(photo: Photo) -> str:
    by_pixel, by_35mm = _two_constants(photo) or (nan, nan)
    return (
        f"The EXIF tags of {photo.camera} contradict each other: the camera constant is {by_pixel:.0f} px by focal length and "
        f"pixel size, but {by_35mm:.0f} px by the 35 mm equivalent."
    )
