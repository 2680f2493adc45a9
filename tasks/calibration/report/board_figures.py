"""The figures of a calibration from chessboards; their names are stable, and `summary.json` holds them."""

from math import isfinite

from orthomill.schemas.stage_report import Figure
from orthomill.tasks.calibration.diagnosis.advice import PhotoGeometry
from orthomill.tasks.calibration.diagnosis.calibration_results import CalibrationResults
from orthomill.tasks.calibration.diagnosis.chart_points import balance
from orthomill.tasks.calibration.solving.calibration_precision import largest_bend


def board_figures(results: CalibrationResults, shape: PhotoGeometry) -> tuple[Figure, ...]:
    """All figures, in the order of the report."""
    return (*_counts(results), *_adjustment(results), *_held_out(results), *_geometry(results, shape))


def rounded(value: float | None, digits: int = 6) -> float | None:
    """The value with so many significant digits; None for what is not known."""
    return None if value is None or not isfinite(value) else float(f"{value:.{digits}g}")


def _px(name: str, value: float | None, sentence: str, headline: bool = False) -> Figure:
    return Figure(name=name, value=value, unit="px", sentence=sentence, headline=headline)


def _counts(results: CalibrationResults) -> tuple[Figure, ...]:
    # An image of a board is a pair of photograph and board: cut boards count, predicted ones without a corner do not.
    result, photos = results.result, len(results.photos)
    left_out = len(results.searches) - photos
    images = len({(p, b) for p, b in zip(result.corners.photo.tolist(), result.corners.board.tolist(), strict=True)})
    rejected = int((~result.used).sum())
    return (
        Figure(name="board_photos", value=photos, sentence="Calibration photographs used."),
        Figure(name="board_photos_unused", value=left_out, sentence="Those left out, with reasons below."),
        Figure(name="boards", value=images, sentence="Images of chessboards used, whole or cut, in all calibration photographs."),
        Figure(name="boards_on_site", value=result.network.boards, sentence="Different boards identified."),
        Figure(name="corners", value=int(result.used.sum()), sentence="Corners used."),
        Figure(name="corners_rejected", value=rejected, sentence="Corners rejected by their standardised residuals."),
    )


def _adjustment(results: CalibrationResults) -> tuple[Figure, ...]:
    result = results.result
    return (
        _px("sigma0_px", round(result.sigma0, 4), "Standard error of a corner coordinate.", headline=True),
        _px("rms_px", round(result.rms, 4), "Root mean square length of the residual vectors."),
        Figure(
            name="correlated_corners",
            value=round(result.correlated, 2),
            sentence="Factor in all standard errors, because the corners of one photograph err together (1: independently).",
        ),
        *_bend(results),
        Figure(name="redundancy", value=result.redundancy, sentence="Observations minus unknowns."),
        Figure(name="iterations", value=result.iterations, sentence="Of the adjustment, before corners were rejected one by one."),
        Figure(name="rejection_rounds", value=result.rounds, sentence="Adjustments after that, each without the rejected corners."),
        _px("initial_c", rounded(results.constant.c), "Camera constant from homographies, before the adjustment."),
    )


def _bend(results: CalibrationResults) -> tuple[Figure, ...]:
    found = largest_bend(results.result)
    bend, sigma = (None, None) if found is None else (rounded(found[1], 3), rounded(found[2], 2))
    return (
        Figure(
            name="board_bend",
            value=bend,
            unit="m",
            sentence="Largest bend of a board: how far the ends of its rows, columns or diagonals stand above the middle.",
        ),
        Figure(name="board_bend_sigma", value=sigma, unit="m", sentence="Standard error of that bend."),
    )


def _held_out(results: CalibrationResults) -> tuple[Figure, ...]:
    check = results.check
    # Without a check the figures stay, as null: their names are promised.
    rms, rms_all, at_c = (check.rms, check.rms_all, float(check.difference[0])) if check else (None, None, None)
    return (
        _px(
            "held_out_px",
            rounded(rms),
            "Root mean square length of the residual vectors of held-out photographs (each half checked by the other).",
            headline=True,
        ),
        _px("held_out_all_px", rounded(rms_all), "The same with the corners that the adjustment rejected."),
        _px(
            "c_halves_difference",
            rounded(at_c),
            "Difference of the camera constants of two halves: an empirical measure next to the formal standard error.",
        ),
    )


def _geometry(results: CalibrationResults, shape: PhotoGeometry) -> tuple[Figure, ...]:
    # Comparable with calibrations that report a constant for least distortion; the camera keeps c as adjusted.
    change = balance(results)[1]
    balanced = None if change is None else results.result.state.interior[0] + change
    tilt, turned = round(shape.tilt_largest, 1), round(shape.turned, 1)
    return (
        _px("balanced_c", rounded(balanced), "Camera constant of the balanced curve of a Brown lens; for comparison only."),
        Figure(name="coverage", value=round(shape.coverage, 3), sentence="Share of the frame that corners cover."),
        Figure(name="largest_tilt", value=tilt, unit="degrees", sentence="Between a photograph and the boards."),
        Figure(name="kappa_range", value=turned, unit="degrees", sentence="Largest difference of kappa between photographs."),
    )
