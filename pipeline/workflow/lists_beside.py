"""Which lists beside photographs are used: the control and the positions of these photographs, and what is said of others."""

from collections.abc import Iterator
from dataclasses import dataclass

from orthomill.schemas.survey_files.control_recognition import FoundControl, control_in
from orthomill.schemas.survey_files.photograph_names import PhotographNames
from orthomill.schemas.survey_files.recognition import FoundPositions, positions_in

GCP_LIST = "gcp_list.txt"
_MOST = 500
"""points of a list without measurements: longer ones are no control"""


@dataclass(frozen=True)
class ListText:
    """A file: its path in the project, its name, and its text."""

    path: str
    name: str
    text: str


@dataclass(frozen=True)
class ChosenControl:
    """Paths of the control (None: none), its format and the system that it names ("": none)."""

    gcp_list: str | None = None
    points: str | None = None
    marks: str | None = None
    format: str = ""
    system: str | None = None


def choose_control(texts: list[ListText], names: PhotographNames) -> tuple[ChosenControl, list[str]]:
    """The single file of control, or the first list of points and the first measurements of any of them; and sentences about
    control that is not used."""
    found = [(one, control) for one in texts if (control := control_in(one.text, names)) is not None]
    # A file of the usual name comes first, whatever else there is.
    found.sort(key=lambda pair: pair[0].name.lower() != GCP_LIST)
    known = bool(names.names)
    own = [(one, control) for one, control in found if not (known and control.of_others)]
    chosen = next(_single(own), None) or next(_pairs(own), ChosenControl())
    used = {chosen.gcp_list, chosen.points, chosen.marks}
    return chosen, [_unused(one, control, chosen, known) for one, control in found if one.path not in used and _worth(control)]


def _single(found: list[tuple[ListText, FoundControl]]) -> Iterator[ChosenControl]:
    """Files with points and their measurements."""
    for one, control in found:
        if control.holds == "all" and control.format.startswith("GCP list"):
            yield ChosenControl(one.path, format=control.format, system=control.system)
        elif control.holds == "all":
            yield ChosenControl(points=one.path, format=control.format, system=control.system)


def _pairs(found: list[tuple[ListText, FoundControl]]) -> Iterator[ChosenControl]:
    """Points and measurements that name the same points."""
    for points, surveyed in found:
        for marks, seen in found:
            own = {name.casefold() for name in surveyed.names} & {name.casefold() for name in seen.names}
            if surveyed.holds == "points" and seen.holds == "marks" and own:
                yield ChosenControl(None, points.path, marks.path, f"{surveyed.format}, {seen.format}", surveyed.system)


def _worth(control: FoundControl) -> bool:
    """Whether control that is not used is told: long lists of points are trajectories or surfaces."""
    return control.holds != "points" or len(control.names) <= _MOST


def _unused(one: ListText, control: FoundControl, chosen: ChosenControl, known: bool) -> str:
    head = f"{one.path} holds control ({control.format}), but"
    if known and control.of_others:
        return f"{head} names none of these photographs: it is not used."
    if used := chosen.gcp_list or chosen.points:
        return f"{head} {used} is used; name another in the workflow (control)."
    if control.holds == "points":
        return (
            f"{one.path} holds {len(control.names)} points ({control.format}), but no file says where they are in the photographs: "
            "it is not used. Measure them (docs/guide.md, ground control), and name both files in the workflow (control)."
        )
    return f"{head} no file holds the coordinates of its points: it is not used."


def choose_positions(
    texts: list[ListText], names: PhotographNames, taken: set[str | None]
) -> tuple[tuple[str, FoundPositions] | None, list[str]]:
    """The positions of these photographs, the file that names most of them, and sentences about those that are not used."""
    found = [(one.path, list_) for one in texts if one.path not in taken and (list_ := positions_in(one.text, names)) is not None]
    count = len(names.names)
    fitting = [pair for pair in found if pair[1].fits(count)]
    # Names say more than an order; of equals the first counts.
    chosen = max(fitting, key=lambda pair: pair[1].named or 0) if fitting else None
    told = []
    for path, one in found:
        if not one.fits(count):
            told.append(f"{path} holds positions ({one.format}), but {one.misfit(count)}: it is not used.")
        elif chosen and path != chosen[0]:
            told.append(
                f"{path} holds positions as well ({one.format}), but {chosen[0]} is used; name another in the workflow (positions)."
            )
    return chosen, told
