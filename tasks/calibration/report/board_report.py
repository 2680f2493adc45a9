"""The report of a calibration from chessboards, added to that of its camera."""

from orthomill.schemas.stage_report import Picture, Product, StageReport, Verdict
from orthomill.tasks.calibration.board_tables import drawing_raster
from orthomill.tasks.calibration.diagnosis.advice import Advice, geometry, geometry_advice, result_advice, search_advice
from orthomill.tasks.calibration.diagnosis.calibration_results import CalibrationResults
from orthomill.tasks.calibration.diagnosis.drawing import RESIDUAL_LENGTH, spread, usual_length
from orthomill.tasks.calibration.diagnosis.model_failure import fails, failure_advice
from orthomill.tasks.calibration.report.advice_sentences import advice_sentence
from orthomill.tasks.calibration.report.board_charts import board_charts
from orthomill.tasks.calibration.report.board_figures import board_figures
from orthomill.tasks.calibration.report.board_grids import board_grid, exterior_grid, model_grid, parameter_grid, photo_grid
from orthomill.tasks.calibration.report.left_out_words import unused

PRODUCTS = (
    Product(path="products/camera.json", purpose="The calibrated camera, to be used in other projects"),
    Product(path="products/calibration.json", purpose="The record of the calibration: parameters with their covariance"),
    Product(path="products/camera_agisoft.xml", purpose="The camera for Metashape"),
    Product(path="products/camera_colmap.txt", purpose="The camera for COLMAP"),
    Product(path="products/camera_opencv.yaml", purpose="The camera for OpenCV"),
    Product(path="products/camera_opensfm.json", purpose="The camera for OpenSfM"),
)
_MOST_PICTURES = 12
"""A report is one file: hundreds of photographs would make it too large to open."""


def chessboards_report(plain: StageReport, results: CalibrationResults) -> StageReport:
    """The report `plain` of the cameras, with the results of the calibration from chessboards."""
    # The weaknesses in the order in which they are remedied: photographs first, then boards and camera, then single pictures.
    shape = geometry(results.result, results.target)
    advice = [
        *geometry_advice(results.result, shape),
        *result_advice(results.result, results.check, results.target),
        *failure_advice(results.result, results.check, results.photos),
        *search_advice(results.searches),
    ]
    own = (model_grid(results), exterior_grid(results), board_grid(results), photo_grid(results), *unused(results))
    return StageReport(
        verdict=_verdict(plain.verdict, advice),
        products=PRODUCTS,
        figures=(*plain.figures, *board_figures(results, shape)),
        grids=(parameter_grid(results), *plain.grids, *own),
        charts=(*plain.charts, *board_charts(results)),
        pictures=_pictures(results),
        warnings=(*map(advice_sentence, advice), *plain.warnings),
    )


def _verdict(plain: Verdict | None, advice: list[Advice]) -> Verdict | None:
    """That of the cameras, unless the adjustment contradicts the lens or the boards."""
    if not fails(advice):
        return plain
    return Verdict(
        level="poor",
        sentence="The calibration does not follow the lens or the boards: do not use it before the first warnings are dealt with.",
        weighs=True,
    )


def _pictures(results: CalibrationResults) -> tuple[Picture, ...]:
    """At most _MOST_PICTURES drawings, evenly over the series."""
    photos = results.photos
    usual = usual_length(results.result.residual[results.result.used])
    caption = (
        "Corners by board with its number, origin and axes; the black lines are the residuals, of which "
        f"{RESIDUAL_LENGTH:.0f} pixels of this picture are {usual:.2g} px of the photograph; rejected corners are crossed."
    )
    return tuple(
        Picture(title=f"Boards in {photos[photo]}", raster=drawing_raster(photos[photo]), style="rgb", caption=caption)
        for photo in spread(len(photos), _MOST_PICTURES)
    )
