"""Which accuracy class each product meets, and whether it keeps what the survey allows, by what stages know of it: check points and
checks without reference, apart."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from orthomill.schemas.accuracy.accuracy_statement import class_of
from orthomill.schemas.project import Tolerances
from orthomill.schemas.stage_report import Evidence, Product, StageReport

_WORDS = {"plan": "horizontal", "height": "vertical"}


def product_classes(reports: Mapping[str, StageReport], folder: Path, tolerances: Tolerances) -> Iterator[str]:
    """One sentence for each product in the run's folder, kind of accuracy and source."""
    evidence = tuple(found for report in reports.values() for found in report.evidence)
    for report in reports.values():
        for product in report.products:
            if (folder / product.path).exists():
                yield from _of_product(product, evidence, tolerances)


def _of_product(product: Product, evidence: tuple[Evidence, ...], tolerances: Tolerances) -> Iterator[str]:
    for kind in product.classed:
        allowed = tolerances.plan if kind == "plan" else tolerances.height
        about = [e for e in evidence if e.of == kind and (not e.products or product.path in e.products)]
        for found in about:
            met = f"{_met(found, kind)}{_kept(found.rmse, allowed)}" if found.independent else _agreement(found, allowed)
            yield f"{product.path}: {met}"
        if not any(found.independent for found in about):
            unknown = "" if allowed is None else f", nor whether it keeps the {allowed:g} m that are allowed"
            yield f"{product.path}: no {_WORDS[kind]} class, nothing independent tells its accuracy{unknown}"


def _met(found: Evidence, kind: str) -> str:
    return f"{class_of(found.rmse)}-cm {_WORDS[kind]} class (ASPRS 2023) {found.source}"


def _agreement(found: Evidence, allowed: float | None) -> str:
    """What a product and the photographs that it was made from say of each other: errors that both share are in neither."""
    broken = allowed is not None and found.rmse > allowed
    verdict = f"this breaks the {allowed:g} m that are allowed" if broken else "what both share is not seen, and no class follows"
    return f"it and the photographs agree to {found.rmse:.3f} m {found.source}; {verdict}"


def _kept(rmse: float, allowed: float | None) -> str:
    """Whether a root mean square error (m) is within what is allowed; empty where nothing is asked for."""
    if allowed is None:
        return ""
    return f"; its RMSE of {rmse:.3f} m {'keeps' if rmse <= allowed else 'breaks'} the {allowed:g} m that are allowed"
