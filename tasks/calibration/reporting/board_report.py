"""What the report says of a calibration from chessboards, beside what it says of any camera."""

import numpy as np

from orthomill.schemas.stage_report import Chart, Figure, Grid, Picture, StageReport
from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.adjustment.boards.board_network import PARAMETERS
from orthomill.tasks.calibration.board_tables import drawing_raster
from orthomill.tasks.calibration.reporting.advice import (
    CELLS,
    frame_cells,
    geometry,
    geometry_warnings,
    result_warnings,
    search_warnings,
)
from orthomill.tasks.calibration.reporting.calibration_results import CalibrationResults
from orthomill.tasks.calibration.reporting.distortion_curve import RADIUS_SHARE, balanced, balancing_change, displacement
from orthomill.tasks.calibration.reporting.drawing import RESIDUAL_LENGTH, usual_length
from orthomill.tasks.calibration.reporting.left_out import unused
from orthomill.tasks.calibration.solving.calibration_precision import board_precision, correlations, photo_precision
from orthomill.tasks.calibration.solving.solving import CalibrationTarget

_MOST_PICTURES = 12
_MOST_VECTORS = 250


def chessboards_report(plain: StageReport, account: CalibrationResults) -> StageReport:
    """The report of the cameras, with all that the chessboards say of them."""
    result, target = account.result, account.target
    shape = geometry(result, target)
    warnings = [
        *geometry_warnings(result, shape),
        *result_warnings(result, account.check, target),
        *search_warnings(account.searches),
    ]
    grids = (_parameters(account), *plain.grids, _models(account), _exterior(account), _boards(account), _photographs(account),
             *unused(account))  # fmt: skip
    charts = (*plain.charts, _curve(account), _correlation_chart(result), _corner_chart(result, target),
              _cell_chart(result, target), _vector_chart(result, target), _histogram(result))  # fmt: skip
    return plain.model_copy(update={
        "figures": (*plain.figures, *_figures(account)), "grids": grids, "charts": charts, "pictures": _pictures(account),
        "warnings": (*warnings, *plain.warnings),
    })  # fmt: skip


def _figures(account: CalibrationResults) -> tuple[Figure, ...]:
    result, check = account.result, account.check
    shape = geometry(result, account.target)
    at_c = float(check.difference[0]) if check else None
    images = len({(p, b) for p, b in zip(result.corners.photo.tolist(), result.corners.board.tolist(), strict=True)})
    return (
        Figure(name="board_photos", value=len(account.photos), sentence="Calibration photographs used."),
        Figure(name="board_photos_unused", value=len(account.searches) - len(account.photos),
            sentence="Those left out, with reasons below."),
        Figure(name="boards", value=images, sentence="Images of chessboards used, whole or cut, in all calibration photographs."),
        Figure(name="boards_on_site", value=result.network.boards, sentence="Different boards told apart."),
        Figure(name="corners", value=int(result.used.sum()), sentence="Corners used."),
        Figure(name="corners_rejected", value=int((~result.used).sum()),
            sentence="Corners rejected by their standardised residuals."),
        Figure(name="sigma0_px", value=round(result.sigma0, 4), unit="px", sentence="Standard error of a corner coordinate.",
            headline=True),
        Figure(name="rms_px", value=round(result.rms, 4), unit="px", sentence="Root mean square length of the residual vectors."),
        Figure(name="redundancy", value=result.redundancy, sentence="Observations less unknowns."),
        Figure(name="iterations", value=result.iterations, sentence="Of the adjustment, before corners were rejected one by one."),
        Figure(name="rejection_rounds", value=result.rounds, sentence="Adjustments after that, each without the corners rejected."),
        Figure(name="initial_c", value=_plain(account.constant.c), unit="px",
            sentence="Camera constant from homographies, before the adjustment."),
        Figure(
            name="held_out_px", value=_plain(check.rms if check else None), unit="px", headline=True,
            sentence="Root mean square length of the residual vectors of photographs that took no part (each half of them "
            "measured with the other).",
        ),
        Figure(
            name="held_out_all_px", value=_plain(check.rms_all if check else None), unit="px",
            sentence="The same with the corners that the adjustment rejected.",
        ),
        Figure(name="c_halves_difference", value=_plain(at_c), unit="px",
               sentence="Difference of the camera constants of two halves: an honest measure beside the formal sigma."),
        Figure(name="balanced_c", value=_plain(result.state.interior[0] + _balance(account)[1]), unit="px",
               sentence="Camera constant of the balanced distortion curve; for comparison only."),
        Figure(name="coverage", value=round(shape.coverage, 3), sentence="Share of the frame that corners cover."),
        Figure(name="largest_tilt", value=round(shape.tilt_largest, 1), unit="degrees",
            sentence="Between a photograph and the boards."),
        Figure(name="kappa_range", value=round(shape.turned, 1), unit="degrees",
            sentence="How far photographs are turned against each other."),
    )  # fmt: skip


def _plain(value: float | None, digits: int = 6) -> float | None:
    return None if value is None or not np.isfinite(value) else float(f"{value:.{digits}g}")


