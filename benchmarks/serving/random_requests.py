"""Requests that know the routes of the node, and hold what no client would send."""

import json
import random
import urllib.parse

from benchmarks.serving.running_node import TOKEN

UUID = "01234567-89ab-cdef-0123-456789abcdef"
"""of no task"""
BOUNDARY = "xXx"
ANSWERS = frozenset({200, 303, 401, 404, 405, 416})
"""codes that a request may get"""
ROUTES = ["/", "/info", "/options", "/tasks.json", "/login", "/auth/info", "/auth/login", "/view/{n}/{u}/{n}", "/{n}", "/task/list"]
ROUTES += ["/task/new", "/task/new/init", "/task/new/upload/{u}", "/task/new/commit/{u}", "/task/{u}/info", "/task/{u}/output"]
ROUTES += [
    "/task/{u}/assets",
    "/task/{u}/download/{n}",
    "/task/{u}/download/../{n}",
    "/task/cancel",
    "/task/remove",
    "/task/restart",
    "/task/{n}",
]
NAMES = ["all.zip", "../../../etc/passwd", "%2e%2e%2f%2e%2e%2ftoken.txt", "%00", "task.json", "odm_dem/dsm.tif", "é", "x" * 3000]
NAMES += [""]
VALUES = [
    "",
    "0",
    "-1",
    "9" * 30,
    "NaN",
    "[]",
    "{}",
    '[{"name": "dtm"}]',
    '[{"name": "tile", "value": "x"}]',
    "\x00",
    "é" * 50,
    '[{"name": "crs", "value": "\\ud800"}]',
]
FIELDS = [
    "uuid",
    "options",
    "name",
    "webhook",
    "outputs",
    "dateCreated",
    "zipurl",
    "readS3Path",
    "writeS3Path",
    "skipPostProcessing",
]


def form(*parts: tuple[str, str | None, bytes], end: bytes = b"--") -> bytes:
    """The body of a form: name, name of the file (None: a field), content of every part; `end` closes it, b"" does not."""
    text = b""
    for name, filename, content in parts:
        file = f'; filename="{filename}"' if filename is not None else ""
        text += f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="{name}"{file}\r\n\r\n'.encode() + content + b"\r\n"
    return text + f"--{BOUNDARY}".encode() + end + b"\r\n"


def random_request(chance: random.Random, uuids: list[str]) -> tuple[str, str, bytes | None, dict[str, str]]:
    """Method, path with the token, body and headers of a request, which may name one of the tasks `uuids`."""
    path = chance.choice(ROUTES).replace("{u}", chance.choice([*uuids, UUID, "x", UUID.upper()]))
    while "{n}" in path:
        path = path.replace("{n}", chance.choice(NAMES), 1)
    query = {"token": TOKEN, chance.choice(["with_output", "line", "token2"]): chance.choice(VALUES)}
    fields = {name: chance.choice([*VALUES, *uuids]) for name in chance.sample(FIELDS, 4)}
    kind = chance.choice(["form", "json", "multipart", "noise", "none"])
    body: bytes | None = None
    headers = {"set_uuid": chance.choice([UUID, "../x", "x"])} if chance.random() < 0.3 else {}
    if kind == "form":
        body, headers["Content_Type"] = urllib.parse.urlencode(fields).encode(), "application/x-www-form-urlencoded"
    elif kind == "json":
        body = json.dumps(chance.choice([fields, [], None, {"uuid": {}}, {"options": {"a": 1}}])).encode()
        headers["Content_Type"] = "application/json"
    elif kind == "multipart":
        parts: list[tuple[str, str | None, bytes]] = [(name, None, value.encode()) for name, value in fields.items()]
        parts += [("images", chance.choice([*NAMES, "a.jpg", "b.zip", "gcp_list.txt"]).replace("\x00", ""), b"PK\x03\x04" * 9)]
        body = form(*parts, end=chance.choice([b"--", b""]))[: chance.choice([None, 30, 200])]
        headers["Content_Type"] = chance.choice([f"multipart/form-data; boundary={BOUNDARY}", "multipart/form-data", "multipart/x"])
    elif kind == "noise":
        body = chance.randbytes(300)
        headers["Content_Type"] = chance.choice(["application/json", f"multipart/form-data; boundary={BOUNDARY}", "text/plain"])
    text = urllib.parse.quote(path, safe="/%.") + "?" + urllib.parse.urlencode(query)
    return chance.choice(["GET", "POST", "POST", "HEAD", "PUT"]), text, body, headers
