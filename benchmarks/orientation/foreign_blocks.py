"""Blocks that nobody here has chosen: folders of photographs as people have them, oriented with all defaults, a peer beside them.

    python -m benchmarks foreign_blocks [compiled] [peer=PYTHON] FOLDER ...

Every folder is started by `init`, which uses the GCP list, positions and camera that lie in it, and run until the orientation; the
peer (COLMAP, by the Python that has it) gets the same photographs with its own defaults; without `peer` its figures of before stay.
The page has one row for each folder, failures included, and below it every warning of the report, for what a block says is part of
the result. Blocks that are not named stay as they were measured. Kernels are compiled by a run of the first folder that is not
counted, unless they are (`compiled`): that happens once on a machine.
"""

import csv
import json
import resource
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np

from benchmarks.instrument.result_page import RESULTS, revision, write_page
from benchmarks.measured_run import orthomill
from benchmarks.orientation.orientation_truth import mean_residual
from orthomill.pipeline.workflow.starting_workflow import write_starting_workflow
from orthomill.schemas.orientation import Block, SeparateBlocks
from orthomill.tasks.catalogue import STAGES

WIDEST = 300
"""characters of what a failed run said"""
SUFFIXES = {".jpg", ".jpeg", ".tif", ".tiff", ".png"}
HEAD = "| block | photographs | oriented | apart | sigma0 px | residual px | iterations | CPU s | peer | px | CPU s | warnings |"
RECORD = RESULTS / "foreign_blocks.csv"
SEPARATOR = " // "
SOURCES = {
    "asteroid": "borglab/gtsfm, tests/data/astrovision/test_2011212_opnav_022/images",
    "banana": "pierotofy/dataset_banana, images",
    "boruszyn": "merkato/odm_boruszyn_kap, images",
    "buddha": "alicevision/dataset_buddha, buddha",
    "caliterra": "OpenDroneMap/odm_data_caliterra, images",
    "castle_19": "openMVG/SfM_quality_evaluation, Benchmarking_Camera_Calibration_2008/castle-P19/images",
    "castle_30": "openMVG/SfM_quality_evaluation, Benchmarking_Camera_Calibration_2008/castle-P30/images",
    "cathedral": "hkaiyu/structure-from-motion, dataset/misc/cathedral/images",
    "copr": "OpenDroneMap/odm_data_copr, images",
    "crazyhorse": "royshil/SfM-Toy-Library, dataset/crazyhorse",
    "door_no_exif": "borglab/gtsfm, tests/data/set4_lund_door_nointrinsics_noextrinsics_noexif/images",
    "entry_10": "openMVG/SfM_quality_evaluation, Benchmarking_Camera_Calibration_2008/entry-P10/images",
    "et": "snavely/bundler_sfm, examples/ET",
    "fox": "NVlabs/instant-ngp, data/nerf/fox/images",
    "haltbrekken_left": "larssbr/odm_data_haltbrekken_run1, Left",
    "haltbrekken_right": "larssbr/odm_data_haltbrekken_run1, Right",
    "herz_jesu_25": "openMVG/SfM_quality_evaluation, Benchmarking_Camera_Calibration_2008/Herz-Jesus-P25/images",
    "herz_jesu_8": "openMVG/SfM_quality_evaluation, Benchmarking_Camera_Calibration_2008/Herz-Jesus-P8/images",
    "hill_side": "tmizu23/cesium_oppaiyama, images",
    "hilti": "borglab/gtsfm, tests/data/hilti_exp4_small/images",
    "house": "yyfz/Pi3, examples/house (one photograph a room)",
    "kermit": "snavely/bundler_sfm, examples/kermit",
    "lund_door": "hkaiyu/structure-from-motion, dataset/erik/erik_3/images",
    "lund_eight": "hkaiyu/structure-from-motion, dataset/erik/erik_6/images",
    "lund_eleven": "hkaiyu/structure-from-motion, dataset/erik/erik_9/images",
    "lund_fourteen": "hkaiyu/structure-from-motion, dataset/erik/erik_4/images",
    "lund_nine": "hkaiyu/structure-from-motion, dataset/erik/erik_2/images",
    "lund_seven": "hkaiyu/structure-from-motion, dataset/erik/erik_7/images",
    "lund_street": "mapillary/OpenSfM, data/lund/images",
    "lund_ten": "hkaiyu/structure-from-motion, dataset/erik/erik_5/images",
    "lund_twelve": "hkaiyu/structure-from-motion, dataset/erik/erik_8/images",
    "mobilebrick": "borglab/gtsfm, tests/data/mobilebrick/image",
    "monstree": "alicevision/dataset_monstree, full",
    "parkour": "yyfz/Pi3, examples/parkour",
    "red_fountain": "hkaiyu/structure-from-motion, dataset/misc/red_fountain/images",
    "reichstag": "borglab/gtsfm, tests/data/imb_reichstag/images",
    "rock": "NLeSC/structure-from-motion, examples/rock",
    "rock_section": "NLeSC/structure-from-motion, examples/rock-section",
    "room": "yyfz/Pi3, examples/room/rgb",
    "sacre_coeur": "cvg/Hierarchical-Localization, datasets/sacre_coeur/mapping",
    "sample_mvs": "cdcseacave/openMVS_sample, images",
    "sceaux": "openMVG/ImageDataset_SceauxCastle, images",
    "seneca": "OpenDroneMap/odm_data_seneca, images",
    "snowpeak": "OpenDroneMap-ja/odm_data_snowpeak, img",
    "valley": "yyfz/Pi3, examples/valley",
}
"""Where blocks come from: public repositories, folder; all of their photographs that a clone holds, in the order of their names."""
REDUCED = "Photographs with a longer side of more than 1380 px were reduced to 1200 px (Lanczos, EXIF kept)."
CHOSEN = "Every folder at hand of up to thirty photographs, whatever came out."


