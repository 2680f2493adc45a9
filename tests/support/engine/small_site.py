"""A project of three small real photographs, and the command line: shared by the tests that run the whole program."""

import os
import re
import shutil
import subprocess
import sys
from functools import cache
from io import BytesIO
from pathlib import Path

import yaml
from made_once import made_once
from PIL import Image
from typer.testing import CliRunner

from orthomill.pipeline.cli.commands.application import app
from orthomill.pipeline.records.records import Records

SHIPPED = Path(__file__).parents[3] / "workflows" / "photographs" / "brighton"
WORKFLOW = {
    "project": "site",
    "crs": "EPSG:32615",
    "photographs": {"kind": "folder", "path": "photos"},
    "tile": 256,
    "stages": ["photos", "calibration", "tie_points", "orientation"],
}


@cache
def _reduced(name: str) -> tuple[Image.Image, Image.Exif]:
    with Image.open(SHIPPED / name) as image:
        return image.resize((640, 360)), image.getexif()


def make_site(root: Path) -> Path:
    """Write three overlapping photographs of 640 x 360 px with GPS tags, and a workflow `site`; returns the root."""
    (root / "photos").mkdir(parents=True)
    (root / "workflows").mkdir()
    for source in sorted(SHIPPED.glob("*.JPG"))[:3]:
        image, exif = _reduced(source.name)
        image.save(root / "photos" / source.name, quality=90, exif=exif)
    write_workflow(root)
    return root


def write_workflow(root: Path, **changes) -> None:
    (root / "workflows" / "site.yaml").write_text(yaml.safe_dump({**WORKFLOW, **changes}, sort_keys=False))


def photographs(root: Path) -> list[Path]:
    return sorted((root / "photos").iterdir())


def damage(photo: Path) -> None:
    """Make a progressive JPEG of a photograph and cut it so that its header and its end are whole: only decoding it finds out."""
    whole = BytesIO()
    with Image.open(photo) as image:
        image.save(whole, "JPEG", quality=90, progressive=True, exif=image.getexif())
    cut(photo, whole.getvalue())


def cut(photo: Path, content: bytes | None = None) -> None:
    """Cut a JPEG (of `content`) so that its header and its end are whole."""
    photo.write_bytes((content or photo.read_bytes())[:20000] + b"\xff\xd9")


def command(*words: str, code: int = 0) -> str:
    """Run `orthomill` in this process; returns its output on one line. Fails when the exit code differs or a traceback appears."""
    result = CliRunner().invoke(app, list(words))
    said = " ".join(result.output.split())
    assert result.exit_code == code, said
    assert "Traceback" not in said
    return said


def command_in(root: Path, *words: str) -> str:
    """`command` with `root` as the current folder, for what is made once for several tests."""
    before = Path.cwd()
    os.chdir(root)
    try:
        return command(*words)
    finally:
        os.chdir(before)


def counts(said: str) -> tuple[int, int, int]:
    """Jobs run, unchanged and failed, from the output of a run."""
    found = re.search(r"(\d+) jobs run, (\d+) unchanged, (\d+) failed", said)
    assert found, said
    return tuple(map(int, found.groups()))


def start_command(root: Path, *words: str, **options) -> subprocess.Popen:
    """Start `orthomill` in `root` as a process of its own, with a process group of its own, as a terminal does."""
    program = Path(sys.executable).with_name("orthomill")
    start = [program] if program.exists() else [shutil.which("orthomill")]
    return subprocess.Popen(
        [*start, *words],
        cwd=root,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "COLUMNS": "500"},
        **options,
    )


def finished_site() -> tuple[Path, str]:
    """The root of a site that was run to its end, one job after another, and the output; made once, for copies only."""
    root = made_once("finished_site", _finish_site)
    return root, (root / "said.txt").read_text()


def _finish_site(root: Path) -> None:
    said, errors = (process := start_command(make_site(root), "run", "site", "--sequential")).communicate(timeout=600)
    assert process.returncode == 0, errors
    (root / "said.txt").write_text(said)


def copy_of_finished_site(target: Path) -> Path:
    """A copy that a test may change; running it again finds everything unchanged."""
    return Path(shutil.copytree(finished_site()[0], target))


def jobs_done(root: Path, project: str = "site") -> int:
    """How many jobs of a run have a record that says they are done."""
    records, _ = Records(root / "runs" / project).sort_out()
    return sum(record.status == "done" for record in records)


def results_of(root: Path, project: str = "site") -> dict[str, bytes]:
    """The bytes of all raster chunks and tables of a run, without the metadata of rasters, which hold their birth marks."""
    folder = root / "runs" / project
    files = [path for part in ("rasters.zarr", "tables") for path in (folder / part).rglob("*")]
    kept = [path for path in files if path.is_file() and path.name != "zarr.json"]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in kept}
