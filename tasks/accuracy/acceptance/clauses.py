"""The clauses of a profile beside the facts of a delivery.

A clause about accuracy is met when the accuracy found keeps the limit; without enough check points it is not testable, however
small the promised errors are.
"""

from collections import Counter
from collections.abc import Iterator

from orthomill.schemas.accuracy.acceptance import AcceptanceLimits, AcceptanceResult, Clause, DeliveryFacts, Outcome3
from orthomill.schemas.accuracy.accuracy_statement import AccuracyFigure
from orthomill.tasks.accuracy.acceptance.standard_wordings import standard_wordings

_UNTESTED = "not tested at independent points"
_ROUNDING = 1 + 1e-6
"""Float32 of rasters and roots of sums: 0.2 m must not be more than 0.2 m."""
_TESTS = {"horizontal": "place", "nva": "height"}
"""what the reasons of points that were not tested begin with"""


def accepted(profile: AcceptanceLimits, facts: DeliveryFacts, delivery: str) -> AcceptanceResult:
    """Every clause that the profile asks for."""
    return AcceptanceResult(
        profile=getattr(profile, "kind", "custom"),
        delivery=delivery,
        clauses=tuple(_clauses(profile, facts)),
        findings=(*_under_vegetation(facts), *_contradicted(facts), *(error.sentence for error in facts.statement.named)),
        wordings=tuple(standard_wordings(profile, facts)),
    )


def _contradicted(facts: DeliveryFacts) -> Iterator[str]:
    """Measured distances that the block does not have."""
    found = facts.statement.distances
    if found and found.contradicting:
        yield found.sentence


def _under_vegetation(facts: DeliveryFacts) -> Iterator[str]:
    """What the standard has told beside the accuracy on open ground, and sets no limit for."""
    for kind in ("vva", "vva_terrain"):
        figure = facts.statement.of(kind)
        if figure is not None:
            yield figure.sentence


def _clauses(profile: AcceptanceLimits, facts: DeliveryFacts) -> Iterator[Clause]:
    for kind, words, limit in (("horizontal", "plan", profile.plan_limit(facts.pixel)), ("nva", "height", profile.height)):
        if limit is not None:
            yield from _accuracy(facts.statement.of(kind), words, limit, profile, _why_not(facts, kind))  # type: ignore[arg-type]
    if profile.plan_stated:
        known = facts.statement.of("horizontal")
        told = f"{known.rmse:.3f} m at {known.points} points" if known else _UNTESTED
        yield Clause(clause="accuracy in plan stated", found=told, limit="stated", outcome=_met(known is not None))
    if profile.plan_pixels and not facts.pixel:
        yield Clause(clause="accuracy in plan", found="no orthoimage", limit=f"{profile.plan_pixels:g} px", outcome="not testable")
    for words, found, limit, unit in (
        ("pixel of the orthoimage", facts.pixel, profile.pixel, "m"),
        ("voids", facts.voids, profile.voids, "%"),
        ("gaps of the surface", facts.gaps, profile.gaps, "%"),
        ("estimated heights", facts.estimated, profile.estimated, "%"),
        ("clipped colours", facts.clipped, profile.clipped, "%"),
        ("differences of colours", facts.seams, profile.seams, "grey levels"),
    ):
        if limit is not None:
            yield _at_most(words, found, limit, unit)
    if profile.area is not None:
        yield from _coverage(profile, facts)
    yield from _days(profile, facts)
    if profile.heights_named:
        yield _heights_named(facts)


def _heights_named(facts: DeliveryFacts) -> Clause:
    named = facts.systems.height if facts.systems else ""
    found = named or (f"none beside {facts.crs}" if facts.crs else "no system")
    return Clause(clause="heights named", found=found, limit="a vertical system", outcome=_met(bool(named)))


def _why_not(facts: DeliveryFacts, kind: str) -> str:
    """That nothing was tested, with the reason of most points."""
    about = f"{_TESTS[kind]}: "
    reasons = Counter(reason.removeprefix(about) for _, reason in facts.statement.untested if reason.startswith(about))
    most = reasons.most_common(1)
    return f"{_UNTESTED} ({most[0][1]} of {reasons.total()}: {most[0][0]})" if most else _UNTESTED


def _accuracy(
    figure: AccuracyFigure | None, words: str, limit: float, profile: AcceptanceLimits, untested: str
) -> Iterator[Clause]:
    if figure is None:
        yield Clause(clause=f"accuracy in {words}", found=untested, limit=f"{limit:.3f} m", outcome="not testable")
    else:
        upper = "" if figure.high is None else f", 95 %: {figure.low:.3f} to {figure.high:.3f} m"
        found = f"{figure.rmse:.3f} m{upper}"
        yield Clause(
            clause=f"accuracy in {words}", found=found, limit=f"{limit:.3f} m", outcome=_met(figure.rmse <= limit * _ROUNDING)
        )
    if profile.points:
        count = figure.points if figure else 0
        clause, enough = f"check points for {words}", count >= profile.points
        yield Clause(clause=clause, found=str(count), limit=f"{profile.points} or more", outcome=_met(enough))
    if profile.survey_share is not None:
        most = profile.survey_share * limit
        clause = f"survey of the check points in {words}"
        outcome: Outcome3 = "not testable" if figure is None else _met(figure.survey <= most * _ROUNDING)
        yield Clause(clause=clause, found=f"{figure.survey:.3f} m" if figure else _UNTESTED, limit=f"{most:.3f} m", outcome=outcome)


def _at_most(words: str, found: float | None, limit: float, unit: str) -> Clause:
    if found is None:
        return Clause(clause=words, found="not known", limit=f"{limit:g} {unit}", outcome="not testable")
    return Clause(clause=words, found=f"{found:.4g} {unit}", limit=f"{limit:g} {unit}", outcome=_met(found <= limit * _ROUNDING))


def _coverage(profile: AcceptanceLimits, facts: DeliveryFacts) -> Iterator[Clause]:
    limit = f"{profile.covered:g} % or more"
    for what, share in facts.covered or (("a product on the map", None),):
        outcome: Outcome3 = "not testable" if share is None else _met(share >= profile.covered / _ROUNDING)
        found = "not known" if share is None else f"{share:.4g} %"
        yield Clause(clause=f"area covered by the {what}", found=found, limit=limit, outcome=outcome)


def _days(profile: AcceptanceLimits, facts: DeliveryFacts) -> Iterator[Clause]:
    for words, limit, day, kept in (
        ("first photograph", profile.earliest, facts.first_day, lambda day, limit: day >= limit),
        ("last photograph", profile.latest, facts.last_day, lambda day, limit: day <= limit),
    ):
        if limit is not None:
            outcome: Outcome3 = "not testable" if day is None else _met(kept(day[:10], limit))
            yield Clause(clause=words, found=day or "no times", limit=limit, outcome=outcome)


def _met(kept: bool) -> Outcome3:
    return "met" if kept else "missed"
