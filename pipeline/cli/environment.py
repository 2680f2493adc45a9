"""The command's entry, and what a system that refuses memory or a path is answered with.

Nothing heavy is imported before the memory of the process is known to suffice: libraries that cannot be loaded end in tracebacks.
"""

import errno
import os
import resource
import signal
import sys
import warnings
from types import FrameType

START_BYTES = 1200 * 2**20
"""Address space that importing everything takes, measured."""
_REFUSALS = {
    errno.ENAMETOOLONG: "is longer than this system allows",
    errno.ENOSPC: "cannot be written: the disk is full",
    errno.EDQUOT: "cannot be written: your quota of disk space is used up",
    errno.EROFS: "cannot be written: its file system is read-only",
    errno.EACCES: "must not be read or written by you",
    errno.EPERM: "must not be read or written by you",
    errno.ELOOP: "is a link that leads to itself",
    errno.EMFILE: "cannot be opened: this shell allows too few open files (ulimit -n)",
}


def environment_sentence(error: OSError | MemoryError) -> str | None:
    """What the system refused, as a sentence; None for errors that say nothing of the user's system."""
    if isinstance(error, MemoryError):
        return "The system refused more memory; close other programs, or raise the limit of this shell (ulimit -v)."
    reason = _REFUSALS.get(error.errno or 0)
    if reason is None or error.filename is None:
        return None
    name = str(error.filename)
    shown = name if len(name) <= 200 else f"{name[:60]}...{name[-20:]} ({len(name)} characters)"
    return f"{shown.encode('unicode_escape').decode()} {reason}."


def _stopped_early(number: int, frame: FrameType | None) -> None:
    """Ctrl-C while libraries are loaded: an exception would come out of one of them with a traceback."""
    sys.stderr.write("Stopped before anything was done.\n")
    sys.stderr.flush()
    os._exit(130)


def main() -> None:
    """Entry point of the command."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if 0 <= limit < START_BYTES:
        sys.stderr.write(
            f"error: This shell allows a process {limit / 2**20:.0f} MiB of memory (ulimit -v), but orthomill needs "
            f"{START_BYTES / 2**20:.0f} MiB to start; raise the limit with 'ulimit -v unlimited'.\n"
        )
        sys.exit(2)
    # Remarks on numbers that are not finite are for developers: what is refused for them says so in a sentence. Workers inherit it.
    if not sys.warnoptions:
        os.environ["PYTHONWARNINGS"] = "ignore::RuntimeWarning"
        warnings.simplefilter("ignore", RuntimeWarning)
    # Libraries are loaded for seconds; the command itself listens afterwards.
    signal.signal(signal.SIGINT, _stopped_early)
    from orthomill.pipeline.cli.commands import main as run_command

    run_command()
