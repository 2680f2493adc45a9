"""A run on a SLURM of its own, where SLURM is installed: workers are batch jobs, one is cancelled, the run ends all the same."""

import os
import shutil
import socket
import subprocess
import time

import pytest
from small_site import SHIPPED, start_command, write_workflow

NEEDED = ("slurmctld", "slurmd", "munged", "scancel", "squeue")
pytestmark = pytest.mark.slow

CONF = """ClusterName=here
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CryptoType=crypto/munge
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
StateSaveLocation={folder}
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SwitchType=switch/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
MpiDefault=none
ReturnToService=2
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory=4000 State=UNKNOWN
PartitionName=main Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


def free_ports(count):
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


@pytest.fixture
def slurm(tmp_path, monkeypatch):
    """The environment of a SLURM with one node, which ends with the test."""
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed: pip install 'orthomill[slurm]'")
    if missing := [name for name in NEEDED if shutil.which(name) is None]:
        pytest.skip(f"SLURM is not installed ({', '.join(missing)}): apt-get install slurmctld slurmd munge slurm-client")
    if os.geteuid() != 0:
        pytest.skip("SLURM's daemons need root.")
    folder = tmp_path / "slurm"
    (folder / "spool").mkdir(parents=True)
    (folder / "munge.key").write_bytes(os.urandom(1024))
    (folder / "munge.key").chmod(0o600)
    conf = folder / "slurm.conf"
    conf.write_text(CONF.format(host=socket.gethostname(), folder=folder, ports=free_ports(2), cpus=os.cpu_count()))
    monkeypatch.setenv("SLURM_CONF", str(conf))
    files = {
        "key-file": "munge.key",
        "socket": "munge.socket",
        "pid-file": "munged.pid",
        "log-file": "munged.log",
        "seed-file": "seed",
    }
    subprocess.run(["munged", "--force", *(f"--{name}={folder / file}" for name, file in files.items())], check=True)
    daemons = [subprocess.Popen([name, "-D", "-f", str(conf)], stdout=-3, stderr=-3) for name in ("slurmctld", "slurmd")]
    until(lambda: "idle" in told("sinfo", "-h", "-o", "%T"), 60, "SLURM has no idle node")
    yield
    told("scancel", "--user", "root")
    for daemon in reversed(daemons):
        daemon.terminate()
        daemon.wait(20)
    os.kill(int((folder / "munged.pid").read_text()), 15)


def told(*words):
    return subprocess.run(words, capture_output=True, text=True, timeout=30).stdout


def until(true, seconds, otherwise):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, otherwise
        time.sleep(0.5)


def test_a_run_survives_the_end_of_a_batch_job(tmp_path, slurm):
    (tmp_path / "photos").mkdir()
    (tmp_path / "workflows").mkdir()
    for photo in sorted(SHIPPED.glob("*.JPG"))[:3]:
        shutil.copy(photo, tmp_path / "photos")
    write_workflow(tmp_path)
    cluster = tmp_path / "slurm.yaml"
    cluster.write_text('kind: slurm\nworkers: 1\nmemory: 1.5\nwalltime: "00:30:00"\ninterface: lo\n')
    too_large = tmp_path / "large.yaml"
    too_large.write_text("kind: slurm\nmemory: 900\n")
    said = start_command(tmp_path, "run", "site", "--cluster", str(too_large)).communicate(timeout=300)
    assert "SLURM refuses the batch jobs" in " ".join(said), said
    process = start_command(tmp_path, "run", "site", "--cluster", str(cluster), "--until", "tie_points")
    until(lambda: told("squeue", "-h", "-t", "R", "-o", "%i"), 300, "no batch job began")
    done = tmp_path / "runs" / "site" / "rasters.zarr"
    until(lambda: done.exists() or process.poll() is not None, 300, "nothing was done")
    first = told("squeue", "-h", "-t", "R", "-o", "%i").split()
    told("scancel", *first)
    out, errors = process.communicate(timeout=400)
    assert process.returncode == 0 and "0 failed" in out, out + errors
    assert not told("squeue", "-h").strip(), "its batch jobs end with the run"
