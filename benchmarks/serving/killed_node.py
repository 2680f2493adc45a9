"""A node that is killed with -9 at random moments while clients upload and tasks run: is anything lost that was acknowledged?

python -m benchmarks killed_node [KILLS [TASKS]]

Clients repeat what was not answered, as PyODM does. Then, of one that lives: its memory with fifty tasks queued and four uploads
at once.
"""

import random
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread
from uuid import UUID

import requests

from benchmarks.instrument.result_page import write_page
from benchmarks.serving.running_node import TOKEN, RunningNode, free_port, node

FILES = 5
PATIENCE = 300.0
"""seconds after the last kill"""
BLOCK = 2**20


@dataclass
class Outcome:
    """What clients were told, and what was found afterwards."""

    acknowledged: dict[str, dict[str, bytes]] = field(default_factory=dict)
    """uuid -> files by name whose upload was acknowledged"""
    committed: set[str] = field(default_factory=set)
    lost_files: int = 0
    unfinished: list[str] = field(default_factory=list)
    repeated: int = 0
    """requests that had to be repeated"""
    continued: int = 0
    """tasks that a second process went on with"""


def killed(home: Path, kills: int, tasks: int, seed: int = 43, longest: float = 1.2) -> Outcome:
    """Kill a node so many times, `longest` seconds at most after it answers, while clients give it so many tasks."""
    chance, port, outcome = random.Random(seed), free_port(), Outcome()
    clients = Thread(target=_clients, args=(f"http://127.0.0.1:{port}", tasks, chance.random(), outcome), daemon=True)
    clients.start()
    for _ in range(kills):
        with node(home, port, STANDIN_STEPS="12", STANDIN_PAUSE="0.1"):
            time.sleep(chance.uniform(0.0, longest))
    with node(home, port, STANDIN_STEPS="12", STANDIN_PAUSE="0.1") as last:
        clients.join(PATIENCE)
        _wait(last, outcome)
        _judge(last, outcome)
    return outcome


def _clients(address: str, tasks: int, seed: float, outcome: Outcome) -> None:
    chance = random.Random(seed)
    for number in range(tasks):
        uuid = str(UUID(int=chance.getrandbits(128), version=4))
        _again(outcome, f"{address}/task/new/init", data={"name": f"task {number}"}, headers={"set-uuid": uuid})
        kept = outcome.acknowledged.setdefault(uuid, {})
        for file in range(FILES):
            name, content = f"{file}.jpg", chance.randbytes(chance.randrange(1, 300_000))
            _again(outcome, f"{address}/task/new/upload/{uuid}", files={"images": (name, content)})
            kept[name] = content
        _again(outcome, f"{address}/task/new/commit/{uuid}")
        outcome.committed.add(uuid)


