"""What `orthomill verify` prints: how much was examined, the first of what is damaged, and what happens next; and what `status`
tells of the stages of a run."""

from collections.abc import Iterator

from orthomill.pipeline.records.verification import Verification
from orthomill.schemas.memory import MIB

SHOWN = 10


def verification_lines(found: Verification, project: str) -> Iterator[str]:
    """The lines of the terminal."""
    for path, what in sorted(found.damaged.items())[:SHOWN]:
        yield f"{path} is {what}"
    if len(found.damaged) > SHOWN:
        yield f"... and {len(found.damaged) - SHOWN} more"
    if found.mended:
        yield f"written again: {', '.join(found.mended[:SHOWN])}"
    size = f"{found.files} files with {found.size / MIB:.0f} MiB"
    if found.damaged:
        yield f"{len(found.damaged)} of {size} are lost or damaged; compute them again with: orthomill run {project}"
    else:
        yield f"{size} are whole"
