"""The report on A4 paper: a browser of this machine prints the page, as its reader could; without one, WeasyPrint where it is
installed (orthomill[paper]).

Browsers lay the page out as it was made. The library does not know columns of grids, for which it gets a style sheet of its own,
and needs Pango, a system package that pip does not install; images of containers have both.
"""

import importlib
import logging
import shutil
import subprocess
import tempfile
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from orthomill.schemas.errors import ResourceError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge", "msedge")
FLAGS = (
    "--headless",
    # Without a sandbox, because it is not available to root and in containers; the page is our own and loads nothing.
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
"""for a browser that only shows pages of ours"""
LIBRARY = "weasyprint"
_BLOCKS = files("orthomill.pipeline.report") / "templates" / "paper.css"
PATIENCE = 180
"""seconds, on a loaded machine"""


def can_print() -> bool:
    """Whether this machine has something to print with."""
    return any(map(shutil.which, BROWSERS)) or find_spec(LIBRARY) is not None


def write_pdf(page: Path) -> Path:
    """Print a page beside itself, as .pdf; returns its path. Raises ResourceError where nothing can."""
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    target = page.with_suffix(".pdf")
    if browser is None:
        _print_by_library(page, target)
        return target
    target.unlink(missing_ok=True)
    # A profile of its own: a browser that is open already would take the order and print nothing.
    with tempfile.TemporaryDirectory(prefix="orthomill-print-") as profile:
        printing = "--no-pdf-header-footer", f"--user-data-dir={profile}", f"--print-to-pdf={target.resolve()}"
        order = [browser, *FLAGS, *printing, page.resolve().as_uri()]
        try:
            done = subprocess.run(order, capture_output=True, timeout=PATIENCE, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise ResourceError(
                f"{browser} could not print {page} ({error}); open it in a browser and print it to a file."
            ) from error
    if not target.exists():
        raise ResourceError(f"{browser} ended with code {done.returncode} and printed nothing; open {page} and print it to a file.")
    return target


def _print_by_library(page: Path, target: Path) -> None:
    """Print a page without a browser. Raises ResourceError where the library is not there, or Pango is not."""
    try:
        library = importlib.import_module(LIBRARY)
    # A missing Pango is an OSError of the loader.
    except (ImportError, OSError) as error:
        raise ResourceError(
            f"There is no Chromium, Chrome or Edge on this machine to print with, and no WeasyPrint (pip install "
            f"'orthomill[paper]', and Pango); open {page} in any browser and print it to a file: it is laid out for A4."
        ) from error
    logging.getLogger(LIBRARY).setLevel(logging.ERROR)
    text = page.read_text("utf-8").replace("</style>", f"{_BLOCKS.read_text('utf-8')}</style>", 1)
    library.HTML(string=text, base_url=str(page.parent)).write_pdf(target)
