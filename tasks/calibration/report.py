"""What the report says of the cameras: parameters with standard errors, the distortion curve, and how good the boards are."""

from collections import Counter

import numpy as np

from schemas.camera import INTERIOR, Camera, Cameras
from schemas.photo import Photos
from schemas.report import Chart, Figure, Grid, StageReport
from tasks.calibration.nominal import nominal_constant
from tasks.calibration.plane_views import HeldOut, Solution
from tasks.geometry.distortion import image_to_pixel

_UNITS = {"c": "px", "x0": "px", "y0": "px"}
_SOURCES = {
    "exif": "nominal, from EXIF", "file": "from a file", "given": "typed into the workflow", "chessboards": "from chessboards",
    "block": "from a block adjustment", "truth": "the simulated truth",
}  # fmt: skip
_CELLS = 8


def cameras_report(cameras: Cameras, photos: Photos, sources: dict[str, Camera]) -> StageReport:
    """The report for cameras that were not calibrated here."""
    shown = tuple(cameras.cameras.values())
    figures = (Figure(name="cameras", value=len(shown), sentence="Interior orientations in use."), *_camera_figures(shown))
    warnings = [*_scale_warnings(cameras, sources), *_nominal_warnings(shown, photos)]
    return StageReport(figures=figures, grids=_camera_grids(cameras), charts=(_distortion_chart(shown),), warnings=tuple(warnings))


def chessboards_report(
    cameras: Cameras, photos: Photos, sources: dict[str, Camera], solution: Solution, check: HeldOut | None
) -> StageReport:
    """The report for a calibration from chessboards."""
    plain = cameras_report(cameras, photos, sources)
    camera = next(iter(sources.values()))
    size = (camera.width, camera.height)
    return plain.model_copy(
        update={
            "figures": (*_board_figures(solution, check), *plain.figures),
            "grids": (*plain.grids, _board_grid(solution, size)),
            "charts": (*plain.charts, _corner_chart(solution), _residual_chart(solution, size)),
            "warnings": (*_board_warnings(solution, check, size), *plain.warnings),
        }
    )


def _camera_figures(cameras: tuple[Camera, ...]) -> tuple[Figure, ...]:
    if len(cameras) != 1:
        return ()
    camera = cameras[0]
    return (
        Figure(name="c", value=round(camera.c, 3), unit="px", sentence="Camera constant."),
        Figure(name="sigma_c", value=_rounded(_sigma(camera, "c"), 4), unit="px", sentence="Its standard error."),
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
        (name, _rounded(getattr(camera, name), 7), _rounded(_sigma(camera, name), 3), _UNITS.get(name, "")) for name in INTERIOR
    ]
    rows.append(("k1, calibration literature", _rounded(camera.k1 / camera.c**2, 5), _per_c2(camera), "px^-2"))
    if camera.pixel_um:
        rows.append(("c", _rounded(camera.c * camera.pixel_um / 1000, 6), None, "mm"))
    note = (
        f"{camera.width} x {camera.height} px, {_SOURCES[camera.source]}, {photographs} photographs. Radius in units of "
        "c; x right, y up, "
        "from the image centre. A standard error of 0 means that the parameter was held."
    )
    return Grid(
        title=f"Camera {camera.name}", columns=("parameter", "value", "standard error", "unit"), rows=tuple(rows), note=note
    )


def _per_c2(camera: Camera) -> float | None:
    sigma = _sigma(camera, "k1")
    return None if sigma is None else _rounded(sigma / camera.c**2, 3)


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
        source = sources[name]
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


def _board_figures(solution: Solution, check: HeldOut | None) -> tuple[Figure, ...]:
    corners = sum(len(view.pixels) for view in solution.views)
    return (
        Figure(name="boards", value=len(solution.views), sentence="Chessboards found in all calibration photographs."),
        Figure(name="corners", value=corners, sentence="Corners used."),
        Figure(name="corners_rejected", value=solution.rejected, sentence="Corners left out beyond four robust sigma."),
        Figure(
            name="sigma0_px", value=round(solution.sigma0, 4), unit="px", sentence="Sigma of a corner coordinate.", headline=True
        ),
        Figure(
            name="held_out_px", value=round(check.rms, 4) if check else None, unit="px",
            sentence="Root mean square on photographs that took no part in the calibration (each half measured with the other).",
        ),
        Figure(
            name="c_halves_difference", value=round(check.c_second - check.c_first, 3) if check else None, unit="px",
            sentence="Difference of the camera constants of two halves: an honest measure beside the formal sigma.",
        ),
    )  # fmt: skip


