"""`orthomill measure`: features from a file, answers to a file or the terminal."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from orthomill.pipeline.cli.lookups.measured_surface import FileBase, RunBase, RunSurface
from orthomill.pipeline.storage.answer_files import write_answers
from orthomill.pipeline.storage.features.feature_files import read_features
from orthomill.pipeline.storage.height_files import check_height_file
from orthomill.schemas.accuracy.surface_answers import BaseSource, DrawnFeature, MeasuredAnswers, MeasuredSource, MeasureRules
from orthomill.schemas.errors import WorkflowError

Measure = Callable[[MeasuredSource, tuple[DrawnFeature, ...], MeasureRules], MeasuredAnswers]


@dataclass(frozen=True)
class MeasureOptions:
    """What the command line says; lengths in m."""

    base: str
    checked: bool
    corner: float | None
    step: float | None
    output: Path | None


def measured_answers(folder: Path, features: Path, options: MeasureOptions, measure: Measure) -> MeasuredAnswers:
    """The answers, written where a file is named. Raises StoreError, WorkflowError and GeometryError."""
    surface = RunSurface(folder, options.checked)
    cell, drawn = surface.grid.cell, read_features(features, surface.crs)
    level, base = _base(options.base, surface)
    corner = 0.5 * cell if options.corner is None else options.corner
    found = measure(surface, drawn, MeasureRules(level, base, corner, options.step or cell))
    if options.output is not None:
        write_answers(options.output, found, drawn, surface.crs)
    return found


def _base(text: str, surface: RunSurface) -> tuple[float | None, BaseSource | None]:
    """A level, or another surface; neither for the plane through the border."""
    if text == "border":
        return None, None
    try:
        return float(text), None
    except ValueError:
        path = Path(text)
    if path.is_dir():
        other = RunSurface(path)
        if other.crs != surface.crs:
            raise WorkflowError(f"{text} is in {other.crs}, and this project in {surface.crs}; measure projects of one system.")
        return None, RunBase(other, surface.grid)
    if not path.is_file():
        raise WorkflowError(f"--base {text}: give border, a level in m, a file with a surface, or the folder of a run.")
    check_height_file(path)
    return None, FileBase(path, surface.crs, surface.grid)


def answer_lines(answers: MeasuredAnswers) -> Iterator[str]:
    """One line for each answer."""
    for a in answers.answers:
        note = f"  ({a.note})" if a.note else ""
        value = "not known" if a.value != a.value else f"{_digits(a.value, a.sigma)} +- {_two(a.sigma)} {a.unit}"
        yield f"{a.feature}  {a.quantity}: {value}{note}"


def _two(sigma: float) -> str:
    """Two significant digits."""
    return f"{float(f'{sigma:.2g}'):g}"


def _digits(value: float, sigma: float) -> str:
    """As many digits as the standard error has."""
    if sigma > 0:
        shown = f"{float(f'{sigma:.2g}'):f}".rstrip("0")
        return f"{value:.{min(len(shown.partition('.')[2]), 4)}f}"
    return f"{value:.4g}"