def _parameters(account: CalibrationResults) -> Grid:
    """In pixels and powers of pixels, as the calibration literature prints them, with the difference of the halves."""
    result, check = account.result, account.check
    c, sigma = result.state.interior[0], np.sqrt(np.diag(result.interior_covariance))
    power = {"k1": 2, "k2": 4, "k3": 6, "p1": 1, "p2": 1}
    rows = []
    for number, name in enumerate(PARAMETERS):
        if name in result.network.free:
            per = c ** power.get(name, 0)
            unit = "px" if name in ("c", "x0", "y0") else f"px^-{power[name]}" if name in power else ""
            halves = _plain(check.difference[number] / per, 3) if check else None
            rows.append((name, _plain(result.state.interior[number] / per, 7), _plain(sigma[number] / per, 3), halves, unit))
    return Grid(
        title="Interior orientation in pixels",
        columns=("parameter", "value", "standard error", "halves differ by", "unit"),
        rows=tuple(rows),
        note="x right, y up, from the image centre; distortion with the radius in pixels.",
    )


def _models(account: CalibrationResults) -> Grid:
    rows = tuple((", ".join(model), _plain(check.rms if check else None, 4), "used" if model == account.result.network.free else "")
                 for model, check in account.judged.items())  # fmt: skip
    return Grid(
        title="Distortion models by photographs that took no part",
        columns=("parameters", "held-out RMS (px)", ""),
        rows=rows,
        note="The largest model is used that fits held-out photographs as well as the best, within 0.2 %.",
    )


def _exterior(account: CalibrationResults) -> Grid:
    rows = []
    for photo, name in enumerate(account.photos):
        value, sigma = photo_precision(account.result, photo)
        rows.append((name, *(round(float(v), 4) for v in value[:3]), *(round(float(v), 3) for v in np.degrees(value[3:])),
                     _plain(sigma[:3].max(), 2), _plain(np.degrees(sigma[3:]).max(), 2)))  # fmt: skip
    columns = (
        "photo",
        "X0 (m)",
        "Y0 (m)",
        "Z0 (m)",
        "omega (deg)",
        "phi (deg)",
        "kappa (deg)",
        "sigma, place (m)",
        "sigma, angle (deg)",
    )
    return Grid(
        title="Exterior orientation of the calibration photographs",
        columns=columns,
        rows=tuple(rows),
        note="In the system of board 1: origin at its first corner, x along its columns. The larger standard error of three.",
    )


def _boards(account: CalibrationResults) -> Grid:
    rows = []
    for board in range(account.result.network.boards):
        value, sigma = board_precision(account.result, board)
        size = np.linalg.norm(account.result.residual[account.result.corners.board == board], axis=1)
        rows.append((board + 1, *(round(float(v), 5) for v in value[:3]), *(round(float(v), 3) for v in np.degrees(value[3:])),
                     _plain(sigma[:3].max(), 2), _plain(float(np.median(size)), 3)))  # fmt: skip
    columns = (
        "board",
        "tX (m)",
        "tY (m)",
        "tZ (m)",
        "turn x (deg)",
        "turn y (deg)",
        "theta (deg)",
        "sigma, place (m)",
        "residual, median (px)",
    )
    return Grid(title="Boards", columns=columns, rows=tuple(rows), note="Board 1 lies in the middle and holds the system.")


def _photographs(account: CalibrationResults) -> Grid:
    result = account.result
    rows = []
    for photo, name in enumerate(account.photos):
        own = result.corners.photo == photo
        size = np.linalg.norm(result.residual[own & result.used], axis=1)
        search = next(search for search in account.searches if search.photo == name)
        rows.append((name, len(np.unique(result.corners.board[own])), int(own.sum()), int((own & ~result.used).sum()),
                     _plain(float(np.sqrt((size**2).mean())), 3) if len(size) else None, _plain(size.max(initial=0.0), 3),
                     _plain(search.blur, 2), _plain(account.constant.c1[photo], 5), _plain(account.constant.c2[photo],
                         5)))  # fmt: skip
    columns = (
        "photo",
        "boards",
        "corners",
        "rejected",
        "RMS (px)",
        "largest (px)",
        "edge blur (px)",
        "initial c1 (px)",
        "initial c2 (px)",
    )
    return Grid(title="Calibration photographs", columns=columns, rows=tuple(rows))


def _balance(account: CalibrationResults) -> tuple[float, float]:
    """Radius (px) of the balanced curve and the change of c (px) that belongs to it."""
    interior, radius = account.result.state.interior, RADIUS_SHARE * 0.5 * float(np.hypot(*account.target.size))
    return radius, balancing_change(interior[0], tuple(interior[3:6]), radius)


def _curve(account: CalibrationResults) -> Chart:
    interior = account.result.state.interior
    radius, change = _balance(account)
    r = np.linspace(0.0, 0.5 * float(np.hypot(*account.target.size)), 60)
    series = {"as adjusted": displacement(r, interior[0], tuple(interior[3:6])),
              f"balanced, c {change:+.1f} px": balanced(r, interior[0], tuple(interior[3:6]), change)}  # fmt: skip
    return Chart(
        title="Balanced radial distortion",
        style="lines",
        x_label="ideal radius (px)",
        y_label="displacement (px)",
        x=tuple(r.round(1).tolist()),
        series={name: tuple(y.round(4).tolist()) for name, y in series.items()},
        caption=f"Balanced over a radius of {radius:.0f} px ({RADIUS_SHARE:g} of half the diagonal); for comparison only.",
    )


