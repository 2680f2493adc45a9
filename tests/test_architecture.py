"""Holds the floors of the house: read off the imports, not off good intentions. Each test names all offenders at once."""

import ast
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parent.parent
SHARED = ("geometry", "adjustment", "matching", "visibility", "imagery", "targets", "colouring")
CONVENTION = {"__init__.py", "stage.py", "report.py"}  # one of each in every stage
CROWD = 20
SHED = 480  # lines
STAGES = tuple(path.parent.name for path in sorted((ROOT / "tasks").glob("*/stage.py")) if path.parent.name != "simulation")
MAKERS = (*STAGES, "simulation")
DOORED = ("colouring", *MAKERS)
ABOVE_NUMERICS = (*(f"tasks.{name}" for name in MAKERS), "tasks.catalogue")
NUMERICS = ("numpy", "numba", "scipy", "cv2")
FORBIDDEN_NAMES = {"utils", "util", "helpers", "helper", "common", "base", "misc", "tools"}
HANDS_IN = (
    "pipeline/cli/projects.py",
    *(f"pipeline/cli/commands/{path.name}" for path in ROOT.glob("pipeline/cli/commands/*_commands.py")),
)
"""files of commands, from which the engine gets the catalogue handed in"""
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
def modules(*folders: str) -> tuple[Path, ...]:
    found = {folder: list((ROOT / folder).rglob("*.py")) for folder in folders}
    assert all(found.values()), f"of {folders}, one has no files: a test that reads them would hold nothing"
    return tuple(sorted(path for paths in found.values() for path in paths))


PRODUCT = modules("orthomill", "schemas", "tasks", "pipeline")
BELOW_THE_DOOR = modules("schemas", "tasks", "pipeline")


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


def all_but(paths: Iterable[Path], *spared: str) -> list[Path]:
    """The files without those that are named: a file, or a folder by its name and a slash."""
    return [path for path in paths if not any(relative(path) == one or relative(path).startswith(one) for one in spared)]


def nobody(offenders: Iterable[str]) -> None:
    if found := "\n".join(offenders):
        pytest.fail(found, pytrace=False)  # all of them in one message, which an assert would shorten


def offenders(paths: Iterable[Path], *packages: str) -> list[str]:
    """Every file that imports what it must not, with what it imports."""
    return [f"{relative(path)}: {', '.join(sorted(found))}" for path in paths if (found := imports_any(path, *packages))]


class Wall(NamedTuple):
    """What some files may not import."""

    rule: str
    paths: Iterable[Path]
    packages: tuple[str, ...]


WALLS = (
    Wall("schemas stand on nothing", modules("schemas"), ("tasks", "pipeline", "dask", "distributed", "zarr", "rasterio", "cv2")),
    Wall(
        "tasks know no engine and no storage",
        modules("tasks"),
        ("pipeline", "dask", "distributed", "zarr", "rasterio", "yaml", "laspy", "pyarrow"),
    ),
    Wall(
        "shared numerics stand below the stages",
        modules(*(f"tasks/{name}" for name in SHARED)),
        (*ABOVE_NUMERICS, "schemas.stage_contract"),
    ),
    *(
        Wall("stages never import each other", modules(f"tasks/{own}"), tuple(n for n in ABOVE_NUMERICS if n != f"tasks.{own}"))
        for own in MAKERS
    ),
    Wall("inspections import no stage", modules("tasks/inspections"), ABOVE_NUMERICS),
    Wall(
        "only the lookups import inspections",
        all_but(BELOW_THE_DOOR, "tasks/lookups.py", "tasks/inspections/"),
        ("tasks.inspections",),
    ),
    Wall("the engine knows no photogrammetry", all_but(modules("pipeline"), *HANDS_IN), ("tasks",)),
    Wall(
        "no stage but the evaluation knows the truth",
        modules(*(f"tasks/{name}" for name in (*SHARED, *STAGES) if name != "evaluation")),
        ("schemas.truth",),
    ),
    Wall("a stage file holds no numerics", sorted((ROOT / "tasks").glob("*/stage.py")), NUMERICS),
    Wall("scipy.special has the same functions, and is imported in a tenth of the time", BELOW_THE_DOOR, ("scipy.stats",)),
    # Jobs that a process has packed in its own memory are no files.
    Wall(
        "nothing unpickles files",
        all_but(BELOW_THE_DOOR, "pipeline/engine/planned/pickled_jobs.py"),
        ("pickle", "cloudpickle", "marshal", "shelve"),
    ),
)


def broken(wall: Wall) -> list[str]:
    return [f"{wall.rule}: {line}" for line in offenders(wall.paths, *wall.packages)]


def test_no_file_imports_what_is_beyond_its_wall():
    nobody(line for wall in WALLS for line in broken(wall))


def test_a_wall_names_whoever_breaks_it_with_each_of_its_packages(monkeypatch):
    for wall in WALLS:
        for package in wall.packages:
            planted = read(wall.paths[0])._replace(imports=frozenset({f"{package}.inner"}))
            monkeypatch.setitem(globals(), "read", lambda _, planted=planted: planted)
            assert broken(wall) == [f"{wall.rule}: {relative(path)}: {package}.inner" for path in wall.paths]
            monkeypatch.undo()


