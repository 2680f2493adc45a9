"""The report of a calibration from chessboards, added to that of its camera."""

from collections.abc import Iterator

from orthomill.schemas.stage_report import Answer, Picture, Product, StageReport, Topic, Verdict
from orthomill.tasks.calibration.board_tables import drawing_raster
from orthomill.tasks.calibration.diagnosis.advice import LIMITING, Advice, geometry, geometry_advice, result_advice, search_advice
from orthomill.tasks.calibration.diagnosis.calibration_results import CalibrationResults
from orthomill.tasks.calibration.diagnosis.drawing import RESIDUAL_LENGTH, spread, usual_length
from orthomill.tasks.calibration.diagnosis.model_failure import failure_advice, failures
from orthomill.tasks.calibration.report.advice_sentences import advice_sentence
from orthomill.tasks.calibration.report.board_charts import board_charts
from orthomill.tasks.calibration.report.board_figures import board_figures
from orthomill.tasks.calibration.report.board_grids import board_grid, exterior_grid, model_grid, parameter_grid, photo_grid
from orthomill.tasks.calibration.report.cameras_report import LENS_NAMES
from orthomill.tasks.calibration.report.left_out_words import unused
from orthomill.tasks.calibration.solving.calibration_precision import constant

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
    sentences = {one.code: advice_sentence(one) for one in advice}
    return StageReport(
        verdict=_verdict(results, advice),
        answers=tuple(_answers(results)),
        products=PRODUCTS,
        doubts=tuple(sentences[one.code] for one in advice if one.code in failures(advice)),
        losses=tuple(sentences[one.code] for one in advice if one.code in LIMITING),
        figures=(*plain.figures, *board_figures(results, shape)),
        grids=(parameter_grid(results), *plain.grids, *own),
        charts=(*plain.charts, *board_charts(results)),
        pictures=_pictures(results),
        warnings=(*map(advice_sentence, advice), *plain.warnings),
    )


def _verdict(results: CalibrationResults, advice: list[Advice]) -> Verdict:
    """Poor where the adjustment contradicts the lens or the boards, fair where something limits it, with the first reasons."""
    if failures(advice):
        words = "The calibration does not follow the lens or the boards: do not use it before the first warnings are dealt with."
        return Verdict(level="poor", sentence=words, weighs=True)
    result, check = results.result, results.check
    c, sigma = constant(result)
    words = f"The camera constant is {c:.5g} px with a standard error of {sigma:.2g} px; corners fit to {result.rms:.2g} px"
    words += "" if check is None else f", those of photographs that took no part to {check.rms_all:.2g} px"
    limits = list(dict.fromkeys(str(one.code) for one in advice if one.code in LIMITING))
    if limits:
        return Verdict(level="fair", sentence=f"{words}; limited by: {', '.join(limits)}.")
    return Verdict(level="good", sentence=f"{words}.")


def _answers(results: CalibrationResults) -> Iterator[Answer]:
    """What a calibration is made for."""
    result, check = results.result, results.check
    c, sigma = constant(result)
    names = LENS_NAMES[result.state.lens]
    yield Answer(
        topic=Topic.CAMERA, text=f"c {c:.5g} px, standard error {sigma:.2g} px; {names}, {len(results.photos)} photographs"
    )
    held = "" if check is None else f"; {check.rms_all:.2g} px in photographs that took no part"
    yield Answer(topic=Topic.CAMERA_RESIDUALS, text=f"{result.rms:.2g} px of {int(result.used.sum())} corners{held}")
    if check is not None:
        parameter, ratio = check.worst
        apart = f"c differs by {abs(float(check.difference[0])):.2g} px"
        most = f"at most {ratio:.2g} of their standard errors, in {parameter}"
        # Halves that choose lenses of other kinds agree in c, and not in the principal point.
        yield Answer(
            topic=Topic.CAMERA_CHECK, text=f"{apart}; {most}; x0 and y0 are those of this kind of lens: another moves them"
        )
    else:
        yield Answer(topic=Topic.CAMERA_CHECK, text="not made: too few photographs")


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
