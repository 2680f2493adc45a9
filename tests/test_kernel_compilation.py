"""Processes that want the same kernel at the same time compile it once."""

import os
import subprocess
import sys

import pytest

from orthomill.kernels import kernel_compilation

KERNEL = """
from orthomill.kernels.kernel_compilation import njit


@njit()
def kernel(values):
    total = 0
    for i in range(len(values)):
        for j in range(len(values)):
            total += values[i] * values[j]
    return total
"""
MAIN = """
import sys
import numba.core.event as event
import numpy as np
from several import kernel

sys.stdin.readline()
with event.install_recorder("numba:compile") as compiled:
    result = kernel(np.arange(4).astype(sys.argv[1]))
print(len([one for _, one in compiled.buffer if one.is_start]), result)
"""


@pytest.fixture
def ask(tmp_path):
    """Processes that call the kernel with arrays of these types, all at once: how many compiled it, and what came out."""
    (tmp_path / "several.py").write_text(KERNEL)

    def asked(*types: str) -> list[tuple[int, float]]:
        path = os.pathsep.join([str(tmp_path), os.environ["PYTHONPATH"]])
        environment = {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "env": environment}
        processes = [subprocess.Popen([sys.executable, "-c", MAIN, kind], **pipes) for kind in types]
        for process in processes:
            process.stdin.write("go\n")
            process.stdin.flush()
        said = [process.communicate(timeout=300)[0].split() for process in processes]
        return [(int(count), float(result)) for count, result in said]

    return asked


def test_one_process_compiles_what_three_want_at_once(ask):
    found = ask("int64", "int64", "int64")
    assert sorted(count for count, _ in found) == [0, 0, 1] and {result for _, result in found} == {36.0}


def test_two_types_at_once_are_both_kept(ask):
    assert ask("int64", "float64", "int32") == [(1, 36.0)] * 3
    assert ask("float64", "int32", "int64") == [(0, 36.0)] * 3


def test_a_folder_that_cannot_be_written_or_locked_keeps_nobody_waiting(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    assert kernel_compilation._locked(tmp_path / "file", "kernel.lock") is None
    first = kernel_compilation._locked(tmp_path, "kernel.lock")
    assert first is not None
    monkeypatch.setattr(kernel_compilation, "PATIENCE", 0.2)
    assert kernel_compilation._locked(tmp_path, "kernel.lock") is None
    first.close()