def _board_grid(solution: Solution, size: tuple[int, int]) -> Grid:
    residuals = solution.residuals(size)
    rows = []
    for name in sorted({view.photo for view in solution.views}):
        own = [residual for view, residual in zip(solution.views, residuals, strict=True) if view.photo == name]
        stacked = np.concatenate(own)
        rows.append(
            (name, len(own), len(stacked), round(float(np.sqrt((stacked**2).mean())), 4), round(float(np.abs(stacked).max()), 3))
        )
    return Grid(
        title="Calibration photographs", columns=("photo", "boards", "corners", "RMS (px)", "largest (px)"), rows=tuple(rows)
    )


def _corner_chart(solution: Solution) -> Chart:
    pixels = np.concatenate([view.pixels for view in solution.views])
    return Chart(
        title="Corners over the frame", style="points", x_label="column (px)", y_label="row (px, downwards negative)",
        x=tuple(pixels[:, 0].round(1).tolist()), series={"corners": tuple((-pixels[:, 1]).round(1).tolist())},
        caption="Empty parts of the frame are extrapolated.",
    )  # fmt: skip


def _residual_chart(solution: Solution, size: tuple[int, int]) -> Chart:
    """Mean residual per cell of the frame: what is left in common to all photographs is not noise but the model."""
    pixels = np.concatenate([view.pixels for view in solution.views])
    residuals = np.concatenate(solution.residuals(size))
    cell = np.clip((pixels / size * _CELLS).astype(int), 0, _CELLS - 1)
    number = cell[:, 1] * _CELLS + cell[:, 0]
    count = np.bincount(number, minlength=_CELLS**2)
    known = np.flatnonzero(count >= 5)
    mean = np.column_stack([np.bincount(number, residuals[:, axis], _CELLS**2)[known] / count[known] for axis in (0, 1)])
    centre = (np.column_stack([known % _CELLS, known // _CELLS]) + 0.5) / _CELLS * size
    series = {"y": -centre[:, 1], "dx": mean[:, 0], "dy": -mean[:, 1]}
    return Chart(
        title="Mean residuals over the frame", style="arrows", x_label="column (px)", y_label="row (px, downwards negative)",
        x=tuple(centre[:, 0].round(1).tolist()), series={name: tuple(value.round(4).tolist()) for name, value in series.items()},
        caption="Arrows that agree over neighbouring cells show distortion that the model does not describe.",
    )  # fmt: skip


def _board_warnings(solution: Solution, check: HeldOut | None, size: tuple[int, int]) -> list[str]:
    warnings = []
    covered = _coverage(solution, size)
    if covered < 0.6:
        warnings.append(
            f"Corners fall into only {100 * covered:.0f} % of the frame's {_CELLS} x {_CELLS} cells; distortion "
            "elsewhere is extrapolated."
        )
    if _tilt(solution) < 10.0:
        warnings.append(
            "The boards lie nearly parallel to the sensor in all photographs; the camera constant is weakly "
            "determined. Tilt the camera."
        )
    if check is None:
        warnings.append("There are too few photographs of boards to check the calibration on some that take no part.")
    elif check.rms > 2.0 * solution.sigma0:
        warnings.append(
            f"Photographs that took no part fit {check.rms / solution.sigma0:.1f} times worse than those that did; the "
            "standard errors of "
            "the interior orientation are too small by about as much."
        )
    return warnings


def _coverage(solution: Solution, size: tuple[int, int]) -> float:
    cell = np.clip((np.concatenate([view.pixels for view in solution.views]) / size * _CELLS).astype(int), 0, _CELLS - 1)
    return len(np.unique(cell[:, 1] * _CELLS + cell[:, 0])) / _CELLS**2


def _tilt(solution: Solution) -> float:
    """Largest angle between a board and the sensor, degrees."""
    angle = np.linalg.norm(solution.poses[:, :3], axis=1)
    axis = solution.poses[:, :3] / np.maximum(angle, 1e-12)[:, None]
    normal_z = np.cos(angle) + axis[:, 2] ** 2 * (1.0 - np.cos(angle))
    return float(np.degrees(np.arccos(np.clip(np.abs(normal_z), 0.0, 1.0)).max()))
