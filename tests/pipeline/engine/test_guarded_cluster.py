"""A cluster of this machine belongs to the user who started it: whoever else connects is refused, and sees no page."""

import os
import socket
import ssl
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import psutil
import pytest
from distributed.comm import CommClosedError
from distributed.security import Security
from toy_stages import MEMORY

from orthomill.pipeline.engine import dask_cluster
from orthomill.pipeline.engine.dashboard_guard import new_secret
from orthomill.pipeline.engine.dask_cluster import local_client
from orthomill.schemas.errors import ResourceError


@pytest.fixture(scope="module")
def client():
    with local_client(1, MEMORY, 8787) as found:
        yield found


@pytest.fixture(scope="module")
def listening(client):
    """The ports of this process and its workers on which something listens, apart from the dashboard's."""
    me = psutil.Process()
    connections = [one for process in (me, *me.children(recursive=True)) for one in process.net_connections(kind="inet")]
    assert all(one.laddr.ip == "127.0.0.1" for one in connections if one.status == psutil.CONN_LISTEN)
    return {one.laddr.port for one in connections if one.status == psutil.CONN_LISTEN} - {dashboard_port(client)}


def dashboard_port(client):
    return int(client.dashboard_link.split(":")[2].split("/")[0])


def context_with(tmp_path, security):
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    if security:
        pem = tmp_path / "own.pem"
        pem.write_text(security.tls_client_key + security.tls_client_cert)
        context.load_cert_chain(pem)
    return context


def is_greeted(port, context, patience=1.0):
    """Whether a Dask process says anything to somebody who connects; it speaks first. Without `context` in plain TCP."""
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=patience) as plain:
            if context is None:
                plain.sendall(bytes(64))  # no beginning of TLS, which the process would go on waiting for
                return bool(plain.recv(100))
            with context.wrap_socket(plain) as connection:
                return bool(connection.recv(100))
    except OSError:
        return False


def test_only_the_certificate_of_this_run_opens_its_processes(client, listening, tmp_path):
    own = context_with(tmp_path, client.security)
    scheduler = int(client.scheduler.address.rsplit(":", 1)[1])
    assert scheduler in listening and is_greeted(scheduler, own, patience=20.0)
    for stranger in (None, context_with(tmp_path, None), context_with(tmp_path, Security.temporary())):
        assert not any(is_greeted(port, stranger) for port in listening)


def status_of(url):
    try:
        with urllib.request.urlopen(url, timeout=20) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode() + str(error.headers)
    except (urllib.error.URLError, OSError):
        return 0, ""


def test_no_page_is_found_without_the_secret_and_none_tells_it(client):
    link = client.dashboard_link
    secret = link.split("/")[3]
    assert status_of(link)[0] == 200 and len(secret) >= 20
    site = f"http://127.0.0.1:{dashboard_port(client)}"
    guesses = (
        "",
        "status",
        "sitemap.json",
        "info/main/workers.html",
        "json/counts.json",
        f"{new_secret()}/status",
        secret[:-1],
        "health",
    )
    for path in guesses:
        code, said = status_of(f"{site}/{path}")
        assert code == 404 and secret not in said, path


def test_workers_answer_nothing_over_http(client, listening):
    for port in listening:
        for path in ("info/main.html", "metrics", "json/counts.json", "health", ""):
            assert status_of(f"http://127.0.0.1:{port}/{path}")[0] in (0, 404)


STRANGER = """
import socket, sys
for port in map(int, sys.argv[1:]):
    with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
        connection.sendall(bytes(64))
        try:
            assert not connection.recv(100)
        except ConnectionError:
            pass
"""


@pytest.mark.skipif(os.geteuid() != 0 or not Path("/usr/bin/python3").exists(), reason="another user can be taken on by root only")
def test_another_user_of_the_machine_is_not_greeted(client, listening):
    scheduler = client.scheduler.address.rsplit(":", 1)[1]
    words = ["/usr/bin/python3", "-I", "-c", STRANGER, scheduler]
    subprocess.run(words, user=65534, group=65534, extra_groups=[], check=True, cwd="/", timeout=60)


def test_the_certificate_stays_in_memory(client):
    """Neither the arguments nor the environment of a worker, which others may read, hold the key."""
    for worker in psutil.Process().children(recursive=True):
        if sys.executable.rsplit("/", 1)[1] in " ".join(worker.cmdline()):
            seen = " ".join(worker.cmdline()) + " ".join(worker.environ().values())
            assert "PRIVATE KEY" not in seen


class Answering:
    """A client whose worker answers every question alike."""

    def __init__(self, answer: object) -> None:
        self.answer = answer

    def run(self, function, name, **options):
        if self.answer is TimeoutError:
            raise TimeoutError
        return {"tcp://one:1": self.answer}


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ("0.0.1", "The worker tcp://one:1 has orthomill 0.0.1, and this is "),
        (SyntaxError("half a file"), r"one:1 cannot load orthomill \(SyntaxError: half a file\); start it again\."),
        (TimeoutError, r"A worker did not load orthomill within 10 minutes; start it again\."),
    ],
)
def test_a_worker_with_another_program_is_refused(monkeypatch, answer, said):
    monkeypatch.setattr(dask_cluster, "PROGRAM", ("orthomill:__version__",))
    with pytest.raises(ResourceError, match=said):
        dask_cluster._check_program(Answering(answer), "start it again")


def test_a_worker_that_ends_while_it_is_asked_is_not_refused(monkeypatch):
    monkeypatch.setattr(dask_cluster, "PROGRAM", ("orthomill:__version__",))
    dask_cluster._check_program(Answering(CommClosedError("Stream is closed")), "start it again")
