"""A node with the engine that stands in, running: shared by the tests that speak to it as clients do."""

import http.client
import os
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from PIL import Image
from pyodm import Node

from benchmarks.serving import standin_node
from orthomill.pipeline.serving.queue.task_process import ENGINE

TOKEN = "s3cret-s3cret"
ROOT = Path(__file__).parents[2]


def free_port() -> int:
    """A port of this machine that nobody has."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


@dataclass
class RunningNode:
    """A node that answers."""

    home: Path
    port: int
    process: subprocess.Popen

    def client(self, token: str = TOKEN) -> Node:
        """PyODM, as WebODM has it."""
        return Node("127.0.0.1", self.port, token)


def asked(
    running: RunningNode, method: str, path: str, body: bytes | None = None, **headers: str
) -> tuple[int, bytes, dict[str, str]]:
    """Code, content and headers of an answer; the path goes out as it is, where other clients would mend it."""
    connection = http.client.HTTPConnection("127.0.0.1", running.port, timeout=60)
    try:
        connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
        answer = connection.getresponse()
        return answer.status, answer.read(), {name.lower(): value for name, value in answer.getheaders()}
    finally:
        connection.close()


@contextmanager
def node(home: Path, port: int = 0, parallel: int = 1, real: bool = False, **environment: str) -> Iterator[RunningNode]:
    """A node until the context ends; it is killed then, as a machine that loses its power would do it. `real`: the command `serve`
    with the engine itself."""
    port = port or free_port()
    command = [sys.executable, "-m", standin_node.__name__, str(home), str(port), str(parallel)]
    if real:
        command = [*ENGINE, "serve", str(home), "--port", str(port), "--tasks", str(parallel)]
    home.mkdir(parents=True, exist_ok=True)
    known = os.environ | {"ORTHOMILL_TOKEN": TOKEN} | environment
    with open(home / "node.log", "ab") as log:
        process = subprocess.Popen(command, cwd=ROOT, stdout=log, stderr=log, env=known)
    try:
        _until_it_answers(port, process, home / "node.log")
        yield RunningNode(home, port, process)
    finally:
        process.kill()
        process.wait()


def _until_it_answers(port: int, process: subprocess.Popen, log: Path) -> None:
    until = time.monotonic() + 60
    while True:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/health", timeout=5):
                return
        except OSError:
            if process.poll() is not None or time.monotonic() > until:
                raise AssertionError(log.read_text()) from None
            time.sleep(0.05)


def photographs(folder: Path, names: tuple[str, ...] = ("a.jpg", "b.jpg")) -> list[str]:
    """Files of small pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    content = BytesIO()
    Image.new("RGB", (32, 24), (90, 120, 60)).save(content, "JPEG")
    for name in names:
        (folder / name).write_bytes(content.getvalue())
    return [str(folder / name) for name in names]
