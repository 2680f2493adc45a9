"""What the report says of cameras, wherever they come from: parameters with standard errors, and the distortion curve."""

from collections import Counter

import numpy as np

from orthomill.schemas.camera import INTERIOR, Camera, Cameras
from orthomill.schemas.photo import Photos
from orthomill.schemas.stage_report import Chart, Figure, Grid, StageReport
from orthomill.tasks.calibration.cameras.nominal_cameras import nominal_constant
from orthomill.tasks.geometry.camera_change import sensor_name
from orthomill.tasks.geometry.distortion import image_to_pixel

_UNITS = {"c": "px", "x0": "px", "y0": "px"}
_SOURCES = {
    "exif": "nominal, from EXIF", "file": "from a file", "given": "typed into the workflow", "chessboards": "from chessboards",
    "block": "from a block adjustment", "truth": "the simulated truth",
}  # fmt: skip


def cameras_report(cameras: Cameras, photos: Photos, sources: dict[str, Camera]) -> StageReport:
    """The report for cameras that were not calibrated here."""
    shown = tuple(cameras.cameras.values())
    figures = (Figure(name="cameras", value=len(shown), sentence="Interior orientations in use."), *_camera_figures(shown))
    warnings = [*_scale_warnings(cameras, sources), *_nominal_warnings(shown, photos)]
    return StageReport(figures=figures, grids=_camera_grids(cameras), charts=(_distortion_chart(shown),), warnings=tuple(warnings))


def _camera_figures(cameras: tuple[Camera, ...]) -> tuple[Figure, ...]:
    if len(cameras) != 1:
        return ()
    camera = cameras[0]
    calibrated = camera.source == "chessboards"
    return (
        Figure(name="c", value=round(camera.c, 3), unit="px", sentence="Camera constant.", headline=calibrated),
        Figure(
            name="sigma_c",
            value=_rounded(_sigma(camera, "c"), 4),
            unit="px",
            sentence="Standard error of the camera constant.",
            headline=calibrated,
        ),
        Figure(name="source", value=_SOURCES[camera.source], sentence="Where the interior orientation comes from."),
    )


def _sigma(camera: Camera, name: str) -> float | None:
    if camera.covariance is None:
        return None
    at = INTERIOR.index(name)
    return float(np.sqrt(max(camera.covariance[at][at], 0.0)))


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else float(f"{value:.{digits}g}")


def _camera_grids(cameras: Cameras) -> tuple[Grid, ...]:
    counts = Counter(cameras.of_photo.values())
    return tuple(_camera_grid(camera, counts[name]) for name, camera in cameras.cameras.items())


def _camera_grid(camera: Camera, photographs: int) -> Grid:
    rows: list[tuple[float | int | str | None, ...]] = [
        (name, *_with_sigma(getattr(camera, name), _sigma(camera, name)), _UNITS.get(name, "")) for name in INTERIOR
    ]
    rows.append(("k1, calibration literature", *_with_sigma(camera.k1 / camera.c**2, _per_c2(camera)), "px^-2"))
    if camera.pixel_um:
        rows.append(("c", f"{camera.c * camera.pixel_um / 1000:.6g}", "", "mm"))
    serves = f", {photographs} photographs" if photographs else ""
    note = (
        f"{camera.width} x {camera.height} px, {_SOURCES[camera.source]}{serves}. Radius in units of c, numbers as in OpenCV; "
        "x right, y up, from the image centre."
    )
    return Grid(
        title=f"Camera {camera.name}", columns=("parameter", "value", "standard error", "unit"), rows=tuple(rows), note=note
    )


def _with_sigma(value: float, sigma: float | None) -> tuple[str, str]:
    """A parameter with the digits that its standard error leaves, and the standard error; one that was held says so."""
    if sigma is None:
        return f"{value:.7g}", "not known"
    if sigma == 0:
        return f"{value:.7g}", "held"
    decimals = max(0, 1 - int(np.floor(np.log10(sigma))))
    return (f"{value:.{decimals}f}", f"{sigma:.{decimals}f}") if decimals < 9 else (f"{value:.6g}", f"{sigma:.2g}")


def _per_c2(camera: Camera) -> float | None:
    sigma = _sigma(camera, "k1")
    return None if sigma is None else sigma / camera.c**2


def _distortion_chart(cameras: tuple[Camera, ...]) -> Chart:
    reach = max(float(np.hypot(camera.width, camera.height)) / 2 for camera in cameras)
    radius = np.linspace(0.0, reach, 60)
    curves = {camera.name: tuple(_radial(camera, radius).round(4).tolist()) for camera in cameras}
    return Chart(
        title="Radial distortion", style="lines", x_label="distance from the principal point (px)", y_label="displacement (px)",
        x=tuple(radius.round(2).tolist()), series=curves, caption="Observed minus ideal; negative is towards the centre (barrel).",
    )  # fmt: skip


def _radial(camera: Camera, radius: np.ndarray) -> np.ndarray:
    centred = camera.model_copy(update={"x0": 0.0, "y0": 0.0, "p1": 0.0, "p2": 0.0})
    pixels = image_to_pixel(centred, np.column_stack([radius, np.zeros_like(radius)]))
    return pixels[:, 0] - (camera.width - 1) / 2 - radius


def _scale_warnings(cameras: Cameras, sources: dict[str, Camera]) -> list[str]:
    warnings = []
    for name, camera in cameras.cameras.items():
        source = sources[sensor_name(name)]
        if {camera.width, camera.height} != {source.width, source.height}:
            warnings.append(
                f"The camera {source.name} is known for {source.width} x {source.height} pixels and was scaled to the "
                f"{camera.width} x "
                f"{camera.height} of its photographs; this is right only if they were reduced, not cropped."
            )
    return warnings


def _nominal_warnings(cameras: tuple[Camera, ...], photos: Photos) -> list[str]:
    warnings = []
    if any(camera.source == "exif" for camera in cameras):
        warnings.append(
            "The interior orientation is nominal, from EXIF tags, without lens distortion; the block adjustment has to refine it."
        )
    for photo in {photo.camera: photo for photo in photos.photos}.values():
        nominal, second = nominal_constant(photo), nominal_constant(photo.model_copy(update={"pixel_um": None}))
        if nominal and second and photo.pixel_um and abs(nominal[0] / second[0] - 1.0) > 0.15:
            warnings.append(
                f"The EXIF tags of {photo.camera} contradict each other: the camera constant is {nominal[0]:.0f} px by "
                "focal length and pixel "
                f"size, but {second[0]:.0f} px by the 35 mm equivalent."
            )
    return warnings
