"""Pages and maps that the run of a task has left, or shows while it goes on.

They hold names of strangers' files, so a browser opens them in a box of their own: without a cookie, reaching nothing but the files
of the same task, which an address of their own opens. The live map is asked of the run's own server, which only this
machine reaches.
"""

import http.client
import re
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from orthomill.pipeline.serving.queue.task_folder import TaskFolder
from orthomill.schemas.memory import MIB

LIVE = frozenset({"tiles", "tiles.json", "outlines.json", "tile.json", "tile.png"})
"""what the map of a run answers to"""
POLICY = (
    "sandbox allow-scripts allow-popups allow-downloads; default-src 'none'; connect-src 'self'; img-src 'self' data: blob:; "
    "style-src 'self' 'unsafe-inline'; script-src 'self' 'unsafe-inline'; font-src data:; frame-ancestors 'self'"
)
HEADERS = {"content-security-policy": POLICY, "access-control-allow-origin": "*", "cross-origin-resource-policy": "cross-origin"}
"""What is in a box is of no site: its own files must let it in. The ticket in the address is the key, and not the site."""
_PAGES = (("report.html", "Report"), ("products/index.html", "Map viewer"), ("tiles.html", "Map of tiles"))
_ADDRESS = "jobs/tiles.txt"
_QUERY = re.compile(r"[a-z]+=[0-9]+(&[a-z]+=[0-9]+)*")
_MOST, _PATIENCE = 64 * MIB, 10.0
"""bytes of an answer of the map, and seconds that it may take"""


@dataclass(frozen=True)
class MapAnswer:
    """An answer of a run's map."""

    content: bytes
    kind: str


def pages(folder: TaskFolder, running: bool) -> list[dict[str, object]]:
    """Titles and paths of the pages that there are; `live` for a map of a run that goes on."""
    live = running and (folder.run / _ADDRESS).is_file()
    found: list[dict[str, object]] = [{"title": "Map of tiles, live", "path": "map/tiles", "live": True}] if live else []
    for path, title in _PAGES:
        if (folder.run / path).is_file() and not (live and path == "tiles.html"):
            found.append({"title": title, "path": path, "live": False})
    return found


def viewed_file(folder: TaskFolder, path: str) -> Path | None:
    """A page of a run, or a file of its products; None for anything else, whatever the path says."""
    wanted = folder.run / path
    if path not in {page for page, _ in _PAGES} and not path.startswith("products/"):
        return None
    inside = wanted.resolve()
    return inside if inside.is_relative_to((folder.run).resolve()) and inside.is_file() else None


def live_answer(folder: TaskFolder, name: str, query: str) -> MapAnswer | None:
    """What the map of a run that goes on says; None where there is none, or it does not answer."""
    if name not in LIVE or (query and not _QUERY.fullmatch(query)):
        return None
    try:
        address = urlsplit((folder.run / _ADDRESS).read_text().strip())
        # The file is the run's own, but whoever could change it must not make this server ask elsewhere.
        if address.hostname != "127.0.0.1" or address.port is None or not address.path.endswith("/tiles"):
            return None
        connection = http.client.HTTPConnection("127.0.0.1", address.port, timeout=_PATIENCE)
        try:
            target = address.path.removesuffix("tiles") + name + (f"?{query}" if query else "")
            connection.request("GET", target)
            answer = connection.getresponse()
            content = answer.read(_MOST)
        finally:
            connection.close()
    except (OSError, http.client.HTTPException, ValueError):
        return None
    return MapAnswer(content, answer.headers.get("Content-Type", "text/html")) if answer.status == 200 else None
