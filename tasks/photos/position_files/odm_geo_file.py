"""OpenDroneMap's geo.txt: the reference system, then lines of photograph, x, y and optionally height, yaw, pitch, roll, standard
errors in plan and height.

x is east or longitude. Source: OpenDroneMap's documentation, "Image geolocation files"; opendm/geo.py.
"""

import math
import re

from orthomill.schemas.survey_files.photograph_names import is_image_word
from orthomill.schemas.survey_files.recognition import looks_like_system, of_geo_line
from orthomill.schemas.survey_files.sniffed_table import Separation, lines_of, separation
from orthomill.schemas.survey_files.written_steps import ENOUGH_HEIGHTS, ENOUGH_IN_PLAN, written_step
from orthomill.tasks.geometry.coordinate_ranges import coordinate_mistake, sigma_mistake
from orthomill.tasks.photos.position_files.listed_positions import ListedPosition, PositionList, Triple


def is_geo_file(text: str) -> bool:
    """Whether a text is a list below the name of a reference system."""
    lines = [line for _, line in lines_of(text, ("#",)).others]
    if len(lines) < 2 or is_image_word(re.split(r"[\s,;]", lines[0].strip())[0]) or not looks_like_system(lines[0]):
        return False
    match = of_geo_line(lines[1])
    if match is None:
        return False
    sign = separation([match[1]])
    return all(sign.coordinate(cell) is not None for cell in sign.cells(match[1])[:2])


def read_geo_file(text: str) -> PositionList:
    """The positions of a geo.txt, in the system of its first line."""
    lines = lines_of(text, ("#",)).others
    matches = [(number, line, of_geo_line(line)) for number, line in lines[1:]]
    sign = separation([match[1] for _, _, match in matches if match])
    found, mistakes = [], []
    for number, line, match in matches:
        one = _listed(number, *match, sign) if match else f"'{line.strip()[:60]}' must hold photograph, x, y and height"
        if isinstance(one, str):
            mistakes.append(f"Line {number} of geo.txt: {one}.")
        else:
            found.append(one)
    angles = "yaw, pitch, roll" if any(one.yaw_pitch_roll for one in found) else None
    cells = [sign.cells(match[1]) for _, _, match in matches if match]
    plan = written_step((cell for row in cells for cell in row[:2]), ENOUGH_IN_PLAN)
    steps = (plan, written_step((row[2] for row in cells if len(row) > 2), ENOUGH_HEIGHTS))
    named = lines[0][1].strip()
    return PositionList("geo.txt of OpenDroneMap", tuple(found), named, mistakes=tuple(mistakes), angles=angles, steps=steps)


def _listed(line: int, name: str, rest: str, sign: Separation) -> ListedPosition | str:
    numbers: list[float] = []
    # Words after the numbers are allowed, and ignored as OpenDroneMap does.
    for cell in sign.cells(rest):
        if (value := sign.coordinate(cell)) is None:
            break
        numbers.append(value)
    if len(numbers) < 2 or math.isnan(numbers[0]) or math.isnan(numbers[1]):
        return f"'{name} {rest[:40]}' must hold photograph, x, y and height"
    place: Triple = (numbers[0], numbers[1], numbers[2] if len(numbers) > 2 else math.nan)
    checks = [("x", coordinate_mistake(place[0])), ("y", coordinate_mistake(place[1]))]
    sigma: Triple | None = (numbers[6], numbers[6], numbers[7]) if len(numbers) > 7 and min(numbers[6:8]) > 0.0 else None
    checks += [("standard error", sigma_mistake(value)) for value in (sigma or ())]
    for word, mistake in checks:
        if mistake:
            return f"{word} {mistake}"
    angles: Triple | None = (numbers[3], numbers[4], numbers[5]) if len(numbers) > 5 else None
    return ListedPosition(line, name, place, sigma, yaw_pitch_roll=angles if angles and all(map(math.isfinite, angles)) else None)
