"""What is stated of accuracy, as ISO 19157 has it: what was tested at independent points, and what is only promised, apart.

A test is a direct external evaluation: root mean square errors with the survey's own error, their number of points, and the end of
their 95 % confidence interval, in words. A promise is a direct internal one: standard errors that follow from the observations,
which nobody has compared with anything.

Source: ISO 19157:2013 (measures 39, root mean square error, and 47, that of planimetry), ISO/TS 19157-2:2016 for the XML.
"""

from collections.abc import Iterator

from orthomill.pipeline.export.metadata.delivered_run import DeliveredRun
from orthomill.pipeline.export.metadata.xml_writing import Element, code, document, element, words
from orthomill.schemas.accuracy.accuracy_statement import AccuracyFigure

_TESTED = {
    "horizontal": ("47", "root mean square error of planimetry", "in plan, of the orthoimage"),
    "nva": ("39", "root mean square error", "in height on open ground, of the surface"),
    "vva": ("39", "root mean square error", "in height under vegetation, of the surface"),
    "nva_terrain": ("39", "root mean square error", "in height on open ground, of the bare ground"),
    "vva_terrain": ("39", "root mean square error", "in height under vegetation, of the bare ground"),
    "three_dimensional": ("", "root mean square error in space", "in space, of surface and orthoimage"),
}
"""number of ISO's measure where there is one, its name, of what"""
_PROMISED = (
    ("densification.precision_median", "Median standard error of a measured height among its neighbours"),
    ("densification.datum_precision_median", "Median standard error that the orientation adds to all heights of a place alike"),
    ("terrain.measured_sigma", "Root mean square of the standard errors of measured ground"),
    ("terrain.guessed_sigma", "Root mean square of the standard errors of ground that was not measured"),
    ("orientation.ground_sigma_plan", "Median standard error of tie points in plan"),
    ("orientation.ground_sigma_height", "Median standard error of tie points in height"),
)


def quality_file(run: DeliveredRun) -> str:
    """The quality alone, as a document."""
    return document(data_quality(run))


def data_quality(run: DeliveredRun) -> Element:
    """The element mdq:DQ_DataQuality."""
    scope = element("mdq:scope", element("mcc:MD_Scope", code("mcc:level", "mcc:MD_ScopeCode", "dataset")))
    return element("mdq:DQ_DataQuality", scope, *_reports(run))


def _reports(run: DeliveredRun) -> Iterator[Element]:
    for number, figure in enumerate(run.statement.figures):
        yield _tested(figure, run.record.finished, f"tested-{number}")
    for number, (name, what) in enumerate(_PROMISED):
        if name in run.figures:
            yield _promised(what, run.figures[name], f"promised-{number}")


def _tested(figure: AccuracyFigure, when: str, unit: str) -> Element:
    number, measure, what = _TESTED[figure.kind]
    high = "no upper end" if figure.high is None else f"{figure.high:.3f} m"
    words_of_it = (
        f"TESTED {what}, at {figure.points} independent points (a formal statement needs {figure.needed}); 95 % confidence "
        f"interval {figure.low:.3f} m to {high}. {figure.sentence}"
    )
    how = element(
        "mdq:evaluationMethod",
        element(
            "mdq:DQ_SampleBasedInspection",
            element("mdq:dateTime", element("gco:DateTime", zoned(when))),
            words("mdq:evaluationMethodDescription", words_of_it),
            code("mdq:evaluationMethodType", "mdq:DQ_EvaluationMethodTypeCode", "directExternal"),
            words("mdq:samplingScheme", "Check points of the survey, which took no part in the adjustment."),
            words("mdq:lotDescription", f"{figure.points} points"),
            words("mdq:samplingRatio", f"{figure.points} of {figure.points}"),
        ),
    )
    accuracy = element("mdq:DQ_AbsoluteExternalPositionalAccuracy", _measure(number, measure), how, _result(figure.rmse, unit))
    return element("mdq:report", accuracy)


def _promised(what: str, value: float, unit: str) -> Element:
    words_of_it = (
        f"PROMISED, not tested: {what[0].lower()}{what[1:]}, propagated from the residuals of the observations through "
        "adjustment and matching."
    )
    how = element(
        "mdq:evaluationMethod",
        element(
            "mdq:DQ_FullInspection",
            words("mdq:evaluationMethodDescription", words_of_it),
            code("mdq:evaluationMethodType", "mdq:DQ_EvaluationMethodTypeCode", "directInternal"),
        ),
    )
    accuracy = element("mdq:DQ_RelativeInternalPositionalAccuracy", _measure("", what), how, _result(value, unit))
    return element("mdq:report", accuracy)


def _measure(number: str, name: str) -> Element:
    reference = [words("mdq:nameOfMeasure", name)]
    if number:
        identifier = element("mcc:MD_Identifier", words("mcc:code", number), words("mcc:codeSpace", "ISO 19157:2013"))
        reference.insert(0, element("mdq:measureIdentification", identifier))
    return element("mdq:measure", element("mdq:DQ_MeasureReference", *reference))


def _result(value: float, name: str) -> Element:
    unit = element(
        "gml:UnitDefinition", element("gml:identifier", "m", codeSpace="http://www.bipm.org/en/si"), gml_id=f"unit-{name}"
    )
    record = element("gco:Record", f"{value:.4f}")
    return element("mdq:result", element("mdq:DQ_QuantitativeResult", element("mdq:value", record), element("mdq:valueUnit", unit)))


def zoned(time: str) -> str:
    """ISO 8601 with a colon in its zone, as XML has it."""
    return f"{time[:-2]}:{time[-2:]}" if len(time) > 5 and time[-5] in "+-" else time
