"""Stands in for the commands `init`, `run` and `export` in tests of the node: the same files and lines, without photogrammetry.

A run counts steps in the project's folder and goes on where it was killed, as a real one does. Photographs named bad* fail it.
"""

import fcntl
import json
import os
import sys
import time
from pathlib import Path

STEPS = int(os.environ.get("STANDIN_STEPS", "4"))
PAUSE = float(os.environ.get("STANDIN_PAUSE", "0.02"))


def init() -> None:
    """The workflow of the photographs that were uploaded."""
    photographs = sorted(path.name for path in Path("images").iterdir() if path.suffix.lower() in (".jpg", ".png", ".tif"))
    if len(photographs) < 2:
        sys.exit("error: There are no two photographs in images.")
    print(f"{len(photographs)} photographs")
    Path("workflows").mkdir(exist_ok=True)
    stages = "\n".join(f"  - kind: {kind}" for kind in ("photos", "orientation", "densification", "terrain", "texture"))
    Path("workflows/task.yaml").write_text(
        f"project: task\ncrs: EPSG:32634\nphotographs: {{kind: folder, path: images}}\ncontrol: {{kind: none}}\nstages:\n{stages}\n"
    )


def run() -> None:
    """Steps that are kept, lines of progress, and files of results."""
    folder = Path("runs/task")
    (folder / "products").mkdir(parents=True, exist_ok=True)
    lock = (folder / ".lock").open("a+")
    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    lock.truncate(0)
    lock.write(str(os.getpid()))
    lock.flush()
    print(json.dumps({"event": "note", "text": "map of tiles: http://127.0.0.1:1/secret/tiles"}), flush=True)
    for step in range(STEPS):
        done = folder / f"step{step}"
        if not done.exists():
            time.sleep(PAUSE)
            done.write_text("")
        share = (step + 1) / STEPS
        stages = {"photos": {"planned": STEPS, "done": step + 1}}
        print(json.dumps({"event": "progress", "seconds": 1.0, "share": share, "left_seconds": 2.0, "stages": stages}), flush=True)
    for name in ("dsm_check.tif", "points.laz", "dsm_provenance.tif", "cameras.json"):
        (folder / "products" / name).write_bytes(name.encode() * 1000)
    (folder / "report.html").write_text("<html><body>report</body></html>")
    (folder / "tiles.html").write_text("<html><body>tiles</body></html>")
    (folder / "summary.json").write_text("{}")
    bad = [path.name for path in Path("images").iterdir() if path.name.startswith("bad")]
    failed = [{"tile": f"photos/{name}", "sentence": f"{name} cannot be read."} for name in bad]
    end = {"event": "end", "complete": not bad, "verdict": "Good: checked.", "reasons": ["All heights agree."], "failed": failed}
    print(json.dumps({**end, "warnings": [], "products": []}), flush=True)
    sys.exit(1 if bad else 0)


def export() -> None:
    """A folder of tiles of points; nothing else is known."""
    target = Path("runs/task") / sys.argv[3]
    if sys.argv[sys.argv.index("--as") + 1] == "ept":
        target.mkdir(parents=True, exist_ok=True)
        (target / "ept.json").write_text("{}")
    else:
        raise RuntimeError("no such format")


if __name__ == "__main__":
    {"init": init, "run": run, "export": export}[sys.argv[1]]()
