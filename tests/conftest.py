"""Makes the toy stages importable, in this process and in the worker processes that tests start."""

import os
import sys
from pathlib import Path

import orthomill.pipeline  # noqa: F401  gives numerical libraries one thread, as in the command, before any of them is loaded

HERE = str(Path(__file__).parent / "support")
sys.path.insert(0, HERE)
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [HERE, os.environ.get("PYTHONPATH", "")]))
