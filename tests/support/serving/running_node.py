"""A node with the engine that stands in, running: shared by the tests that speak to it as clients do."""

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

TOKEN = "s3cret-s3cret"


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


@dataclass
class RunningNode:
    home: Path
    port: int
    process: subprocess.Popen

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def client(self, token: str = TOKEN) -> Node:
        return Node("127.0.0.1", self.port, token)


@contextmanager
def node(home: Path, port: int = 0, **environment: str) -> Iterator[RunningNode]:
    """A node until the context ends; it is killed then, as a machine that loses its power would do it."""
    port = port or free_port()
    command = [sys.executable, str(Path(__file__).with_name("standin_node.py")), str(home), str(port)]
    home.mkdir(parents=True, exist_ok=True)
    with open(home / "node.log", "ab") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, env={**os.environ, "ORTHOMILL_TOKEN": TOKEN, **environment})
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
