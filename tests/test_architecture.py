"""Holds the floors of the house: read off the imports, not off good intentions."""

import ast
from collections import Counter
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SHARED = ("geometry", "adjustment", "matching", "visibility", "imagery")
CONVENTION = {"__init__.py", "stage.py", "report.py"}  # one of each in every stage
CROWD = 16
STAGES = (
    "photos",
    "calibration",
    "registration",
    "tie_points",
    "orientation",
    "epipolar",
    "densification",
    "dsm_check",
    "texture",
    "projection",
    "evaluation",
)
FORBIDDEN_NAMES = {"utils", "util", "helpers", "helper", "common", "base", "misc", "tools"}


def modules(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def imports(path: Path) -> set[str]:
    """All modules that a file imports, also inside functions, as folders of the checkout name them: `tasks.geometry.view`."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            found.add(node.module or "")
        elif isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
    return {name.removeprefix("orthomill.") for name in found}


def imports_any(path: Path, *packages: str) -> set[str]:
    return {name for name in imports(path) if any(name == package or name.startswith(package + ".") for package in packages)}


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("path", modules("schemas"), ids=relative)
def test_schemas_stand_on_nothing(path):
    assert not imports_any(path, "tasks", "pipeline", "dask", "distributed", "zarr", "rasterio", "cv2")


@pytest.mark.parametrize("path", modules("tasks"), ids=relative)
def test_tasks_know_no_engine_and_no_storage(path):
    assert not imports_any(path, "pipeline", "dask", "distributed", "zarr", "rasterio", "yaml", "laspy", "pyarrow")


@pytest.mark.parametrize("path", modules(*(f"tasks/{name}" for name in SHARED)), ids=relative)
def test_shared_numerics_stand_below_the_stages(path):
    assert not imports_any(
        path, *(f"tasks.{name}" for name in STAGES), "tasks.simulation", "tasks.catalogue", "schemas.stage_contract"
    )


@pytest.mark.parametrize("path", modules(*(f"tasks/{name}" for name in (*STAGES, "simulation"))), ids=relative)
def test_stages_never_import_each_other(path):
    own = path.relative_to(ROOT / "tasks").parts[0]
    others = [f"tasks.{name}" for name in (*STAGES, "simulation", "catalogue") if name != own]
    assert not imports_any(path, *others)


def test_inspections_import_no_stage_and_only_the_catalogue_imports_them():
    below = [path for path in modules("schemas", "tasks", "pipeline") if relative(path) != "tasks/catalogue.py"]
    assert not [relative(path) for path in below if path.parent.name != "inspections" and imports_any(path, "tasks.inspections")]
    above = [f"tasks.{name}" for name in (*STAGES, "simulation", "catalogue")]
    assert not [relative(path) for path in modules("tasks/inspections") if imports_any(path, *above)]


HANDS_IN = ("pipeline/cli/commands.py", "pipeline/cli/projects.py", "pipeline/cli/lookups/lookup_commands.py")
"""files of commands, from which the engine gets the catalogue handed in"""


@pytest.mark.parametrize("path", modules("pipeline"), ids=relative)
def test_the_engine_knows_no_photogrammetry(path):
    allowed = {"tasks.catalogue"} if relative(path) in HANDS_IN else set()
    assert imports_any(path, "tasks") <= allowed


@pytest.mark.parametrize("path", modules(*(f"tasks/{name}" for name in (*SHARED, *STAGES) if name != "evaluation")), ids=relative)
def test_no_stage_but_the_evaluation_knows_the_truth(path):
    assert not imports_any(path, "schemas.truth")


def test_only_three_files_import_dask():
    found = {path.name for path in modules("pipeline") if imports_any(path, "dask", "distributed")}
    assert found == {"dask_runner.py", "dask_cluster.py", "dask_observer.py"}


def test_only_the_storage_room_imports_zarr():
    assert {path.parent.name for path in modules("pipeline") if imports_any(path, "zarr")} == {"storage"}


@pytest.mark.parametrize("path", sorted((ROOT / "tasks").glob("*/stage.py")), ids=relative)
def test_a_stage_file_holds_no_numerics(path):
    assert not imports_any(path, "numpy", "numba", "scipy", "cv2")


@pytest.mark.parametrize("path", modules("schemas", "tasks", "pipeline"), ids=relative)
def test_names_say_what_is_inside(path):
    assert path.stem not in FORBIDDEN_NAMES


@pytest.mark.parametrize("path", modules("schemas", "tasks", "pipeline"), ids=relative)
def test_every_file_opens_with_its_strategy(path):
    source = path.read_text()
    assert not source.strip() or ast.get_docstring(ast.parse(source)), f"{relative(path)} has no docstring"


@pytest.mark.parametrize("path", modules("schemas", "tasks", "pipeline"), ids=relative)
def test_no_file_grows_into_a_shed(path):
    assert len(path.read_text().splitlines()) <= 480, f"{relative(path)} is crowded; rebuild the room"


@pytest.mark.parametrize("path", modules("schemas", "tasks", "pipeline"), ids=relative)
def test_nothing_unpickles_files(path):
    assert not imports_any(path, "pickle", "cloudpickle", "marshal", "shelve")


def rooms(*folders: str) -> list[Path]:
    return sorted({path.parent for path in modules(*folders)})


@pytest.mark.parametrize("folder", rooms("orthomill", "schemas", "tasks", "pipeline", "tests", "benchmarks"), ids=relative)
def test_no_folder_is_crowded(folder):
    files = [path for path in folder.glob("*.py") if path.name != "__init__.py"]
    assert len(files) <= CROWD, f"{relative(folder)} holds {len(files)} files; give it rooms"


def test_nobody_meets_two_files_of_one_name():
    names = Counter(path.name for path in modules("orthomill", "schemas", "tasks", "pipeline", "benchmarks"))
    assert not [name for name, times in names.items() if times > 1 and name not in CONVENTION]


def test_nobody_meets_two_classes_of_one_name():
    trees = [ast.parse(path.read_text()) for path in modules("orthomill", "schemas", "tasks", "pipeline")]
    names = Counter(node.name for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
    assert not [name for name, times in names.items() if times > 1]


ROOMED = ("pipeline", "tasks/adjustment", "tasks/calibration", "tasks/orientation")
PIPELINE_ROOMS = (
    "storage",
    "records",
    "signing",
    "workflow",
    "export",
    "engine",
    "forecast",
    "watching",
    "report",
    "cli",
)  # from the ground up


def neighbours(floor: str) -> dict[str, set[str]]:
    """room -> the other rooms of its floor that it imports."""
    prefix = floor.replace("/", ".")
    found: dict[str, set[str]] = {}
    for path in modules(floor):
        room = path.relative_to(ROOT / floor).parts[0]
        if room.endswith(".py"):
            continue
        names = [name.removeprefix(prefix + ".").split(".")[0] for name in imports_any(path, prefix) if name != prefix]
        found.setdefault(room, set()).update(name for name in names if name != room and (ROOT / floor / name).is_dir())
    return found


@pytest.mark.parametrize("floor", ROOMED)
def test_rooms_of_a_floor_import_in_no_circle(floor):
    TopologicalSorter(neighbours(floor)).prepare()  # raises CycleError, which names the circle


@pytest.mark.parametrize("room", PIPELINE_ROOMS)
def test_a_room_of_the_pipeline_imports_only_rooms_below_it(room):
    assert neighbours("pipeline")[room] <= set(PIPELINE_ROOMS[: PIPELINE_ROOMS.index(room)])
