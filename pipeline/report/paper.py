"""The report on A4 paper: a browser of this machine prints the page, as its reader could.

Browsers lay the page out as it was made; a library that does so as well needs system packages that pip does not install.
"""

import shutil
import subprocess
import tempfile
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
PATIENCE = 180
"""seconds, on a loaded machine"""


def write_pdf(page: Path) -> Path:
    """Print a page beside itself, as .pdf; returns its path. Raises ResourceError where no browser can."""
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        raise ResourceError(
            f"There is no Chromium, Chrome or Edge on this machine to print with; open {page} in any browser and print it to a "
            "file: it is laid out for A4."
        )
    target = page.with_suffix(".pdf")
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
