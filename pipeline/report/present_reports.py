"""The present reports of the stages, read once for the page, the terminal, the summary and the signature.

Lengths of a block without scale are shown as what they are: units of the block, and not metres. Stages reckon in metres and say so
in units, labels and sentences. Where one of them reports that lengths are none, from there on, its words and those of the stages
after it are changed here.
"""

import re
from collections.abc import Mapping
from typing import Any

from orthomill.pipeline.engine.run_facts import RunFacts, StageTitle
from orthomill.pipeline.report.numbers import number_text
from orthomill.pipeline.storage.depots.folder import PRODUCTS
from orthomill.pipeline.storage.depots.product_files import as_they_lie
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.stage_report import StageReport, report_table

_METRES = re.compile(r"(?<=\d)([ \u202f\u00a0])m(?![\w²³/])")
"""a number of metres in a sentence"""
_AREA = re.compile(r"(\d+(?:\.\d+)?)[ \u202f\u00a0](ha|km²)(?!\w)")
_SQUARE_METRES = {"ha": 1e4, "km²": 1e6}
UNITS = "units"
"""what lengths of a block without scale are in"""


def present_reports(store: ReadableStore, stages: tuple[StageTitle, ...], run: RunFacts) -> dict[str, StageReport]:
    """Reports by stage; one that an earlier run left for a stage which has failed since is not shown as current."""
    tables = {kind: report_table(kind) for kind, _ in stages if run.stage(kind).reported and run.stage(kind).jobs}
    made = store.file_names(PRODUCTS)
    reports = {kind: store.table(table) for kind, table in tables.items() if store.has_table(table)}
    return in_own_lengths({kind: as_they_lie(report, made) for kind, report in reports.items()})


def in_own_lengths(reports: Mapping[str, StageReport]) -> dict[str, StageReport]:
    """Reports in the order of their stages, without metres from the first one on whose lengths are none."""
    shown, known = {}, True
    for kind, report in reports.items():
        known = known and not report.lengths
        shown[kind] = report if known else StageReport.model_validate(_without_metres(report.model_dump()))
    return shown


def _without_metres(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _without_metres(part) for name, part in value.items()}
    if isinstance(value, tuple | list):
        return [_without_metres(part) for part in value]
    # A topic is a text as well, and stays what it is.
    if type(value) is not str:
        return value
    return UNITS if value == "m" else _METRES.sub(rf"\1{UNITS}", _AREA.sub(_square_units, value))


def _square_units(area: re.Match[str]) -> str:
    return f"{number_text(round(float(area[1]) * _SQUARE_METRES[area[2]]))} square {UNITS}"
