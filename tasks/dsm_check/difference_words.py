"""What differences between photographs and surface are called: errors of one of the same time, changes since an earlier one."""

from dataclasses import dataclass


@dataclass(frozen=True)
class AreaWords:
    """What a difference is called: an error, a change; where photographs lie lower or higher than the surface."""

    one: str
    lower: str
    higher: str
    column: str
    title: str
    picture: str
    told: str

    def side(self, dh: float) -> str:
        """dh: m, what must be added to the surface."""
        return self.lower if dh < 0 else self.higher


ERRORS = AreaWords(
    one="an error",
    lower="too high",
    higher="too low",
    column="surface is",
    title="Suspicious areas",
    picture="Check of the surface",
    told="Photographs and surface disagree locally{relative}: the surface is {areas}. Look there in the photographs: "
    "dsm_check_areas.geojson has the outlines.",
)
CHANGES = AreaWords(
    one="a change",
    lower="fallen",
    higher="risen",
    column="ground has",
    title="Changed areas",
    picture="Change since the earlier surface",
    told="The ground has changed{relative}: {areas}. dsm_check_areas.geojson has the outlines; trees, vehicles and what was built "
    "are changes as well.",
)
