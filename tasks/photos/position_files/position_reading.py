"""Any positions file to the list that it holds: the format is recognised by the content, not by the name."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from orthomill.schemas.errors import WorkflowError, first_of
from orthomill.schemas.survey_files.photograph_names import photo_stem
from orthomill.schemas.survey_files.written_steps import with_rounding
from orthomill.tasks.photos.position_files.event_files import is_mrk, is_pos, read_mrk, read_pos
from orthomill.tasks.photos.position_files.listed_positions import ListedPosition, PositionList, Triple
from orthomill.tasks.photos.position_files.odm_geo_file import is_geo_file, read_geo_file
from orthomill.tasks.photos.position_files.position_tables import read_table

_IMPOSSIBLE = 7.0
"""m: no receiver that saw four satellites is worse in plan; files that say so mean millimetres"""
_IMPOSSIBLE_FIXED = 1.0
"""m: the same for solutions with fixed ambiguities"""
_OF_TAGS = 5.0
"""m: heights of GPS tags"""
_LEAST: dict[str, Triple] = {"float": (0.2, 0.2, 0.4), "single": (1.5, 1.5, 3.0)}
"""m: what a float and a single solution are worth at best; the standard errors that receivers state for them are formal"""


def read_positions(text: str, unit: str | None = None) -> PositionList:
    """The positions of a file of any format that is known, standard errors in metres; `unit`: "m" or "mm", where the workflow
    states what standard errors are in.

    Raises WorkflowError with the first mistakes, one a line.
    """
    listed = _without_zero_angles(_read(text))
    mistakes = [*listed.mistakes, *_twice(listed)]
    if mistakes:
        raise WorkflowError(first_of(mistakes))
    if not listed.positions:
        raise WorkflowError("The positions file holds no position; fill it in, or set positions: {kind: none}.")
    return _in_metres(listed, unit)


def _read(text: str) -> PositionList:
    if "\0" in text:
        raise WorkflowError("The positions file holds NUL bytes: it is no text; save it as plain text in UTF-8.")
    for recognises, read in ((is_mrk, read_mrk), (is_pos, read_pos), (is_geo_file, read_geo_file)):
        if recognises(text):
            return read(text)
    return read_table(text)


def _without_zero_angles(listed: PositionList) -> PositionList:
    """The list without angles that are all 0: programs write so where there are none, and no flight keeps to the north."""
    turns = [turn for one in listed.positions for turn in (one.omega_phi_kappa, one.yaw_pitch_roll) if turn]
    if len(turns) < 2 or any(any(turn) for turn in turns):
        return listed
    bare = tuple(replace(one, omega_phi_kappa=None, yaw_pitch_roll=None) for one in listed.positions)
    return replace(listed, positions=bare, angles=None)


def _twice(listed: PositionList) -> list[str]:
    """The mistakes of photographs that two lines name."""
    seen: dict[str, int] = {}
    said = []
    for one in listed.positions if listed.named else ():
        name = photo_stem(one.name)
        if name in seen:
            said.append(f"Line {one.line} of the positions file names the photograph {name} a second time; keep one of the lines.")
        seen.setdefault(name, one.line)
    return said


def _in_metres(listed: PositionList, unit: str | None) -> PositionList:
    """The list with its standard errors in metres. Raises WorkflowError where they can only be millimetres and nothing says so."""
    if unit == "mm":
        return replace(listed, positions=tuple(map(_from_millimetres, listed.positions)))
    for limit, word, group in (
        (_IMPOSSIBLE_FIXED, "solutions with fixed ambiguities have", [one for one in listed.positions if one.fix == "fixed"]),
        (_IMPOSSIBLE, "receivers have", [one for one in listed.positions if one.fix is None]),
    ):
        plan = [max(one.sigma[:2]) for one in group if one.sigma]
        if plan and unit is None and not listed.unit_stated and float(np.median(plan)) >= limit:
            shown = ", ".join(f"{value:g}" for value in next(one.sigma for one in group if one.sigma))
            raise WorkflowError(
                f"The positions file gives standard errors of {shown}, which read as metres are larger than {word}: are they "
                "millimetres? State their unit: positions: {..., errors_in: mm}, or errors_in: m if they are meant."
            )
    return listed


def _from_millimetres(one: ListedPosition) -> ListedPosition:
    return replace(one, sigma=(one.sigma[0] / 1000.0, one.sigma[1] / 1000.0, one.sigma[2] / 1000.0)) if one.sigma else one


class Deserved(NamedTuple):
    """The standard errors (m) that a position deserves; whether they are larger than stated because of the kind of its solution,
    and because its coordinates are rounded."""

    sigma: Triple
    raised: bool = False
    rounded: bool = False


def standard_errors(
    one: ListedPosition, defaults: tuple[float, float], steps: tuple[float, float], without_height: bool = False
) -> Deserved:
    """What a position is good to; `defaults`: standard errors in plan and height where the file states none; `steps`: to which plan
    and heights are written, m; `without_height`: whether its height is that of the tags."""
    least = _LEAST.get(one.fix or "")
    stated = one.sigma or least or (defaults[0], defaults[0], defaults[1])
    own = (max(stated[0], least[0]), max(stated[1], least[1]), max(stated[2], least[2])) if least else stated
    if without_height:
        own, steps = (own[0], own[1], max(own[2], _OF_TAGS)), (steps[0], 0.0)
    plan, height = steps
    rounded = (with_rounding(own[0], plan), with_rounding(own[1], plan), with_rounding(own[2], height))
    return Deserved(rounded, own[:2] != stated[:2], rounded != own)
