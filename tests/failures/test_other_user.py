"""Another user of the machine: no way into scheduler and workers, no look at the dashboard, no file with its address."""

import os
import re
import socket
import ssl
import traceback
from pathlib import Path

import psutil
import pytest

from orthomill.pipeline.engine.dask_cluster import local_client
from orthomill.pipeline.engine.running import write_for_the_user_only

NOBODY = 65534
pytestmark = [pytest.mark.slow, pytest.mark.skipif(os.getuid() != 0, reason="only the administrator can become another user")]


def as_another_user(check) -> None:
    """Run `check` in a process of another user, which fails where the check does."""
    child = os.fork()
    if child == 0:
        try:
            os.setgid(NOBODY)
            os.setuid(NOBODY)
            check()
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def answer(port: int, encrypted: bool, question: bytes) -> bytes:
    """What a port says to somebody without a certificate."""
    with socket.create_connection(("127.0.0.1", port), timeout=5) as plain:
        try:
            stream = plain
            if encrypted:
                context = ssl.create_default_context()
                context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
                stream = context.wrap_socket(plain)
            stream.sendall(question)
            return stream.recv(4000)
        except (ssl.SSLError, ConnectionError, TimeoutError):
            return b""


def ports(processes) -> set[int]:
    return {c.laddr.port for process in processes for c in process.net_connections("inet") if c.status == psutil.CONN_LISTEN}


def test_another_user_gets_in_nowhere(tmp_path):
    with local_client(1, 2**30, 8787) as client:
        scheduler = int(re.search(r":(\d+)$", client.scheduler.address)[1])
        dashboard = int(re.search(r":(\d+)/", client.dashboard_link)[1])
        listening = ports(psutil.Process().children(recursive=True)) | {scheduler}
        address = tmp_path / "dashboard.txt"
        write_for_the_user_only(address, client.dashboard_link)
        tmp_path.chmod(0o755)

        def check() -> None:
            for port in listening:
                # A length and a message, as Dask begins; an encrypted port may shake hands before it asks for a certificate.
                assert answer(port, False, b"\1\0\0\0\0\0\0\0") == b"", port
                assert answer(port, True, b"\1\0\0\0\0\0\0\0") == b"", port
            for page in ("/", "/status", "/info/main/workers.html", "/sitemap.json"):
                said = answer(dashboard, False, f"GET {page} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
                assert said == b"" or said.split()[1] in (b"403", b"404"), said
            with pytest.raises(PermissionError):
                Path(address).read_text()

        as_another_user(check)
