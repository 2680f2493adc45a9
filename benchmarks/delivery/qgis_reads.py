"""What QGIS says of the products of a run, without a window: `python -m benchmarks qgis_reads RUN [PYTHON]`.

PYTHON is the interpreter that has QGIS, /usr/bin/python3 where Debian's `python3-qgis` is installed.
"""

import json
import subprocess
from pathlib import Path

from benchmarks.instrument.result_page import ROOT, write_page
from benchmarks.measured_run import run_folders

READER = Path(__file__).with_name("qgis_reader.py")
PICTURE = ROOT / "docs" / "pictures" / "qgis.jpg"


def main(words: list[str]) -> None:
    """Opens the products, and writes the page and the picture of the documentation."""
    (run,) = run_folders(words[:1], "brighton")
    python = words[1] if words[1:] else "/usr/bin/python3"
    ended = subprocess.run([python, READER, run / "products", PICTURE], capture_output=True, text=True)
    if ended.returncode:
        raise SystemExit(f"{python} cannot open them: {ended.stderr.strip().splitlines()[-1:]}; is python3-qgis installed?")
    found = json.loads(ended.stdout.strip().splitlines()[-1])
    layers = found["layers"]
    rows = [f"| {one['file']} | {one['kind']} | {one.get('size', 'not valid')} | {one['crs'] or 'none'} |" for one in layers]
    lines = [
        "# Products in QGIS",
        "",
        f"QGIS {found['version']}; valid: {sum(one['valid'] for one in layers)} of {len(layers)} layers.",
        "The picture is docs/pictures/qgis.jpg.",
        "",
        "| file | opened as | size | system |",
        "| --- | --- | --- | --- |",
        *rows,
    ]
    write_page("qgis_reads", words, "\n".join(lines) + "\n")
