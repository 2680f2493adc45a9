"""Holds the floors of the house: read off the imports, not off good intentions."""

import ast
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parent.parent
SHARED = ("geometry", "adjustment", "matching", "visibility", "imagery", "targets", "colouring")
CONVENTION = {"__init__.py", "stage.py", "report.py"}  # one of each in every stage
CROWD = 20
STAGES = tuple(path.parent.name for path in sorted((ROOT / "tasks").glob("*/stage.py")) if path.parent.name != "simulation")
FORBIDDEN_NAMES = {"utils", "util", "helpers", "helper", "common", "base", "misc", "tools"}


@cache
def modules(*folders: str) -> tuple[Path, ...]:
    found = {folder: list((ROOT / folder).rglob("*.py")) for folder in folders}
    assert all(found.values()), f"of {folders}, one has no files: a test that reads them would hold nothing"
    return tuple(sorted(path for paths in found.values() for path in paths))


class Read(NamedTuple):
    """What the floors are read off; trees of all files at once would keep the garbage collector busy for longer than all tests."""

    imports: frozenset[str]  # also inside functions, as folders of the checkout name them: `tasks.geometry.view`
    classes: tuple[str, ...]
    unexplained: tuple[str, ...]  # kernels and public functions without a docstring
    lines: int
    opens_with_words: bool


