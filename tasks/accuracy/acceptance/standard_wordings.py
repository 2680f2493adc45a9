"""The accuracy of a delivery in the words that ASPRS edition 2 prescribes: tested, tested at fewer points, or only declared."""

from collections.abc import Iterator

from orthomill.schemas.accuracy.acceptance import AcceptanceLimits, DeliveryFacts
from orthomill.schemas.accuracy.acceptance_record import StandardWording
from orthomill.schemas.accuracy.accuracy_statement import AccuracyKind
from orthomill.tasks.accuracy.statement.tested_accuracy import declared

_ABOUT: dict[AccuracyKind, str] = {
    "horizontal": "Orthoimage, in plan",
    "nva": "Surface, in height, open ground",
    "vva": "Surface, in height, under vegetation",
    "nva_terrain": "Bare ground, in height, open",
    "vva_terrain": "Bare ground, in height, under vegetation",
    "three_dimensional": "In plan and height together",
}


def standard_wordings(profile: AcceptanceLimits, facts: DeliveryFacts) -> Iterator[StandardWording]:
    """One sentence for each accuracy that was tested; where the standard was agreed on and nothing was tested, the one that it
    leaves to the producer, with the class that was agreed."""
    for figure in facts.statement.figures:
        yield StandardWording(kind=figure.kind, about=_ABOUT[figure.kind], sentence=figure.sentence, tested=True)
    if getattr(profile, "kind", "") != "asprs_2023":
        return
    agreed: dict[AccuracyKind, float | None] = {"horizontal": profile.plan_limit(facts.pixel), "nva": profile.height}
    for kind, limit in agreed.items():
        if limit is not None and facts.statement.of(kind) is None:
            yield StandardWording(kind=kind, about=_ABOUT[kind], sentence=declared(kind, limit), tested=False)
