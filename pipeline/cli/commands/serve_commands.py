"""The command that serves orthomill to others: an engine of the NodeODM contract, with a queue and a page."""

from pathlib import Path
from typing import Annotated

import typer

from orthomill.pipeline.cli.terminal import Debug, err, plain_errors

serving = typer.Typer()


@serving.command()
def serve(
    folder: Annotated[Path, typer.Argument(help="Folder for uploads, tasks and results.")] = Path("served"),
    host: Annotated[str, typer.Option(help="Address to listen on; 0.0.0.0 is everybody who reaches this machine.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen on.", min=1, max=65535)] = 3000,
    tokens: Annotated[Path | None, typer.Option(help="YAML file with tokens and quotas of several users.")] = None,
    certificate: Annotated[Path | None, typer.Option(help="Certificate for TLS (PEM).")] = None,
    key: Annotated[Path | None, typer.Option(help="Its key (PEM).")] = None,
    tasks: Annotated[int, typer.Option(help="Tasks at a time; they share the cores.", min=1, max=64)] = 1,
    memory: Annotated[int, typer.Option(help="Memory that one worker may use, in MiB.", min=256)] = 1500,
    keep_days: Annotated[float, typer.Option(help="Days that tasks are kept after their end; 0: for ever.", min=0)] = 30.0,
    file_gigabytes: Annotated[float, typer.Option(help="Largest file of an upload, GB.", min=0.001)] = 4.0,
    task_gigabytes: Annotated[float, typer.Option(help="Largest upload, GB.", min=0.001)] = 500.0,
    reserve_gigabytes: Annotated[float, typer.Option(help="Disk that is left free, GB.", min=0)] = 2.0,
    webhooks: Annotated[bool, typer.Option(help="Whether tasks may name an address that is called when they end.")] = True,
    s3: Annotated[
        list[str] | None, typer.Option(help="Prefix of an object store that tasks may read and write below (s3://bucket/prefix).")
    ] = None,
    scheduler: Annotated[
        str, typer.Option(help="Dask scheduler whose workers do the jobs; they see FOLDER by the same path (tcp://10.0.0.5:8786).")
    ] = "",
    debug: Debug = False,
) -> None:
    """Serve as an engine of WebODM and other clients of NodeODM: uploads, a queue that survives, results, and a page of its own."""
    from orthomill.pipeline.serving.node.node_server import NodeSettings
    from orthomill.pipeline.serving.node.node_server import serve as serve_node
    from orthomill.pipeline.serving.queue.task_queue import QueueRules
    from orthomill.pipeline.serving.queue.upload_store import UploadLimits
    from orthomill.tasks.catalogue import STAGES

    with plain_errors(debug):
        reserve, most = int(reserve_gigabytes * 1e9), int(task_gigabytes * 1e9)
        settings = NodeSettings(
            home=folder.resolve(),
            host=host,
            port=port,
            tokens=tokens,
            certificate=certificate,
            key=key,
            webhooks=webhooks,
            prefixes=tuple(s3 or ()),
            rules=QueueRules(
                parallel=tasks, memory=memory, keep_days=keep_days, reserve=reserve, most_bytes=most, scheduler=scheduler
            ),
            limits=UploadLimits(int(file_gigabytes * 1e9), most, reserve=reserve),
        )
        serve_node(settings, STAGES, lambda line: err.print(line, soft_wrap=True, markup=False))
