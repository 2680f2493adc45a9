"""A node with the engine that stands in, as a process of its own: python standin_node.py HOME PORT [parallel]."""

import os
import sys
from pathlib import Path

from benchmarks.serving import standin_engine
from orthomill.pipeline.serving.node.node_server import NodeSettings, serve
from orthomill.pipeline.serving.queue.task_queue import QueueRules
from orthomill.pipeline.serving.queue.upload_store import UploadLimits
from orthomill.tasks.catalogue import STAGES

ENGINE = (sys.executable, standin_engine.__file__)


def main(home: str, port: str, parallel: str = "1") -> None:
    """Serve until the process is killed."""
    rules = QueueRules(parallel=int(parallel), memory=1, reserve=0, paper=False, engine=ENGINE)
    prefixes = tuple(filter(None, [os.environ.get("STANDIN_PREFIX", "")]))
    tokens = Path(given) if (given := os.environ.get("STANDIN_TOKENS", "")) else None
    limits = UploadLimits(reserve=0)
    settings = NodeSettings(Path(home).resolve(), port=int(port), tokens=tokens, prefixes=prefixes, rules=rules, limits=limits)
    serve(settings, STAGES, lambda line: print(line, flush=True))


if __name__ == "__main__":
    main(*sys.argv[1:])
