"""What does a node answer to strangers, and what do they leave on its disk?

python -m benchmarks hostile_node [REQUESTS [ARCHIVES]]

The node is the command `serve` with the engine itself. Requests are drawn by lot from its routes, with and without the token; each
archive is uploaded and committed as a task of its own.
"""

import json
import random
import re
import shutil
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import requests

from benchmarks.instrument.result_page import write_page
from benchmarks.serving.hostile_archives import OUTSIDE, hostile_archives
from benchmarks.serving.killed_node import begun, memory
from benchmarks.serving.random_requests import ANSWERS, random_request
from benchmarks.serving.running_node import TOKEN, RunningNode, asked, node

PATIENCE = 1800.0
"""seconds for all tasks"""
_OF_A_TASK = re.compile(
    r"task\.json|wishes\.json|output\.txt|progress\.json|end\.json|process\.log|\.lock|images|workflows|runs|unused"
)


@dataclass
class Seen:
    """What came back, and what is on the disk."""

    codes: Counter[int] = field(default_factory=Counter)
    bad_answers: list[str] = field(default_factory=list)
    kinds: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    """archives by kind whose task ended with a sentence, or whose upload did"""
    defects: list[str] = field(default_factory=list)
    stray: list[str] = field(default_factory=list)
    """files where none may be"""
    open_answers: int = 0
    """answers without the token that tell anything of a task"""
    asked_without: int = 0
    memory: float = 0.0


def ask_at_random(running: RunningNode, count: int, seen: Seen, seed: int = 43) -> None:
    """So many requests; each with the token is sent again without it."""
    chance, uuids = random.Random(seed), [begun(running)]
    for _ in range(count):
        method, path, body, headers = random_request(chance, uuids[-4:])
        code, content, _ = asked(running, method, path, body, **headers)
        seen.codes[code] += 1
        if code not in ANSWERS or any(word in content for word in (b"Traceback", b"root:x:", TOKEN.encode())):
            seen.bad_answers.append(f"{method} {path[:200]}: {code}")
        if code == 200 and content.startswith(b'{"uuid"'):
            uuids.append(json.loads(content)["uuid"])
        _without_token(running, method, path.replace(TOKEN, "not-the-token"), uuids, seen)


def _without_token(running: RunningNode, method: str, path: str, uuids: list[str], seen: Seen) -> None:
    code, content, _ = asked(running, method, path)
    seen.asked_without += 1
    told = any(uuid.encode() in content for uuid in uuids)
    seen.open_answers += told or (code == 200 and path.split("?")[0] not in ("/", "/login", "/health"))


def upload_archives(running: RunningNode, count: int, seen: Seen) -> dict[str, str]:
    """So many tasks of one archive each: uuid -> kind."""
    tasks: dict[str, str] = {}
    for kind, content in hostile_archives(43, count):
        seen.kinds[kind] += 1
        uuid, at = begun(running, kind), f"http://127.0.0.1:{running.port}/task/new"
        sent = requests.post(f"{at}/upload/{uuid}", params={"token": TOKEN}, files={"images": ("block.zip", content)}, timeout=300)
        told = requests.post(f"{at}/commit/{uuid}", params={"token": TOKEN}, timeout=300)
        for answer in (sent, told):
            seen.codes[answer.status_code] += 1
        if "error" in told.json():
            seen.refused[kind] += 1
        else:
            tasks[uuid] = kind
    return tasks


def wait_for(running: RunningNode, tasks: dict[str, str], seen: Seen) -> None:
    """Until all of them have ended; what became of each."""
    until, left = time.monotonic() + PATIENCE, dict(tasks)
    while left and time.monotonic() < until:
        for uuid in list(left):
            address = f"http://127.0.0.1:{running.port}/task/{uuid}/info"
            told = requests.get(address, params={"token": TOKEN, "with_output": "0"}, timeout=60).json()
            if told["status"]["code"] in (10, 20):
                break
            _judge(told, left.pop(uuid), seen)
        time.sleep(0.2)
    seen.defects += [f"{kind} did not end" for kind in left.values()]
    for uuid in tasks:
        for path in ("info", "output", "assets", "download/all.zip"):
            _without_token(running, "GET", f"/task/{uuid}/{path}", [uuid], seen)


def _judge(told: dict, kind: str, seen: Seen) -> None:
    error, code = told["status"].get("errorMessage", ""), told["status"]["code"]
    if code == 30 and error and "\n" not in error:
        seen.refused[kind] += 1
    text = "\n".join([error, *told["output"]])
    if code != 30 or "defect of orthomill" in text or "Traceback" in text or "\x1b" in text:
        seen.defects.append(f"{kind}: {code} {text[-300:]}")


def look_at_disk(running: RunningNode, before: set[Path], seen: Seen) -> None:
    """Whatever is not where a task's files are, and tracebacks."""
    home = running.home
    seen.stray += [str(path) for path in set(home.parent.iterdir()) - before - {home}]
    made = [*Path("/tmp").glob(f"{OUTSIDE}*"), *home.parent.rglob(f"{OUTSIDE}*")]
    seen.stray += [str(path) for path in made if path.parent.name != "images"]
    for task in (home / "tasks").iterdir():
        seen.stray += [str(path) for path in task.iterdir() if not _OF_A_TASK.fullmatch(path.name)]
        seen.stray += [str(path) for path in (task / "images").iterdir() if path.is_symlink() or not path.is_file()]
    for log in (home / "node.log", *home.glob("tasks/*/process.log")):
        if "Traceback" in log.read_text(errors="replace"):
            seen.defects.append(f"traceback in {log.relative_to(home)}")


def main(words: list[str]) -> None:
    """Measures, and writes the page."""
    count, archives = int(words[0]) if words else 1000, int(words[1]) if words[1:] else 200
    place, seen = Path(tempfile.mkdtemp(prefix="hostile_node")), Seen()
    try:
        with node(place / "home", real=True) as running:
            before = set(place.iterdir())
            ask_at_random(running, count, seen)
            tasks = upload_archives(running, archives, seen)
            wait_for(running, tasks, seen)
            look_at_disk(running, before, seen)
            seen.memory = memory(running)
            alive = running.process.poll() is None
    finally:
        shutil.rmtree(place, ignore_errors=True)
    codes = ", ".join(f"{code}: {number}" for code, number in sorted(seen.codes.items()))
    kinds = "\n".join(f"| {kind} | {number} | {seen.refused[kind]} |" for kind, number in seen.kinds.items())
    found = "".join(f"\n- {json.dumps(one)}" for one in [*seen.bad_answers, *seen.defects, *seen.stray][:40])
    write_page(
        "hostile_node",
        words,
        f"""# A node among strangers

The command `serve` with the engine itself; requests are drawn by lot from its routes, archives come in turns of
{len(seen.kinds)} kinds, each as a task of its own.

| what | figure |
| --- | --- |
| requests by lot | {count} |
| answers by code, with those of the uploads | {codes} |
| answers with another code, a traceback or the token | {len(seen.bad_answers)} |
| requests without the token | {seen.asked_without} |
| of them answered with anything of a task | {seen.open_answers} |
| archives | {sum(seen.kinds.values())} |
| ended with a sentence | {sum(seen.refused.values())} |
| tracebacks, tasks that ended otherwise or not at all | {len(seen.defects)} |
| files outside of the folders of tasks, links and devices in them | {len(seen.stray)} |
| memory of the node at most | {seen.memory:.0f} MB |
| the node lives at the end | {"yes" if alive else "no"} |

| archives | number | ended with a sentence |
| --- | --- | --- |
{kinds}
{found}
""",
    )
