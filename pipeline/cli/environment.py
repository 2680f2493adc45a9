"""The command's entry.

Nothing heavy is imported before the memory of the process is known to suffice: libraries that cannot be loaded end in tracebacks.
"""

import os
import resource
import signal
import sys
import warnings
from types import FrameType

from orthomill.pipeline.engine.one_thread import one_thread_from_here

START_BYTES = 1200 * 2**20
"""Address space that importing everything takes, measured."""


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
    # So are those on systems that are written in an old way ("+init=epsg:2100"): they are read as they are meant.
    if not sys.warnoptions:
        os.environ["PYTHONWARNINGS"] = "ignore::RuntimeWarning,ignore::FutureWarning:pyproj.crs.crs"
        warnings.simplefilter("ignore", RuntimeWarning)
        warnings.filterwarnings("ignore", category=FutureWarning, module=r"pyproj\.crs\.crs")
    one_thread_from_here()
    # Libraries are loaded for seconds; the command itself listens when it has them (`plain_errors`).
    signal.signal(signal.SIGINT, _stopped_early)
    from orthomill.pipeline.cli.commands.application import main as run_command

    run_command()
