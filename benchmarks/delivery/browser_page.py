"""A page in a headless Chromium, followed until it says that it is done."""

import base64
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path

from tornado.ioloop import IOLoop
from tornado.websocket import WebSocketClientConnection, websocket_connect

_PORT, _SECONDS = 9333, 300.0
_FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    f"--remote-debugging-port={_PORT}",
    "--remote-allow-origins=*",
    "--window-size=1200,800",
)


def page_says(url: str, picture: Path) -> dict[str, object]:
    """The object that the page puts as JSON into `window.found` when it is done; `picture` (PNG) shows it then. Raises SystemExit
    without a browser, and where the page is not done in time."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        raise SystemExit("There is no Chromium here; install it (Debian: chromium).")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        words = [browser, *_FLAGS, f"--user-data-dir={profile}", "about:blank"]
        process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            return IOLoop(make_current=False).run_sync(lambda: _followed(url, picture))
        finally:
            process.kill()
            process.wait()


async def _followed(url: str, picture: Path) -> dict[str, object]:
    until = time.monotonic() + _SECONDS
    tab = await websocket_connect(_tab(until), max_message_size=1 << 28)
    await _asked(tab, 1, "Page.navigate", url=url)
    number = 2
    while time.monotonic() < until:
        answer = await _asked(tab, number, "Runtime.evaluate", expression="window.found || ''")
        if said := answer["result"].get("value"):
            shot = await _asked(tab, number + 1, "Page.captureScreenshot")
            picture.write_bytes(base64.b64decode(shot["data"]))
            found: dict[str, object] = json.loads(said)
            return found
        number += 1
        time.sleep(1.0)
    raise SystemExit(f"{url} was not done in {_SECONDS:.0f} s.")


def _tab(until: float) -> str:
    """Where the one tab of the browser is spoken to."""
    while True:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{_PORT}/json") as answer:
                return str(next(tab["webSocketDebuggerUrl"] for tab in json.load(answer) if tab["type"] == "page"))
        except (OSError, StopIteration):
            if time.monotonic() > until:
                raise SystemExit("The browser does not start.") from None
            time.sleep(0.2)


async def _asked(tab: WebSocketClientConnection, number: int, method: str, **words: object) -> dict[str, object]:
    await tab.write_message(json.dumps({"id": number, "method": method, "params": words}))
    while True:
        answer = json.loads(await tab.read_message() or '{"id": null}')
        if answer.get("id") == number:
            return dict(answer.get("result", {}))
