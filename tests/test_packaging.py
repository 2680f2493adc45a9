"""The package as it is installed: one name at the top of site-packages, whatever lies in the user's folder."""

import json
import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest
from small_site import make_site

ROOT = Path(__file__).parents[1]
FOLDERS = ("orthomill", "pipeline", "schemas", "tasks")
INTRUDER = 'raise ImportError("a file of the user was taken for a part of orthomill")\n'


@pytest.fixture(scope="module")
def clone(tmp_path_factory) -> Path:
    """What somebody has after `git clone` and nothing else."""
    place = tmp_path_factory.mktemp("clone") / "orthomill"
    subprocess.run(["git", "clone", "--quiet", "--no-hardlinks", str(ROOT), str(place)], check=True, timeout=300)
    return place


def test_an_editor_resolves_our_imports_in_a_fresh_clone(clone):
    """Without any installation: our own modules are found, and what is defined in them is known."""
    files = ("tasks/densification/matching_block.py", "pipeline/workflow/mistakes.py", "orthomill/photograph_matching.py")
    command = [str(Path(sys.executable).parent / "basedpyright"), "--outputjson", *files]
    said = subprocess.run(command, cwd=clone, capture_output=True, text=True, timeout=300)
    answer = json.loads(said.stdout)
    assert answer["summary"]["filesAnalyzed"] == len(files)
    unresolved = [entry["message"] for entry in answer["generalDiagnostics"] if "orthomill" in entry["message"]]
    assert not unresolved


def test_a_clone_without_links_says_what_to_do(tmp_path):
    command = ["git", "-c", "core.symlinks=false", "clone", "--quiet", "--no-hardlinks", str(ROOT), str(tmp_path / "clone")]
    subprocess.run(command, check=True, timeout=300)
    said = subprocess.run(
        [sys.executable, "-c", "import orthomill"], cwd=tmp_path / "clone", capture_output=True, text=True, timeout=60
    )
    assert said.returncode == 1
    assert "git config core.symlinks true" in said.stderr.splitlines()[-1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel, built from a copy of the tracked folders so that nothing is left behind in the checkout."""
    place = tmp_path_factory.mktemp("wheel")
    source = place / "source"
    source.mkdir()
    for name in (*FOLDERS, "pyproject.toml", "README.md", "LICENSE", "NOTICE"):
        (source / name).symlink_to(ROOT / name)
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(place), str(source)]
    subprocess.run(command, check=True, capture_output=True, text=True, timeout=300)
    return next(place.glob("*.whl"))


def test_the_wheel_brings_one_name_and_all_that_is_no_code(wheel):
    names = (made := zipfile.ZipFile(wheel)).namelist()
    assert {name.split("/")[0] for name in names if ".dist-info" not in name} == {"orthomill"}
    assert {"orthomill/pipeline/report/templates/report.html", "orthomill/tasks/simulation/textures/village.jpg"} <= set(names)
    # A link in the checkout, a file in the wheel.
    assert made.read("orthomill/pipeline/cli/volos_small.yaml") == (ROOT / "workflows" / "volos_small.yaml").read_bytes()
    modules = {name for name in names if name.endswith(".py")}
    assert len(modules) == len({path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")})


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Path:
    """The scripts of a fresh environment with the wheel; the libraries are those of this one, without this checkout."""
    place = tmp_path_factory.mktemp("environment")
    venv.create(place, with_pip=False)
    packages = next((place / "lib").glob("python*/site-packages"))
    libraries = Path(sysconfig.get_path("purelib"))
    for entry in libraries.iterdir():
        if "orthomill" not in entry.name:
            (packages / entry.name).symlink_to(entry)
    command = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        str(place / "bin" / "python"),
        "install",
        "--quiet",
        "--no-deps",
        str(wheel),
    ]
    subprocess.run(command, check=True, capture_output=True, text=True, timeout=300)
    return place / "bin"


@pytest.fixture
def folder(tmp_path) -> Path:
    """A folder of somebody who has modules called like ours."""
    for name in ("tasks", "schemas", "pipeline"):
        (tmp_path / f"{name}.py").write_text(INTRUDER)
    return tmp_path


def answer(installed: Path, folder: Path, *words: str) -> str:
    environment = {name: value for name, value in os.environ.items() if name not in {"PYTHONPATH", "NUMBA_CACHE_DIR"}}
    environment["XDG_CACHE_HOME"] = str(folder / "cache")
    done = subprocess.run(
        [str(installed / words[0]), *words[1:]], cwd=folder, env=environment, capture_output=True, text=True, timeout=550
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_modules_of_the_user_are_not_taken_for_ours(installed, folder):
    code = "import orthomill, orthomill.tasks.catalogue as c; print(c.__file__)"
    assert "site-packages/orthomill/tasks/catalogue.py" in answer(installed, folder, "python", "-c", code)


@pytest.mark.slow
def test_a_project_runs_where_modules_are_called_like_ours(installed, folder):
    site = make_site(folder / "site")
    for intruder in folder.glob("*.py"):
        intruder.rename(site / intruder.name)
    said = answer(installed, site, "orthomill", "run", "site", "--until", "photos", "--workers", "1")
    assert ", 0 failed" in said
    assert (site / "runs" / "site" / "tables" / "photos" / "photos.json").exists()


def test_compiled_kernels_are_kept_in_the_users_cache(installed, folder):
    code = "from orthomill.tasks.simulation.scene.hash_noise import uniform_of; uniform_of(1, 2, 3)"
    answer(installed, folder, "python", "-c", code)
    assert list((folder / "cache" / "orthomill" / "kernels").rglob("*.nbi"))
