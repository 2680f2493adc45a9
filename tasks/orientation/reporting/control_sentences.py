"""Findings about control in words."""

from orthomill.schemas.findings.control_findings import ControlElsewhere, ControlFinding

GEOGRAPHIC = "EPSG:4326"


def control_sentence(finding: ControlFinding) -> str:
    """A whole sentence, with what to do."""
    if isinstance(finding, ControlElsewhere):
        return (
            f"The {finding.points} control points, read as {finding.crs}, are {finding.distance_m / 1000:.0f} km from where the "
            f"photographs were taken; {_advice(finding)}. They were set aside and took no part in the adjustment."
        )
    return f"Heights of control points were not transformed: only {finding.crs} defines a vertical datum."


def _advice(finding: ControlElsewhere) -> str:
    if finding.fits is None:
        return "check the reference system, the order of the axes and the zone"
    system = "" if finding.fits == finding.crs else f"in {finding.fits}"
    # In degrees people exchange latitude and longitude, on a map X and Y.
    axes = "latitude before longitude" if finding.fits == GEOGRAPHIC else "X and Y exchanged"
    return " ".join(word for word in ("they would be there", system, f"with {axes}" if finding.exchanged else "") if word)