@dataclass(frozen=True)
class Row:
    """One folder: its `name`, number of `photos`, how many are `oriented`, groups of their own (`apart`), sigma0 and the mean
    residual in px, iterations, CPU seconds; photographs, mean residual and CPU seconds of the peer (-1: not run); the commit that
    was measured (`state`); the warnings of the report, or how the run failed (`said`)."""

    name: str
    photos: int
    oriented: int = 0
    apart: str = ""
    sigma0_px: float = 0.0
    residual_px: float = 0.0
    iterations: int = 0
    cpu: float = 0.0
    peer_oriented: int = -1
    peer_px: float = 0.0
    peer_cpu: float = 0.0
    state: str = ""
    said: str = ""


def cpu_of_children() -> float:
    """CPU seconds of all processes that were started and ended so far."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def row_of(folder: Path) -> Row:
    """The row of one folder of photographs, without the peer."""
    photos = sum(path.suffix.lower() in SUFFIXES for path in folder.iterdir())
    with tempfile.TemporaryDirectory(dir=Path.cwd()) as place:
        root, before = Path(place), cpu_of_children()
        (root / "photographs").symlink_to(folder.resolve())
        try:
            write_starting_workflow("block", root / "photographs", root, STAGES)
        except Exception as error:  # how a folder is refused is a result, too
            return Row(folder.name, photos, said=str(error)[:WIDEST])
        run = orthomill(root, "run", "block", "--until", "orientation")
        cpu = cpu_of_children() - before
        if run.code:
            # The sentence on the first job that failed; what follows says that the project is not complete.
            failed = [line for line in run.output.splitlines() if line.startswith("failed ")] or run.output.splitlines()[-1:]
            return Row(folder.name, photos, cpu=cpu, said=" ".join(failed[0].split())[:WIDEST] if failed else "")
        return _oriented(Row(folder.name, photos, cpu=cpu), root / "runs" / "block")


def _oriented(row: Row, run: Path) -> Row:
    tables = run / "tables" / "orientation"
    block = Block.model_validate_json((tables / "block.json").read_bytes())
    apart = SeparateBlocks.model_validate_json((tables / "separate_blocks.json").read_bytes())
    return replace(
        row,
        oriented=len(block.photos),
        apart=", ".join(str(len(one.photos)) for one in apart.blocks),
        sigma0_px=block.sigma0_px,
        residual_px=mean_residual(run),
        iterations=block.iterations,
        said=SEPARATOR.join(json.loads((tables / "report.json").read_text())["warnings"]),
    )


def with_peer(row: Row, python: str, folder: Path) -> Row:
    """The row with what the peer reached."""
    with tempfile.TemporaryDirectory() as place:
        names = sorted(path.name for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
        job = {"photographs": str(folder), "names": names, "out": place, "model": "SIMPLE_RADIAL", "camera": "", "fixed": False}
        path, before = Path(place) / "job.json", cpu_of_children()
        path.write_text(json.dumps(job | {"single": False}))
        script = Path(__file__).with_name("colmap_block.py")
        subprocess.run([python, script, path], check=False, capture_output=True)
        result, row = Path(place) / "result.json", replace(row, peer_oriented=0, peer_cpu=cpu_of_children() - before)
        if not result.exists():
            return row
        found = json.loads(result.read_text())
        return replace(row, peer_oriented=found["photos"], peer_px=found["error_px"])


def line_of(row: Row) -> str:
    """The line of the table."""
    peer = f"{row.peer_oriented} | {row.peer_px:.2f} | {row.peer_cpu:.0f}" if row.peer_oriented >= 0 else " | | "
    return (
        f"| {row.name} | {row.photos} | {row.oriented} | {row.apart} | {row.sigma0_px:.3f} | {row.residual_px:.3f} | "
        f"{row.iterations} | {row.cpu:.0f} | {peer} | {len(_sentences(row))} |"
    )


def _sentences(row: Row) -> list[str]:
    return row.said.split(SEPARATOR) if row.said else []


def rows_before() -> dict[str, Row]:
    """The rows that were measured before, by name."""
    if not RECORD.exists():
        return {}
    kinds = {"int": int, "float": float, "str": str}
    with RECORD.open() as file:
        read = csv.DictReader(file)
        found = [Row(*(kinds[getattr(f.type, "__name__", f.type)](row[f.name]) for f in fields(Row))) for row in read]
    return {row.name: row for row in found}


def keep(rows: dict[str, Row]) -> None:
    """Writes every row to the record beside the page, in the order of their names."""
    with RECORD.open("w", newline="") as file:
        table = csv.DictWriter(file, [field.name for field in fields(Row)], lineterminator="\n")
        table.writeheader()
        table.writerows(asdict(rows[name]) for name in sorted(rows))


def page(rows: dict[str, Row]) -> str:
    """The page of all rows."""
    own = [rows[name] for name in sorted(rows)]
    compared = [row for row in own if row.peer_oriented >= 0]
    more = sum(row.oriented >= row.peer_oriented for row in compared)
    cpu = np.sum([(row.cpu, row.peer_cpu) for row in compared], axis=0) if compared else np.zeros(2)
    text = [
        "# Foreign blocks",
        "",
        "All defaults, workflow by "
        "`init`; peer: COLMAP with its defaults (SIMPLE_RADIAL, cameras by EXIF) on the same photographs, its largest model. CPU "
        "seconds from photographs to block, kernels compiled before.",
        "",
        f"As many photographs as the peer or more on **{more} of {len(compared)}** blocks; CPU time {cpu[0]:.0f} against "
        f"{cpu[1]:.0f} s. Not oriented at all: {sum(row.oriented == 0 for row in own)} of {len(own)}. Most iterations: "
        f"{max((row.iterations for row in own), default=0)}.",
        "",
        HEAD,
        "|" + " --- |" * (HEAD.count("|") - 1),
        *map(line_of, own),
        "",
        f"Where they come from (GitHub, folder). {REDUCED} {CHOSEN} {_states(own)}",
        "",
        *(f"- {row.name}: {SOURCES.get(row.name, 'a folder of this machine')}" for row in own),
        "",
        "## What was said",
        "",
        *(line for row in own for line in _said(row)),
    ]
    return "\n".join(text).rstrip() + "\n"


def _states(rows: list[Row]) -> str:
    """At which commits the rows were measured."""
    names: dict[str, list[str]] = {}
    for row in rows:
        names.setdefault(row.state, []).append(row.name)
    most = max(names, key=lambda state: len(names[state]), default="")
    others = "".join(f"; at {state}: {', '.join(own)}" for state, own in names.items() if state != most)
    return f"Measured at {most}{others}."


def _said(row: Row) -> Iterator[str]:
    yield f"**{row.name}**"
    yield ""
    yield from (f"- {sentence}" for sentence in _sentences(row) or ["nothing"])
    yield ""


def main(words: list[str]) -> None:
    """Measures the folders named on the command line."""
    folders = [Path(word) for word in words if "=" not in word and word != "compiled"]
    python = next((word.removeprefix("peer=") for word in words if word.startswith("peer=")), None)
    if not folders:
        raise SystemExit("Name the folders of photographs: python -m benchmarks foreign_blocks FOLDER ...")
    if "compiled" not in words:
        row_of(folders[0])
    for folder in folders:
        row = replace(row_of(folder), state=f"commit {revision()}")
        rows = rows_before()
        beside = rows.get(row.name, row)
        kept = {"peer_oriented": beside.peer_oriented, "peer_px": beside.peer_px, "peer_cpu": beside.peer_cpu}
        rows[row.name] = with_peer(row, python, folder.resolve()) if python else replace(row, **kept)
        keep(rows)
        write_page("foreign_blocks", words, page(rows))
