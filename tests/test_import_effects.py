"""Importing the product changes nothing for the program that does it."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy  # noqa: F401  the library that has the threads
from threadpoolctl import threadpool_info

ROOT = Path(__file__).parents[1]
OTHERS = ["scipy.ndimage", "rasterio", "pyproj", "zarr", "distributed", "matplotlib", "xarray", "pyarrow", "laspy"]
OTHERS += ["bokeh.plotting", "trimesh", "typer", "PIL", "jinja2", "dask_kubernetes.operator"]
OPTIONAL = {"orthomill.pipeline.engine.clusters.operated_pods": "dask_kubernetes"}
"""modules that only some installations can import, and the library which those have"""
PROGRAM = """
import os
import signal
import warnings
from importlib import import_module

import cv2
import numba
from numba.core import caching, dispatcher

def state():
    return (
        dict(os.environ),
        cv2.getNumThreads(),
        numba.config.CACHE_DIR,
        dispatcher.FunctionCache is caching.FunctionCache,
        numba.get_num_threads(),
        list(warnings.filters),
        [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)],
    )

cv2.setNumThreads(3)
# Libraries of others may do what they want when they are imported: they are there already.
for library in OTHERS:
    try:
        import_module(library)
    except ImportError:
        pass
before = state()
for name in NAMES:
    import_module(name)
assert state() == before, (state(), before)
"""


def test_no_module_changes_opencv_numba_the_environment_or_signals_when_it_is_imported():
    files = [path for folder in ("schemas", "tasks", "pipeline") for path in sorted((ROOT / folder).rglob("*.py"))]
    names = [".".join(("orthomill", *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__") for path in files]
    names = [name for name in names if name not in OPTIONAL or find_spec(OPTIONAL[name])]
    names += [f"orthomill.{path.stem}" for path in sorted((ROOT / "orthomill").glob("*.py")) if path.stem != "__init__"]
    program = PROGRAM.replace("NAMES", repr(names)).replace("OTHERS", repr(OTHERS))
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", program], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-3000:]


def test_linear_algebra_of_the_tests_has_one_thread():
    """With more, which wait for one another, tests of the orientation take ten times as long on a machine that is busy."""
    pools = [pool for pool in threadpool_info() if pool["user_api"] == "blas"]
    assert pools and {pool["num_threads"] for pool in pools} == {1}
