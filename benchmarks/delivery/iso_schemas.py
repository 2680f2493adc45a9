"""Metadata of a run against ISO's own schemas: `python -m benchmarks iso_schemas RUN SCHEMAS OTHERS [PYTHON]`.

SCHEMAS and OTHERS as in `xml_validator.py`; PYTHON is one that has lxml, this one if none is named. The files are those of
`orthomill export PROJECT --as iso19115` and `--as iso19157`.
"""

import json
import subprocess
import sys
from pathlib import Path

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import run_folders

VALIDATOR = Path(__file__).with_name("xml_validator.py")


def main(words: list[str]) -> None:
    """Validates both, and one that was made wrong on purpose, and writes the page."""
    (run,) = run_folders(words[:1], "brighton")
    files = sorted((run / "products" / "exported").glob("*_iso19*.xml"))
    if not files or len(words) < 3:
        raise SystemExit("Export --as iso19115 and --as iso19157 first, and name the folders of the schemas.")
    wrong = run / "products" / "exported" / "wrong.xml"
    wrong.write_text(files[0].read_text().replace("mdb:dateInfo>", "mdb:when>"))
    python = words[3] if words[3:] else sys.executable
    try:
        command = [python, VALIDATOR, *words[1:3], *map(str, files), str(wrong)]
        found = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    finally:
        wrong.unlink()
    rows = [f"| {Path(file).name} | {len(errors)} | {errors[0] if errors else ''} |" for file, errors in found.items()]
    lines = [
        "# Metadata against ISO's schemas",
        "",
        "`wrong.xml` is the first file with an element of another name: the schemas do look.",
        "",
        "| file | errors | first |",
        "| --- | --- | --- |",
        *rows,
    ]
    write_page("iso_schemas", words, "\n".join(lines) + "\n")
