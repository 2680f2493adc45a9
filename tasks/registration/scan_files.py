"""Scanned targets and control of a registration, from CSV texts. All mistakes are reported together, one sentence each."""

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass

from orthomill.schemas.errors import WorkflowError, first_of
from orthomill.tasks.geometry.coordinate_ranges import coordinate_mistake, sigma_mistake

SCAN_COLUMNS = ("name", "x", "y", "z")
CONTROL_COLUMNS = ("name", "role", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
ROLES = ("control", "check")

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Target:
    """A target in one scan: coordinates in its own system and the standard error of each, m."""

    xyz: Triple
    sigma: float


@dataclass(frozen=True)
class SurveyedTarget:
    """A target in the project's system: control takes part in the adjustment, a check point is only compared with it."""

    role: str
    xyz: Triple
    sigma: Triple


def read_scan(text: str, file: str, sigma: float) -> dict[str, Target]:
    """The targets of one scan by name: a CSV text with SCAN_COLUMNS, m, and optionally `sigma`, else that given.

    Raises WorkflowError that lists every mistake in the file.
    """
    mistakes: list[str] = []
    found: dict[str, Target] = {}
    for line, row in _rows(text, file, SCAN_COLUMNS, mistakes):
        where = f"{file}, line {line}, target {row['name']}"
        own = {"sigma": row["sigma"]} if row.get("sigma") else {}
        values = _numbers({**{axis: row[axis] for axis in "xyz"}, **own}, where, mistakes)
        if row["name"] in found:
            mistakes.append(f"{where} occurs twice; names must differ within a scan.")
        elif values:
            found[row["name"]] = Target((values[0], values[1], values[2]), values[3] if own else sigma)
    if not found and not mistakes:
        mistakes.append(f"{file} holds no targets; a scan needs three or more.")
    if mistakes:
        raise WorkflowError(first_of(mistakes))
    return found


def read_surveyed(text: str) -> dict[str, SurveyedTarget]:
    """Control and check points by name: a CSV text with CONTROL_COLUMNS, m. Raises WorkflowError that lists every mistake."""
    mistakes: list[str] = []
    found: dict[str, SurveyedTarget] = {}
    for line, row in _rows(text, "The control points file", CONTROL_COLUMNS, mistakes):
        where = f"Control points file, line {line}, point {row['name']}"
        values = _numbers({name: row[name] for name in CONTROL_COLUMNS[2:]}, where, mistakes)
        if row["role"] not in ROLES:
            mistakes.append(f"{where} has the role '{row['role']}'; allowed are control and check.")
        elif row["name"] in found:
            mistakes.append(f"{where} occurs twice; names must differ.")
        elif values:
            x, y, z, sigma_x, sigma_y, sigma_z = values
            found[row["name"]] = SurveyedTarget(row["role"], (x, y, z), (sigma_x, sigma_y, sigma_z))
    if mistakes:
        raise WorkflowError(first_of(mistakes))
    return found


def _rows(text: str, file: str, columns: tuple[str, ...], mistakes: list[str]) -> Iterator[tuple[int, dict[str, str]]]:
    """Line numbers and cells, absent ones empty; lines that begin with # are comments."""
    lines = enumerate(text.lstrip("\ufeff").splitlines(), 1)
    kept = [(number, line) for number, line in lines if line.strip() and not line.startswith("#")]
    reader = csv.DictReader([line for _, line in kept], skipinitialspace=True, restval="")
    try:
        missing = [name for name in columns if name not in (reader.fieldnames or ())]
        if missing:
            mistakes.append(f"{file} lacks the column(s) {', '.join(missing)}; its first line must be: {','.join(columns)}.")
            return
        for row in reader:
            yield kept[reader.line_num - 1][0], {name: (cell or "").strip() for name, cell in row.items() if isinstance(name, str)}
    except csv.Error as error:
        mistakes.append(f"{file} cannot be read as CSV ({error}).")


def _numbers(cells: dict[str, str], where: str, mistakes: list[str]) -> tuple[float, ...]:
    """The numbers of a row; none, and a mistake, where one is missing, not finite, or a standard error that is not positive."""
    values = []
    for name, cell in cells.items():
        is_sigma = name.startswith("sigma")
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or (is_sigma and value <= 0):
            mistakes.append(f"{where}: {name} is '{cell[:40]}', which must be {'a positive number' if is_sigma else 'a number'}.")
            return ()
        if wrong := sigma_mistake(value) if is_sigma else coordinate_mistake(value):
            mistakes.append(f"{where}: {name} {wrong}.")
            return ()
        values.append(value)
    return tuple(values)
