"""Which accuracy class each product meets, by what stages know of it: check points and checks without reference, apart."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from orthomill.schemas.stage_report import Evidence, Product, StageReport, class_of

_WORDS = {"plan": "horizontal", "height": "vertical"}


def product_classes(reports: Mapping[str, StageReport], folder: Path) -> Iterator[str]:
    """One sentence for each product in the run's folder, kind of accuracy and source."""
    evidence = tuple(found for report in reports.values() for found in report.evidence)
    for report in reports.values():
        for product in report.products:
            if (folder / product.path).exists():
                yield from _of_product(product, evidence)


def _of_product(product: Product, evidence: tuple[Evidence, ...]) -> Iterator[str]:
    for kind in product.classed:
        about = [e for e in evidence if e.of == kind and (not e.products or product.path in e.products)]
        yield from (f"{product.path}: {class_of(e.rmse)}-cm {_WORDS[kind]} class (ASPRS 2023) {e.source}" for e in about)
        if not about:
            yield f"{product.path}: no {_WORDS[kind]} class, nothing independent tells its accuracy"
