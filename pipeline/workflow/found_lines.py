"""What `init` prints: what was counted, what was left out and why, what the tags tell, what to expect of the flight."""

from collections import Counter
from collections.abc import Iterator
from pathlib import PurePosixPath

from orthomill.pipeline.workflow.photograph_survey import Survey
from orthomill.schemas.findings.flight_findings import FirstLook
from orthomill.schemas.photo import Header


def found_lines(survey: Survey, look: FirstLook) -> Iterator[str]:
    """About ten lines, the most important ones first."""
    used = [header for header in survey.headers if header.path in set(look.used)]
    aside = len(survey.headers) - len(used)
    more = f"; {aside} more set aside" if aside else ""
    yield f"Photographs: {_several(Counter(map(_kind, used)))}{_folders(survey)}{more}."
    if survey.linked:
        yield f"{survey.folder} in this project is now a link to {survey.linked}, which is only read."
    if survey.source.masks is not None:
        yield f"Masks: in {survey.source.masks}; what is black in them is not used by any stage."
    yield from survey.left_out
    yield from look.lines


def _kind(header: Header) -> str:
    """Format, size and depth."""
    suffix = PurePosixPath(header.path).suffix.upper().removeprefix(".")
    name = {"JPG": "JPEG", "TIF": "TIFF"}.get(suffix, suffix)
    colours = "grey" if header.bands == 1 else "RGB"
    return f"{name} of {header.width} x {header.height} px ({colours}, {header.dtype.removeprefix('uint')} bits)"


def _several(kinds: Counter[str]) -> str:
    each = [f"{number} {kind}" for kind, number in kinds.most_common()]
    return each[0] if len(each) == 1 else f"{kinds.total()}: {', '.join(each)}"


def _folders(survey: Survey) -> str:
    """Which folders below they lie in."""
    parts = Counter(PurePosixPath(header.path).parent.relative_to(survey.folder).as_posix() for header in survey.headers)
    named = [f"{folder} ({number})" for folder, number in sorted(parts.items()) if folder != "."]
    return f", in {', '.join(named)}" if named else ""