def test_only_these_files_import_dask_zarr_and_numba():
    """Of numba the decorators: kernels have those of `orthomill.kernels`, with the cache that all processes share."""
    dask = {path.name for path in modules("pipeline") if imports_any(path, "dask", "distributed")}
    zarr = {path.parent.name for path in modules("pipeline") if imports_any(path, "zarr")}
    numba = {relative(path) for path in BELOW_THE_DOOR if "numba" in read(path).imports}
    differ = {
        "dask": dask ^ {"dask_runner.py", "dask_cluster.py", "dask_observer.py", "started_clusters.py"},
        "zarr": zarr ^ {"storage"},
        "numba": numba,
    }
    nobody(f"{package}: {', '.join(sorted(found))}" for package, found in differ.items() if found)


def test_commands_hand_in_the_catalogue_and_the_lookups():
    paths = [ROOT / path for path in HANDS_IN]
    nobody(relative(path) for path in paths if imports_any(path, "tasks") - {"tasks.catalogue", "tasks.lookups"})


def calls(name: str, *folders: str) -> Iterator[tuple[Path, ast.Call]]:
    """Every call of the name with the file that it stands in."""
    texts = {path: path.read_text() for path in modules(*folders)}
    nodes = ((path, node) for path, text in texts.items() if f"{name}(" in text for node in ast.walk(ast.parse(text)))
    yield from ((path, node) for path, node in nodes if isinstance(node, ast.Call) and getattr(node.func, "id", "") == name)


def products(formula: ast.AST) -> Iterator[ast.BinOp]:
    """What a formula multiplies by hand: neither inside of a call nor a number of mebibytes."""
    if isinstance(formula, ast.BinOp):
        if isinstance(formula.op, ast.Mult) and getattr(formula.right, "id", "") != "MIB":
            yield formula
        yield from (*products(formula.left), *products(formula.right))


def other_ways() -> Iterator[str]:
    jobs = [*calls("Job", "tasks", "orthomill")]
    yield from (f"{relative(path)}:{job.lineno}: a job without keywords" for path, job in jobs if job.args)
    formulas = ((path, word.value) for path, job in jobs for word in job.keywords if word.arg == "scratch")
    yield from (f"{relative(path)}: {ast.unparse(one)}" for path, formula in formulas for one in products(formula))
    texts = {path: path.read_text() for path in BELOW_THE_DOOR if path.stem != "memory"}
    yield from (
        f"{relative(path)} has bytes of its own" for path, text in texts.items() if re.search(r"^[MG]IB.* = ", text, re.MULTILINE)
    )


def test_jobs_are_made_in_one_way():
    """By keywords, with memory in the words of `schemas/memory.py`: bytes for each cell of a window, a grid, a shape or a table."""
    nobody(other_ways())


def test_no_stage_reports_without_a_verdict():
    """Silence is not a verdict: a report is made with one, and what is added to a report keeps it."""
    made = [*calls("StageReport", "tasks")]
    assert len(made) > 10
    nobody(f"{relative(path)}:{call.lineno}" for path, call in made if "verdict" not in [word.arg for word in call.keywords])


def wrong_doors(stage: str) -> Iterator[str]:
    doors = {door: modules(f"tasks/{stage}/{door}") for door in ("plan", "report")}
    for paths in doors.values():
        yield from offenders(paths, *NUMERICS)
    behind = [
        path for path in modules(f"tasks/{stage}") if path.name != "stage.py" and path not in (*doors["plan"], *doors["report"])
    ]
    yield from offenders(behind, "schemas.stage_report", f"tasks.{stage}.plan", f"tasks.{stage}.report")
    yield from (f"{relative(path)} makes a job" for path in (*behind, *doors["report"]) if "Job(" in path.read_text())


def test_behind_its_doors_every_stage_is_the_same():
    """Jobs are made in `plan` and words in `report`, neither with numerics; rooms of methods know nothing of both."""
    nobody(line for stage in DOORED for line in wrong_doors(stage))


def test_every_file_kernel_and_public_function_says_what_it_is():
    nobody(
        f"{relative(path)}: {name}"
        for path in PRODUCT
        for name in (*([] if read(path).opens_with_words else ["no docstring"]), *read(path).unexplained)
    )


def test_names_say_what_is_inside():
    nobody(relative(path) for path in BELOW_THE_DOOR if path.stem in FORBIDDEN_NAMES)


def test_no_file_and_no_folder_grows_into_a_shed():
    files = Counter(relative(path.parent) for path in (*PRODUCT, *modules("tests", "benchmarks")) if path.name != "__init__.py")
    nobody(
        (
            *(
                f"{relative(path)} has {read(path).lines} lines; rebuild the room"
                for path in BELOW_THE_DOOR
                if read(path).lines > SHED
            ),
            *(f"{folder} holds {count} files; give it rooms" for folder, count in files.items() if count > CROWD),
        )
    )


def test_nobody_meets_two_files_or_two_classes_of_one_name():
    files = Counter(path.name for path in (*PRODUCT, *modules("benchmarks")) if path.name not in CONVENTION)
    classes = Counter(name for path in PRODUCT for name in read(path).classes)
    nobody(name for name, times in (files + classes).items() if times > 1)


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


def circles() -> Iterator[str]:
    for floor in ROOMED:
        try:
            TopologicalSorter(neighbours(floor)).prepare()
        except CycleError as circle:
            yield f"{floor}: {' <- '.join(circle.args[1])}"


def test_rooms_of_a_floor_import_in_no_circle():
    nobody(circles())


def test_a_room_of_the_pipeline_imports_only_rooms_below_it():
    found = neighbours("pipeline")
    wrong = {room: found[room] - set(PIPELINE_ROOMS[:place]) for place, room in enumerate(PIPELINE_ROOMS)}
    nobody(f"{room} imports {', '.join(sorted(above))}" for room, above in wrong.items() if above)