def _again(outcome: Outcome, address: str, **given) -> None:
    """Post until it is answered. An answer that was lost with the server is repeated by it: that there is such a task already."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        try:
            told = requests.post(address, params={"token": TOKEN}, timeout=30, **given).json()
        except (requests.exceptions.RequestException, ValueError):
            outcome.repeated += 1
            time.sleep(0.05)
            continue
        if "error" in told and "already" not in told["error"]:
            raise AssertionError(told)
        return
    raise AssertionError(f"{address} was not answered")


def _wait(last: RunningNode, outcome: Outcome) -> None:
    until, client = time.monotonic() + PATIENCE, last.client()
    while time.monotonic() < until:
        states = {uuid: client.get_task(uuid).info().status.value for uuid in outcome.committed}
        outcome.unfinished = sorted(uuid for uuid, status in states.items() if status != 40)
        if not any(status in (10, 20) for status in states.values()):
            return
        time.sleep(0.3)


def _judge(last: RunningNode, outcome: Outcome) -> None:
    for uuid in outcome.committed:
        folder = last.home / "tasks" / uuid
        found = {path.name: path.read_bytes() for path in (folder / "images").glob("*")}
        outcome.lost_files += sum(found.get(name) != content for name, content in outcome.acknowledged[uuid].items())
        outcome.continued += "Continued after an interruption" in (folder / "output.txt").read_text()


def memory(running: RunningNode) -> float:
    """The largest memory of a node so far, MB."""
    status = Path(f"/proc/{running.process.pid}/status").read_text()
    found = re.search(r"VmHWM:\s+(\d+) kB", status)
    assert found is not None
    return int(found[1]) / 1024


def upload_streamed(running: RunningNode, uuid: str, name: str, megabytes: int) -> dict:
    """Send a file that is never whole in memory, neither here nor, one hopes, there; the answer."""
    boundary = "b0undary"

    def body() -> Iterator[bytes]:
        yield f'--{boundary}\r\nContent-Disposition: form-data; name="images"; filename="{name}"\r\n\r\n'.encode()
        block = random.Random(1).randbytes(BLOCK)
        for _ in range(megabytes):
            yield block
        yield f"\r\n--{boundary}--\r\n".encode()

    address = f"http://127.0.0.1:{running.port}/task/new/upload/{uuid}"
    headers = {"Content-Type": f"multipart/form-data; boundary={boundary}"}
    return requests.post(address, params={"token": TOKEN}, data=body(), headers=headers, timeout=600).json()


def begun(running: RunningNode, name: str = "task") -> str:
    """The UUID of an upload that has begun."""
    address = f"http://127.0.0.1:{running.port}/task/new/init"
    return requests.post(address, params={"token": TOKEN}, data={"name": name}, timeout=60).json()["uuid"]


def _queued_and_uploading(home: Path, tasks: int, uploads: int, megabytes: int) -> tuple[float, float]:
    """Memory (MB) of a node at rest, and with so many tasks queued and so many uploads of so many MB at once."""
    with node(home, STANDIN_PAUSE="5") as running:
        before = memory(running)
        for number in range(tasks):
            uuid = begun(running, f"task {number}")
            for name in ("a.jpg", "b.jpg"):
                upload_streamed(running, uuid, name, 1)
            requests.post(f"http://127.0.0.1:{running.port}/task/new/commit/{uuid}", params={"token": TOKEN}, timeout=60)
        uuid = begun(running)
        with ThreadPoolExecutor(uploads) as pool:
            told = list(pool.map(lambda number: upload_streamed(running, uuid, f"{number}.tif", megabytes), range(uploads)))
        assert told == [{"success": True}] * uploads
        return before, memory(running)


def main(words: list[str]) -> None:
    """Measures, and writes the page."""
    kills, tasks = int(words[0]) if words else 50, int(words[1]) if words[1:] else 25
    home = Path(tempfile.mkdtemp(prefix="killed_node"))
    try:
        began = time.monotonic()
        found = killed(home / "killed", kills, tasks)
        seconds = time.monotonic() - began
        before, after = _queued_and_uploading(home / "loaded", 50, 4, 300)
    finally:
        shutil.rmtree(home, ignore_errors=True)
    files = sum(map(len, found.acknowledged.values()))
    write_page(
        "killed_node",
        words,
        f"""# A node that is killed

An engine that stands in does twelve steps of 0.1 s for each task; clients repeat what was not answered.

| what | figure |
| --- | --- |
| kills with -9, at random moments up to 1.2 s after the start | {kills} |
| requests that clients had to repeat | {found.repeated} |
| tasks given and acknowledged | {len(found.committed)} of {tasks} |
| tasks completed | {len(found.committed) - len(found.unfinished)} |
| files acknowledged | {files} |
| of them lost or changed | {found.lost_files} |
| seconds for all of it | {seconds:.0f} |
| memory of a node at rest | {before:.0f} MB |
| with 50 tasks queued and 4 uploads of 300 MB at once | {after:.0f} MB |
""",
    )
