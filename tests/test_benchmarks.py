"""Every benchmark can be started: what it takes from the stages is still there."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in (ROOT / "benchmarks").rglob("*.py")
    # The first starts all of them; the second runs in the environment of the peer.
    if path.name not in ("__main__.py", "orthority_worker.py", "__init__.py")
)


@pytest.mark.parametrize("module", MODULES)
def test_its_imports_exist(module):
    try:
        importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name and error.name.split(".")[0] in ("benchmarks", "orthomill"):
            raise
        pytest.skip(f"needs {error.name}, a program to compare with")


def test_every_published_check_of_textures_is_made_where_the_page_says():
    checks = importlib.import_module("benchmarks.texture.published_checks_of_textures").CHECKS
    assert list(checks) == [f"A-{number:02d}" for number in range(1, 29)]
    for _, where in checks.values():
        path, _, name = where.partition("::")
        assert (ROOT / path).is_file() and f"def {name}" in (ROOT / path).read_text() if name else (ROOT / path).is_file(), where
