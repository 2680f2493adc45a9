"""The tables of a calibration from chessboards: parameters, models, exterior orientations, boards and photographs."""

from orthomill.schemas.stage_report import Grid
from orthomill.tasks.adjustment.boards.board_network import PARAMETERS
from orthomill.tasks.calibration.diagnosis.board_rows import board_row, median_residual, parameter_sigma, photo_residuals, photo_row
from orthomill.tasks.calibration.diagnosis.calibration_results import CalibrationResults
from orthomill.tasks.calibration.report.board_figures import rounded
from orthomill.tasks.calibration.report.cameras_report import LENS_NAMES
from orthomill.tasks.calibration.solving.calibration_precision import bend_precision
from orthomill.tasks.calibration.solving.model_choice import HeldOut

_POWER = {"k1": 2, "k2": 4, "k3": 6, "p1": 1, "p2": 1, "k4": 2, "k5": 4, "k6": 6, "s1": 1, "s2": 3, "s3": 1, "s4": 3}
"""Powers of c by which coefficients in units of c are divided to get those in powers of pixels."""
Row = tuple[float | int | str | None, ...]


def parameter_grid(results: CalibrationResults) -> Grid:
    """In pixels and powers of pixels, as the calibration literature prints them, with the difference of the halves."""
    free = results.result.network.free
    return Grid(
        title="Interior orientation in pixels",
        columns=("parameter", "value", "standard error", "halves differ by", "unit"),
        rows=tuple(_parameter_row(results, number, name) for number, name in enumerate(PARAMETERS) if name in free),
        note="x right, y up, from the image centre; distortion with the radius in pixels.",
    )


def _parameter_row(results: CalibrationResults, number: int, name: str) -> Row:
    result, check = results.result, results.check
    # The coefficients of a fisheye belong to angles; affinity and skew have no unit either.
    power = 0 if result.state.lens == "fisheye" else _POWER.get(name, 0)
    per = result.state.interior[0] ** power
    unit = "px" if name in ("c", "x0", "y0") else f"px^-{power}" if power else ""
    halves = rounded(check.difference[number] / per, 3) if check else None
    sigma = parameter_sigma(result, number)
    return name, rounded(result.state.interior[number] / per, 7), rounded(sigma / per, 3), halves, unit


def model_grid(results: CalibrationResults) -> Grid:
    """Every model with the residuals of held-out photographs."""
    rows = tuple(
        (LENS_NAMES[model.lens], ", ".join(model.free), *_held_out(check), "used" if model == results.model else "")
        for model, check in results.checks.items()
    )
    return Grid(
        title="Distortion models by held-out photographs",
        columns=("lens", "parameters", "held-out RMS (px)", "of all corners (px)", "compared (px)", ""),
        rows=rows,
        note="Compared photograph by photograph, by all corners but those that every model rejects. The simplest model is used "
        "than which none is better beyond the scatter of its gain; Brown's polynomials count as simplest. By how much the models "
        "that are as good differ is in the standard errors.",
    )


def _held_out(check: HeldOut | None) -> Row:
    return (None,) * 3 if check is None else tuple(rounded(value, 4) for value in (check.rms, check.rms_all, check.figure))


def exterior_grid(results: CalibrationResults) -> Grid:
    """The exterior orientations of the photographs, degrees and m."""
    axes = ("X0 (m)", "Y0 (m)", "Z0 (m)", "omega (deg)", "phi (deg)", "kappa (deg)")
    return Grid(
        title="Exterior orientation of the calibration photographs",
        columns=("photo", *axes, "sigma, centre (m)", "sigma, angle (deg)"),
        rows=tuple(_exterior_row(results, photo, name) for photo, name in enumerate(results.photos)),
        note="In the system of board 1: origin at its first corner, x along its columns. The largest of three standard errors.",
    )


def _exterior_row(results: CalibrationResults, photo: int, name: str) -> Row:
    # One standard error for three coordinates: three columns more would hide the figures that matter.
    row = photo_row(results.result, photo)
    return (
        name,
        *(round(v, 4) for v in row.place),
        *(round(v, 3) for v in row.angles),
        rounded(row.place_sigma, 2),
        rounded(row.angle_sigma, 2),
    )


def board_grid(results: CalibrationResults) -> Grid:
    """The places of the boards relative to board 1."""
    axes = ("tX (m)", "tY (m)", "tZ (m)", "rotation x (deg)", "rotation y (deg)", "theta (deg)")
    return Grid(
        title="Boards",
        columns=("board", *axes, "sigma, place (m)", "bends (mm)", "residual, median (px)"),
        rows=tuple(_board_row(results, board) for board in range(results.result.network.boards)),
        note="Board 1 is the most central one and defines the system. Bends: how far the ends stand above the middle, along its "
        "rows, its columns, and as a twist, with standard errors.",
    )


def _board_row(results: CalibrationResults, board: int) -> Row:
    result = results.result
    row = board_row(result, board)
    return (
        board + 1,
        *(round(v, 5) for v in row.place),
        *(round(v, 3) for v in row.angles),
        rounded(row.place_sigma, 2),
        ", ".join(f"{1e3 * bend:.2f} +- {1e3 * own:.2f}" for bend, own in zip(*bend_precision(result, board), strict=True)),
        rounded(median_residual(result, board), 3),
    )


def photo_grid(results: CalibrationResults) -> Grid:
    """The photographs with their corners, residuals, blur and initial camera constants."""
    measures = ("RMS (px)", "largest (px)", "edge blur (px)", "initial c1 (px)", "initial c2 (px)")
    return Grid(
        title="Calibration photographs",
        columns=("photo", "boards", "corners", "rejected", *measures),
        rows=tuple(_photo_row(results, photo, name) for photo, name in enumerate(results.photos)),
    )


def _photo_row(results: CalibrationResults, photo: int, name: str) -> Row:
    result, constant = results.result, results.constant
    row = photo_residuals(result, photo)
    search = next(search for search in results.searches if search.photo == name)
    return (
        name,
        row.boards,
        row.corners,
        row.rejected,
        rounded(row.rms, 3),
        rounded(row.largest, 3),
        rounded(search.blur, 2),
        rounded(constant.c1[photo], 5),
        rounded(constant.c2[photo], 5),
    )
