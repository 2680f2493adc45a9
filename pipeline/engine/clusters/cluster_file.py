"""A cluster as a YAML file says it: SLURM, Kubernetes, a Dask gateway, or a scheduler that is there already.

The file belongs to a site and not to a project: `orthomill run site --cluster slurm.yaml`.
"""

import re
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, TypeAdapter, ValidationError, model_validator

from orthomill import __version__
from orthomill.pipeline.workflow.mistakes import Mistakes
from orthomill.pipeline.workflow.workflow_text import settings_text
from orthomill.pipeline.workflow.yaml_lines import YamlError, read_yaml
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.settings import Settings, setting

_AHEAD = 300
"""seconds before its walltime at which a worker hands back what it has not begun: what it is doing takes less"""


class _Grows(Settings):
    """A cluster whose workers come as there is work, and leave."""

    workers: int = setting(8, "Workers at most, one process with one thread each; they come as there is work.", ge=1, le=100_000)
    least: int = setting(1, "Workers that stay while the run lasts.", ge=0, le=100_000)
    memory: float = setting(3.0, "Memory of one worker.", "GiB", gt=0.5, le=1000.0)
    patience: float = setting(
        12.0, "Hours to wait for the first worker, and for others where all have left: queues are long.", "h", gt=0, le=1000.0
    )


class SlurmCluster(_Grows):
    """Batch jobs of SLURM, by dask-jobqueue: pip install 'orthomill[slurm]'. All nodes must see your home, and the project's folder
    unless the run has a --store; they take the keys of the store from the environment of the command."""

    kind: Literal["slurm"]
    queue: str | None = setting(None, "Partition; null: the default one.")
    account: str | None = setting(None, "Account that pays.")
    workers_per_job: int = setting(1, "Workers in one batch job, each with a core of its own.", ge=1, le=1024)
    walltime: str = setting(
        "04:00:00",
        "Longest time of a batch job, hours:minutes:seconds; another takes its place.",
        pattern=r"^(\d+-)?\d+:\d{2}:\d{2}$",
    )
    interface: str | None = setting(None, "Network interface that nodes reach this machine by, e.g. ib0; null: the default one.")
    scratch: str | None = setting(None, "Folder of the nodes for temporary files, e.g. $TMPDIR.")
    prologue: tuple[str, ...] = setting((), "Lines of the shell before a worker starts, e.g. module load apptainer.")
    directives: tuple[str, ...] = setting((), "Further options of sbatch, e.g. --constraint=avx2.")
    python: str | None = setting(None, "Python of the nodes, also as 'apptainer exec orthomill.sif python'; null: this one's path.")

    @property
    def seconds(self) -> int:
        """The walltime."""
        days, hours, minutes, seconds = (int(part or 0) for part in re.findall(r"(?:(\d+)-)?(\d+):(\d+):(\d+)", self.walltime)[0])
        return ((24 * days + hours) * 60 + minutes) * 60 + seconds

    @property
    def lifetime(self) -> int:
        """Seconds after which a worker leaves by itself, before it is killed."""
        return max(self.seconds - _AHEAD, self.seconds // 2)


class KubernetesCluster(_Grows):
    """Pods, by the Dask operator and dask-kubernetes: pip install 'orthomill[kubernetes]'. They see the project's folder on
    a volume, or reach the --store of the run with the keys of a secret."""

    kind: Literal["kubernetes"]
    image: str = setting(..., "Image with this version of orthomill.")
    claim: str | None = setting(None, "Volume claim that holds the project's folder, for several pods to write; null: --store.")
    mount: str | None = setting(None, "Where pods see that volume: the path that this command has, too.")
    secret: str | None = setting(
        None, "Secret of the namespace whose entries pods have as environment: the keys of --store, e.g. AWS_ACCESS_KEY_ID."
    )
    namespace: str = setting("default", "Namespace of the pods.")
    name: str = setting("orthomill", "Name of the cluster.", pattern=r"^[a-z]([a-z0-9-]{0,40}[a-z0-9])?$")

    @model_validator(mode="after")
    def _claim_has_a_place(self) -> Self:
        if (self.claim is None) != (self.mount is None):
            raise ValueError("claim and mount say together where the project's folder is; give both, or neither with --store")
        return self


class GatewayCluster(_Grows):
    """A cluster of a Dask gateway, by dask-gateway: pip install 'orthomill[gateway]'. Its settings of cores and memory are the
    gateway's own; `memory` says what a worker has. With a --store its workers have the keys from the gateway's environment."""

    kind: Literal["gateway"]
    address: str | None = setting(None, "Address of the gateway; null: that of Dask's own configuration.")


class SchedulerAddress(Settings):
    """A Dask scheduler that is there already, as with --scheduler."""

    kind: Literal["address"]
    address: str = setting(..., "Its address, e.g. tls://10.0.0.5:8786.", pattern=r"^(tls|tcp)://")
    memory: float = setting(3.0, "Memory of one worker.", "GiB", gt=0.5, le=1000.0)
    ca: str | None = setting(None, "Certificate of the authority (PEM).")
    cert: str | None = setting(None, "Your certificate (PEM).")
    key: str | None = setting(None, "The key of your certificate (PEM).")


StartedCluster = SlurmCluster | KubernetesCluster | GatewayCluster
ClusterFile = Annotated[StartedCluster | SchedulerAddress, Field(discriminator="kind")]
_EXAMPLES: dict[str, Settings] = {
    "slurm": SlurmCluster(kind="slurm"),
    "kubernetes": KubernetesCluster(
        kind="kubernetes", image=f"registry.example/orthomill:{__version__}", claim="projects", mount="/projects"
    ),
    "gateway": GatewayCluster(kind="gateway"),
    "address": SchedulerAddress(kind="address", address="tls://10.0.0.5:8786"),
}
KINDS = tuple(_EXAMPLES)


def cluster_template(kind: str) -> str:
    """A commented file of one of the KINDS."""
    words = " ".join((type(_EXAMPLES[kind]).__doc__ or "").split())
    lines = settings_text(_EXAMPLES[kind]).splitlines(keepends=True)
    # The kind first, as people write it: those that all kinds share come before it in the class.
    lines.sort(key=lambda line: not line.startswith("kind:"))
    return f"# {words}\n# orthomill run PROJECT --cluster THIS_FILE\n{''.join(lines)}"


def read_cluster(path: Path) -> StartedCluster | SchedulerAddress:
    """The cluster of a YAML file. Raises WorkflowError."""
    try:
        document = read_yaml(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise WorkflowError(f"There is no file {path}; write one with: orthomill cluster template slurm > {path}") from None
    except UnicodeDecodeError:
        raise WorkflowError(f"{path} is no text; write a cluster's file with: orthomill cluster template slurm") from None
    except YamlError as error:
        raise WorkflowError(f"{path}:{error.line}: {error.sentence}") from error
    mistakes = Mistakes(str(path), document)
    try:
        return TypeAdapter[StartedCluster | SchedulerAddress](ClusterFile).validate_python(document.value)
    except ValidationError as error:
        mistakes.add_all(error, ClusterFile, ())
        mistakes.raise_if_any()
        raise WorkflowError(f"{path} describes no cluster; write one with: orthomill cluster template slurm") from error
