"""A run on a Dask gateway of its own (its local backend), where one is installed; a gateway that fails is a sentence."""

import subprocess
import sys
import time
import urllib.error
import urllib.request
from importlib.util import find_spec
from pathlib import Path

import pytest
from small_site import make_site, start_command

from tests.support.stores.server_ports import free_ports

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not all(map(find_spec, ("dask_gateway", "dask_gateway_server", "sqlalchemy"))),
        reason="no gateway: pip install dask-gateway 'dask-gateway-server[local]'",
    ),
]
BIN = Path(sys.executable).parent
# The server's own words for its workers (dask-scheduler, dask-worker) are not there any more.
CONF = """
c.DaskGateway.backend_class = "dask_gateway_server.backends.local.UnsafeLocalBackend"
c.DaskGateway.address = "127.0.0.1:{0}"
c.Proxy.address = "127.0.0.1:{1}"
c.ClusterConfig.scheduler_cmd = {scheduler}
c.ClusterConfig.worker_cmd = {worker}
c.ClusterConfig.worker_cores = 1
c.ClusterConfig.worker_memory = "2 G"
c.UnsafeLocalBackend.clusters_directory = "{folder}"
"""


@pytest.fixture
def gateway(request, tmp_path):
    """Address of a gateway that ends with the test."""
    ports = free_ports(2)
    worker = [str(BIN / "dask"), "worker"] if request.param == "works" else ["/bin/false"]
    scheduler = [worker[0], "scheduler"] if request.param == "works" else ["/bin/false"]
    (tmp_path / "gateway").mkdir()
    conf = tmp_path / "gateway.py"
    conf.write_text(CONF.format(*ports, scheduler=scheduler, worker=worker, folder=tmp_path / "gateway"))
    server = subprocess.Popen([str(BIN / "dask-gateway-server"), "-f", str(conf)], stdout=-3, stderr=-3)
    address = f"http://127.0.0.1:{ports[1]}"
    try:
        end = time.monotonic() + 60
        while not answers(f"{address}/api/v1/options"):
            assert time.monotonic() < end, "the gateway does not answer"
            time.sleep(0.3)
        yield address
    finally:
        server.terminate()
        server.wait(60)


def answers(address):
    try:
        urllib.request.urlopen(address, timeout=5).close()
    except urllib.error.HTTPError as error:
        return error.code == 401
    except OSError:
        return False
    return True


def run_on(address, root):
    cluster = root / "cluster.yaml"
    cluster.write_text(f"kind: gateway\nworkers: 2\nmemory: 1.5\naddress: {address}\n")
    process = start_command(root, "run", "site", "--cluster", str(cluster), "--until", "tie_points")
    return process, *process.communicate(timeout=400)


@pytest.mark.parametrize("gateway", ["works"], indirect=True)
def test_a_run_on_a_gateway_ends_with_its_results(gateway, tmp_path):
    process, out, errors = run_on(gateway, make_site(tmp_path / "there"))
    assert process.returncode == 0 and "0 failed" in out, out + errors


@pytest.mark.parametrize("gateway", ["fails"], indirect=True)
def test_a_gateway_that_starts_no_cluster_is_a_sentence(gateway, tmp_path):
    process, out, errors = run_on(gateway, make_site(tmp_path / "there"))
    assert process.returncode == 2 and "The gateway does not start a cluster" in " ".join((out + errors).split()), out + errors
    assert "Traceback" not in out + errors