def _correlation_chart(result: BoardAdjustment) -> Chart:
    table = correlations(result)
    series = {row: tuple((100 * table.typical[number]).round(1).tolist()) for number, row in enumerate(table.rows) if number < 6}
    return Chart(title="Correlations of the interior orientation", style="bars", x_label="", y_label="|correlation| (%)",
                 x=tuple(float(i) for i in range(len(table.columns))), labels=table.columns, series=series,
                 caption="With exterior orientations (root mean square over photographs), places of boards (over boards), and "
                 "each other.")  # fmt: skip


def _corner_chart(result: BoardAdjustment, target: CalibrationTarget) -> Chart:
    """With the border of the frame, so that its empty parts are seen."""
    pixels = target.pixels(result.corners.xy[result.used])
    width, height = np.array(target.size) - 1
    along, none = np.linspace(0.0, 1.0, 60), np.zeros(60)
    sides = [(along * width, none), (along * width, none + height), (none, along * height), (none + width, along * height)]
    x, y = np.concatenate([pixels.T, *sides], axis=1).round(1)
    corner = np.arange(len(x)) < len(pixels)
    series = {"corners used": np.where(corner, -y, np.nan), "border of the frame": np.where(corner, np.nan, -y)}
    return Chart(
        title="Corners over the frame", style="points", x_label="column (px)", y_label="row (px, downwards negative)",
        x=tuple(x.tolist()), series={name: tuple(values.tolist()) for name, values in series.items()},
        caption="What is empty within the border of the frame is extrapolated.",
    )  # fmt: skip


def _cell_chart(result: BoardAdjustment, target: CalibrationTarget) -> Chart:
    """Mean residual per cell of the frame: what is left in common to all photographs is not noise but the model."""
    number, residual = frame_cells(result, target), result.residual[result.used]
    count = np.bincount(number, minlength=CELLS**2)
    known = np.flatnonzero(count >= 5)
    mean = np.column_stack([np.bincount(number, residual[:, axis], CELLS**2)[known] / count[known] for axis in (0, 1)])
    centre = (np.column_stack([known % CELLS, known // CELLS]) + 0.5) / CELLS * target.size
    series = {"y": -centre[:, 1], "dx": mean[:, 0], "dy": mean[:, 1]}
    return Chart(
        title="Mean residuals over the frame", style="arrows", x_label="column (px)", y_label="row (px, downwards negative)",
        x=tuple(centre[:, 0].round(1).tolist()), series={name: tuple(value.round(4).tolist()) for name, value in series.items()},
        caption="In px, the mean of each cell. Arrows that agree over neighbouring cells show distortion that the model does not "
        "describe.",
    )  # fmt: skip


def _vector_chart(result: BoardAdjustment, target: CalibrationTarget) -> Chart:
    pixels, residual = target.pixels(result.corners.xy[result.used]), result.residual[result.used]
    some = np.arange(0, len(pixels), max(1, -(-len(pixels) // _MOST_VECTORS)))
    series = {"y": -pixels[some, 1], "dx": residual[some, 0], "dy": residual[some, 1]}
    return Chart(
        title="Residual vectors", style="arrows", x_label="column (px)", y_label="row (px, downwards negative)",
        x=tuple(pixels[some, 0].round(1).tolist()), series={name: tuple(value.round(4).tolist()) for name, value in series.items()},
        caption=f"Residuals in px, rows upwards: every corner or, of many, one in {max(1, -(-len(pixels) // _MOST_VECTORS))}.",
    )  # fmt: skip


def _histogram(result: BoardAdjustment) -> Chart:
    values = result.residual[result.used].ravel()
    reach = 4.0 * max(result.sigma0, 1e-9)
    count, edges = np.histogram(np.clip(values, -reach, reach), bins=33, range=(-reach, reach))
    return Chart(
        title="Residuals of the corners",
        style="bars",
        x_label="residual of a coordinate (px)",
        y_label="corners",
        x=tuple(edges.round(4).tolist()),
        series={"corners": tuple(count.tolist())},
    )


def _pictures(account: CalibrationResults) -> tuple[Picture, ...]:
    chosen = np.unique(np.linspace(0, len(account.photos) - 1, min(len(account.photos), _MOST_PICTURES)).round().astype(int))
    usual = usual_length(account.result.residual[account.result.used])
    caption = (
        "Corners by board with its number, origin and axes; the black lines are the residuals, of which "
        f"{RESIDUAL_LENGTH:.0f} pixels of this picture are {usual:.2g} px of the photograph; rejected corners are crossed."
    )
    return tuple(
        Picture(title=f"Boards in {account.photos[photo]}", raster=drawing_raster(account.photos[photo]), style="rgb",
                caption=caption)
        for photo in chosen
    )  # fmt: skip
