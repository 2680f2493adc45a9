"""Files of clusters: templates that read back, mistakes with their lines, what a batch job asks for."""

import pytest
from small_site import command

from orthomill.pipeline.engine.clusters.cluster_file import KINDS, SlurmCluster, cluster_template, read_cluster
from orthomill.pipeline.engine.clusters.started_clusters import started_client
from orthomill.pipeline.engine.running import Options
from orthomill.schemas.errors import ResourceError, WorkflowError


@pytest.mark.parametrize("kind", KINDS)
def test_a_template_reads_back(tmp_path, kind):
    (tmp_path / "c.yaml").write_text(cluster_template(kind))
    found = read_cluster(tmp_path / "c.yaml")
    assert found.kind == kind and cluster_template(kind).splitlines()[2].startswith("kind:")
    assert command("cluster", "template", kind)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("kind: slrum\n", r"c.yaml:1: kind.*slrum.*did you mean 'slurm'"),
        ("kind: slurm\nworkers: 2\nmemry: 3\n", r"c.yaml:3: memry.*did you mean 'memory'"),
        ("kind: slurm\nwalltime: 4 hours\n", r"c.yaml:2: walltime"),
        ("kind: slurm\nmemory: 0\n", r"c.yaml:2: memory.*greater than 0.5"),
        ("kind: address\naddress: 10.0.0.5\n", r"c.yaml:2: address"),
        ("kind: kubernetes\n", "image"),
        ("kind: kubernetes\nimage: a\nclaim: projects\n", "claim and mount .* give both, or neither with --store"),
        ("- a\n", "c.yaml"),
        ("kind: [\n", r"c.yaml:\d"),
    ],
)
def test_mistakes_have_lines(tmp_path, text, told):
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(WorkflowError, match=told):
        read_cluster(tmp_path / "c.yaml")


def test_a_missing_file_says_how_to_write_one(tmp_path):
    with pytest.raises(WorkflowError, match="orthomill cluster template slurm"):
        read_cluster(tmp_path / "none.yaml")
    assert "KIND is one of slurm" in command("cluster", "template", "pbs", code=2)


@pytest.mark.parametrize(("walltime", "seconds"), [("00:30:00", 1800), ("4:00:00", 14400), ("2-01:00:30", 176430)])
def test_workers_leave_before_they_are_killed(walltime, seconds):
    cluster = SlurmCluster(kind="slurm", walltime=walltime)
    assert cluster.seconds == seconds and seconds / 2 <= cluster.lifetime < seconds


def test_time_is_estimated_for_the_workers_of_the_cluster():
    options = Options(cluster=SlurmCluster(kind="slurm", workers=40))
    assert options.processes == 40 and options.elsewhere and options.room == options.memory


def test_a_library_that_is_missing_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "dask_jobqueue", None)
    with pytest.raises(ResourceError, match=r"pip install 'orthomill\[slurm\]'"), started_client(SlurmCluster(kind="slurm"), 8787):
        pass