def statements(body: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """All statements without their expressions, which are most of a tree and neither import nor define."""
    for node in body:
        yield node
        for inner in ("body", "orelse", "finalbody", "handlers", "cases"):
            yield from statements(getattr(node, inner, ()))


@cache
def read(path: Path) -> Read:
    source = path.read_text()
    tree = ast.parse(source)
    nodes = list(statements(tree.body))
    names = {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
    names.update(alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names)
    return Read(
        frozenset(name.removeprefix("orthomill.") for name in names),
        tuple(node.name for node in nodes if isinstance(node, ast.ClassDef)),
        tuple(node.name for node in tree.body if to_explain(node) and not ast.get_docstring(node)),
        len(source.splitlines()),
        not source.strip() or bool(ast.get_docstring(tree)),
    )


def to_explain(node: ast.AST) -> bool:
    """Whether it is a kernel or a public function."""
    return isinstance(node, ast.FunctionDef) and (node.name[0] != "_" or any("njit" in ast.unparse(d) for d in node.decorator_list))


def imports_any(path: Path, *packages: str) -> set[str]:
    return {name for name in read(path).imports if any(name == package or name.startswith(package + ".") for package in packages)}


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def nobody(offenders: Iterable[str]) -> None:
    if found := "\n".join(offenders):
        pytest.fail(found, pytrace=False)  # all of them in one message, which an assert would shorten


def offenders(paths: Iterable[Path], *packages: str) -> list[str]:
    """Every file that imports what it must not, with what it imports."""
    return [f"{relative(path)}: {', '.join(sorted(found))}" for path in paths if (found := imports_any(path, *packages))]


def test_schemas_stand_on_nothing():
    nobody(offenders(modules("schemas"), "tasks", "pipeline", "dask", "distributed", "zarr", "rasterio", "cv2"))


def test_tasks_know_no_engine_and_no_storage():
    nobody(offenders(modules("tasks"), "pipeline", "dask", "distributed", "zarr", "rasterio", "yaml", "laspy", "pyarrow"))


def test_shared_numerics_stand_below_the_stages():
    above = (*(f"tasks.{name}" for name in STAGES), "tasks.simulation", "tasks.catalogue", "schemas.stage_contract")
    nobody(offenders(modules(*(f"tasks/{name}" for name in SHARED)), *above))


def test_stages_never_import_each_other():
    makers = (*STAGES, "simulation")
    others = {own: [f"tasks.{name}" for name in (*makers, "catalogue") if name != own] for own in makers}
    nobody(line for own in makers for line in offenders(modules(f"tasks/{own}"), *others[own]))


def test_inspections_import_no_stage_and_only_the_lookups_import_them():
    below = [path for path in modules("schemas", "tasks", "pipeline") if relative(path) != "tasks/lookups.py"]
    nobody(offenders((path for path in below if path.parent.name != "inspections"), "tasks.inspections"))
    above = [f"tasks.{name}" for name in (*STAGES, "simulation", "catalogue")]
    nobody(offenders(modules("tasks/inspections"), *above))


HANDS_IN = {"pipeline/cli/projects.py", *(relative(path) for path in (ROOT / "pipeline/cli/commands").glob("*_commands.py"))}
"""files of commands, from which the engine gets the catalogue handed in"""


def test_the_engine_knows_no_photogrammetry():
    nobody(offenders((path for path in modules("pipeline") if relative(path) not in HANDS_IN), "tasks"))
    nobody(relative(ROOT / path) for path in HANDS_IN if imports_any(ROOT / path, "tasks") - {"tasks.catalogue", "tasks.lookups"})


def test_no_stage_but_the_evaluation_knows_the_truth():
    nobody(offenders(modules(*(f"tasks/{name}" for name in (*SHARED, *STAGES) if name != "evaluation")), "schemas.truth"))


def test_only_four_files_import_dask():
    found = {path.name for path in modules("pipeline") if imports_any(path, "dask", "distributed")}
    assert found == {"dask_runner.py", "dask_cluster.py", "dask_observer.py", "started_clusters.py"}


def test_kernels_have_the_cache_that_all_processes_share():
    texts = {path: path.read_text() for path in modules("schemas", "tasks", "pipeline")}
    nobody(relative(path) for path, text in texts.items() if "from numba import" in text or "import numba\n" in text)


def test_nobody_loads_the_distributions_of_scipy():
    """scipy.stats takes as long to import as the rest of what a command needs; scipy.special has the same functions."""
    nobody(offenders(modules("schemas", "tasks", "pipeline"), "scipy.stats"))


def test_every_kernel_and_every_public_function_says_what_it_takes():
    paths = modules("orthomill", "schemas", "tasks", "pipeline")
    nobody(f"{relative(path)}: {name}" for path in paths for name in read(path).unexplained)


def jobs_made() -> Iterator[tuple[Path, ast.Call]]:
    texts = {path: path.read_text() for path in modules("tasks", "orthomill")}
    calls = ((path, node) for path, text in texts.items() if " Job(" in text for node in ast.walk(ast.parse(text)))
    yield from ((path, node) for path, node in calls if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Job")


def test_what_a_job_reads_and_writes_is_named_where_it_is_made():
    nobody(relative(path) for path, job in jobs_made() if job.args)


def products(formula: ast.AST) -> Iterator[ast.BinOp]:
    """What a formula multiplies by hand: neither inside of a call nor a number of mebibytes."""
    if isinstance(formula, ast.BinOp):
        if isinstance(formula.op, ast.Mult) and getattr(formula.right, "id", "") != "MIB":
            yield formula
        yield from (*products(formula.left), *products(formula.right))


def test_what_a_job_needs_of_memory_is_said_in_one_vocabulary():
    """`schemas/memory.py`: so many bytes for each cell of a window, a grid, a shape or a table."""
    formulas = ((path, word.value) for path, job in jobs_made() for word in job.keywords if word.arg == "scratch")
    nobody(f"{relative(path)}: {ast.unparse(one)}" for path, formula in formulas for one in products(formula))
    texts = {path: path.read_text() for path in modules("schemas", "tasks", "pipeline") if path.stem != "memory"}
    nobody(relative(path) for path, text in texts.items() if re.search(r"^[MG]IB.* = ", text, re.MULTILINE))


def test_only_the_storage_room_imports_zarr():
    assert {path.parent.name for path in modules("pipeline") if imports_any(path, "zarr")} == {"storage"}


def test_a_stage_file_holds_no_numerics():
    nobody(offenders(sorted((ROOT / "tasks").glob("*/stage.py")), "numpy", "numba", "scipy", "cv2"))


DOORED = ("colouring", "simulation", *STAGES)
NUMERICS = ("numpy", "numba", "scipy", "cv2")


def test_behind_its_doors_every_stage_is_the_same():
    """Jobs are made in `plan` and words in `report`, neither with numerics; rooms of methods know nothing of both."""
    for stage in DOORED:
        doors = {door: modules(f"tasks/{stage}/{door}") for door in ("plan", "report")}
        nobody(line for paths in doors.values() for line in offenders(paths, *NUMERICS))
        rooms = [
            path for path in modules(f"tasks/{stage}") if path.name != "stage.py" and path not in (*doors["plan"], *doors["report"])
        ]
        nobody(offenders(rooms, "schemas.stage_report", f"tasks.{stage}.plan", f"tasks.{stage}.report"))
        nobody(relative(path) for path in (*rooms, *doors["report"]) if "Job(" in path.read_text())


def test_no_stage_reports_without_a_verdict():
    """Silence is not a verdict: a report is made with one, and what is added to a report keeps it."""
    made = [
        (path.relative_to(ROOT).as_posix(), call)
        for path in modules("tasks")
        if "StageReport(" in path.read_text()
        for call in ast.walk(ast.parse(path.read_text()))
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "StageReport"
    ]
    assert len(made) > 10 and [file for file, call in made if "verdict" not in [word.arg for word in call.keywords]] == []


def test_names_say_what_is_inside():
    nobody(relative(path) for path in modules("schemas", "tasks", "pipeline") if path.stem in FORBIDDEN_NAMES)


def test_every_file_opens_with_its_strategy():
    paths = modules("schemas", "tasks", "pipeline")
    nobody(f"{relative(path)} has no docstring" for path in paths if not read(path).opens_with_words)


def test_no_file_grows_into_a_shed():
    paths = modules("schemas", "tasks", "pipeline")
    nobody(f"{relative(path)} has {read(path).lines} lines; rebuild the room" for path in paths if read(path).lines > 480)


def test_nothing_unpickles_files():
    nobody(offenders(modules("schemas", "tasks", "pipeline"), "pickle", "cloudpickle", "marshal", "shelve"))


def test_no_folder_is_crowded():
    named = modules("orthomill", "schemas", "tasks", "pipeline", "tests", "benchmarks")
    files = Counter(relative(path.parent) for path in named if path.name != "__init__.py")
    nobody(f"{folder} holds {count} files; give it rooms" for folder, count in files.items() if count > CROWD)


def test_nobody_meets_two_files_of_one_name():
    names = Counter(path.name for path in modules("orthomill", "schemas", "tasks", "pipeline", "benchmarks"))
    nobody(name for name, times in names.items() if times > 1 and name not in CONVENTION)


def test_nobody_meets_two_classes_of_one_name():
    paths = modules("orthomill", "schemas", "tasks", "pipeline")
    names = Counter(name for path in paths for name in read(path).classes)
    nobody(name for name, times in names.items() if times > 1)


ROOMED = ("pipeline", "tasks/adjustment", "tasks/calibration", "tasks/colouring", "tasks/orientation")
PIPELINE_ROOMS = (
    "storage",
    "records",
    "signing",
    "workflow",
    "painting",
    "export",
    "engine",
    "forecast",
    "watching",
    "report",
    "serving",
    "cli",
)  # from the ground up


@cache
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


def test_rooms_of_a_floor_import_in_no_circle():
    for floor in ROOMED:
        TopologicalSorter(neighbours(floor)).prepare()  # raises CycleError, which names the circle


def test_a_room_of_the_pipeline_imports_only_rooms_below_it():
    found = neighbours("pipeline")
    wrong = {room: found[room] - set(PIPELINE_ROOMS[:place]) for place, room in enumerate(PIPELINE_ROOMS)}
    nobody(f"{room} imports {', '.join(sorted(above))}" for room, above in wrong.items() if above)
