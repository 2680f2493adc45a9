"""Projects whose files hold anything: the command answers with an exit code and sentences, and writes nothing where it must not.

`make fuzz` draws thousands.
"""

import json
import os
import random
import shutil
import time

import numpy as np
import pytest
from small_site import WORKFLOW, app, make_site, photographs, write_workflow
from typer.testing import CliRunner

CASES = int(os.environ.get("ORTHOMILL_FUZZ", "40"))
HANGS = 120.0
"""s; a run of the three photographs takes two on an idle machine"""
NUMBERS = ("nan", "inf", "-1", "0", "1e300", "1e-300", "4e9", "", " ", "1,5", "٣", "9" * 400, '"', "576000", "5188000.5")
POSITIONS = "photo,x,y,z,sigma_x,sigma_y,sigma_z\n"
POINTS = "name,role,x,y,z,sigma_x,sigma_y,sigma_z\n"
CAMERA = {"name": "c", "width": 640, "height": 360, "c": 500.0, "k1": 0.01}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return make_site(tmp_path_factory.mktemp("fuzzed"))


def any_table(chance: random.Random, header: str, words: list[str]) -> str:
    cells = [*NUMBERS, *words, "control", "check", "tie", "\x00", "\ufeff", "x" * 300]
    rows = [",".join(chance.choice(cells) for _ in range(chance.randrange(1, 10))) for _ in range(chance.randrange(5))]
    return chance.choice((header, header, header.replace(",", ";"), "")) + "\n".join(rows)


def spoiled(chance: random.Random, content: bytes) -> bytes:
    """Some bytes exchanged, or the end lost."""
    changed = bytearray(content)
    for _ in range(chance.choice((1, 5, 50))):
        changed[chance.randrange(min(len(changed), chance.choice((64, 2000, len(changed)))))] = chance.randrange(256)
    return bytes(changed[: chance.randrange(len(changed))]) if chance.random() < 0.2 else bytes(changed)


def spoil(site, chance: random.Random) -> None:
    """Write a project of which one or two files hold anything."""
    names = [photo.stem for photo in photographs(site)]
    changes = {}
    if chance.random() < 0.5:
        (site / "positions.csv").write_text(any_table(chance, POSITIONS, names))
        changes["positions"] = {"kind": "file", "path": "positions.csv"}
    if chance.random() < 0.5:
        (site / "points.csv").write_text(any_table(chance, POINTS, ["P1"]))
        (site / "measured.csv").write_text(any_table(chance, "name,photo,col,row,sigma\n", ["P1", *names]))
        changes["control"] = {"kind": "files", "points": "points.csv", "measurements": "measured.csv"}
    if chance.random() < 0.3:
        values = CAMERA | {chance.choice(list(CAMERA)): chance.choice((float("nan"), -1, 0, 1e300, "a", None, [], 1e-300))}
        (site / "camera.json").write_text(json.dumps(values)[: chance.choice((None, 20))])
        changes["cameras"] = {"kind": "file", "path": "camera.json"}
    write_workflow(site, **changes)
    if chance.random() < 0.2:
        path = site / "workflows" / "site.yaml"
        path.write_bytes(spoiled(chance, path.read_bytes()))


def state_of(site) -> dict:
    return {path: path.stat().st_mtime_ns for path in site.rglob("*") if path.is_file()}


@pytest.mark.parametrize("start", range(0, CASES, 20))
def test_whatever_files_hold_plan_answers_and_writes_nothing(site, monkeypatch, start):
    monkeypatch.chdir(site)
    originals = {photo: photo.read_bytes() for photo in photographs(site)}
    for seed in range(start, start + 20):
        chance = random.Random(seed)
        spoil(site, chance)
        photo = chance.choice(list(originals))
        if chance.random() < 0.4:
            photo.write_bytes(spoiled(chance, originals[photo]))
        before = state_of(site)
        result = CliRunner().invoke(app, ["plan", WORKFLOW["project"]])
        assert result.exit_code in (0, 2), (seed, result.output, result.exception)
        assert result.exception is None or isinstance(result.exception, SystemExit), (seed, result.exception)
        if result.exit_code == 2:
            assert result.output.startswith("error: ") and len(result.output.splitlines()) <= 40, (seed, result.output)
        assert "unexpected" not in result.output and "Traceback" not in result.output, (seed, result.output)
        assert state_of(site) == before, seed
        photo.write_bytes(originals[photo])


def plausible_table(chance: random.Random, header: str, name: str, near: tuple[float, float, float]) -> str:
    """Positions of three photographs as people have them, one of them spoiled: far away, upside down, without height, twice."""
    rows = []
    for number in range(3):
        x, y, z = (value + chance.uniform(-20, 20) for value in near)
        rows.append([f"{name}{number}", x, y, z, 2.0, 2.0, 4.0])
    row = chance.choice(rows)
    row[chance.randrange(1, 4)] = chance.choice((0.0, 1e4, -1e4, 4e9, near[0], float("nan"), 1e-12))
    if chance.random() < 0.3:
        row[chance.randrange(4, 7)] = chance.choice((0.0, -1.0, 1e9, 1e-9))
    if chance.random() < 0.2:
        rows.append(list(row))
    return header + "\n".join(",".join(map(str, row)) for row in rows)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(max(CASES // 10, 4)))
def test_whatever_files_hold_run_answers_and_what_it_makes_has_numbers(site, monkeypatch, seed):
    monkeypatch.chdir(site)
    originals, chance = {photo: photo.read_bytes() for photo in photographs(site)}, random.Random(10_000 + seed)
    spoil(site, chance)
    if chance.random() < 0.6:
        names = [photo.stem for photo in originals]
        text = plausible_table(chance, POSITIONS, "p", (576_700.0, 5_188_100.0, 300.0))
        for number, name in enumerate(names):
            text = text.replace(f"p{number},", f"{name},")
        (site / "positions.csv").write_text(text)
        write_workflow(site, positions={"kind": "file", "path": "positions.csv"})
    photo = chance.choice(list(originals))
    if chance.random() < 0.5:
        photo.write_bytes(spoiled(chance, originals[photo]))
    before, started = state_of(site), time.monotonic()
    result = CliRunner().invoke(app, ["run", WORKFLOW["project"], "--sequential"])
    photo.write_bytes(originals[photo])
    assert result.exit_code in (0, 1, 2), (seed, result.output, result.exception)
    assert result.exception is None or isinstance(result.exception, SystemExit), (seed, result.exception)
    assert "unexpected" not in result.output and "Traceback" not in result.output, (seed, result.output)
    outside = {path: when for path, when in state_of(site).items() if "runs" not in path.parts and path != photo}
    assert outside == {path: when for path, when in before.items() if "runs" not in path.parts and path != photo}, seed
    assert time.monotonic() - started < HANGS, seed
    block = site / "runs" / WORKFLOW["project"] / "tables" / "orientation" / "block.json"
    if result.exit_code == 0 and block.exists():
        found = json.loads(block.read_text())
        numbers = [value for one in found["photos"] for value in (*one["centre"], *one["omega_phi_kappa"])]
        assert np.isfinite(numbers).all() and np.isfinite(found["sigma0_px"]), (seed, result.output)
    shutil.rmtree(site / "runs", ignore_errors=True)
