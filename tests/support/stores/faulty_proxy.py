"""A network between a command and its store that breaks requests by lot: refused, cut, half sent, unanswered."""

import random
import socket
import threading
from contextlib import suppress
from enum import StrEnum

BUSY = b"HTTP/1.1 503 Slow Down\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


class Fault(StrEnum):
    """What happens to a request."""

    BUSY = "the store answers 503"
    SILENT = "no answer until the connection is closed after a second"
    CUT = "the connection is cut in the middle of the request"
    LOST = "the request is done and its answer is lost"


class FaultyProxy:
    """Hands requests from `port` on to another port of this machine, a connection each, and breaks a `share` of them."""

    def __init__(self, upstream: int, fault: Fault, share: float, seed: int) -> None:
        self._upstream, self._fault, self._share = upstream, fault, share
        self._chance, self._lock, self._ended = random.Random(seed), threading.Lock(), threading.Event()
        self.requests = self.broken = 0
        self._listening = socket.create_server(("127.0.0.1", 0), backlog=64)
        self.port = self._listening.getsockname()[1]
        threading.Thread(target=self._listen, daemon=True).start()

    def close(self) -> None:
        """No further connection is taken."""
        self._ended.set()
        self._listening.close()

    def _listen(self) -> None:
        while not self._ended.is_set():
            with suppress(OSError):
                client, _ = self._listening.accept()
                threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _breaks(self) -> bool:
        with self._lock:
            broken = self._chance.random() < self._share
            self.requests, self.broken = self.requests + 1, self.broken + broken
        return broken

    def _serve(self, client: socket.socket) -> None:
        with client, suppress(OSError):
            if not (request := _whole_request(client)):
                return
            broken = self._breaks()
            if broken and self._fault is Fault.BUSY:
                client.sendall(BUSY)
            elif broken and self._fault is Fault.SILENT:
                self._ended.wait(1.0)
            else:
                self._hand_on(client, request, broken)

    def _hand_on(self, client: socket.socket, request: bytes, broken: bool) -> None:
        with socket.create_connection(("127.0.0.1", self._upstream)) as store:
            if broken and self._fault is Fault.CUT:
                store.sendall(request[: len(request) // 2])
                return
            store.sendall(request)
            answer = b"".join(iter(lambda: store.recv(1 << 16), b""))
        client.sendall(answer[: len(answer) // 2] if broken else answer)


def _whole_request(client: socket.socket) -> bytes:
    """Head and body, with the wish for a connection of its own; empty where there was none."""
    head = b""
    while b"\r\n\r\n" not in head:
        if not (more := client.recv(1 << 16)):
            return b""
        head += more
    head, _, body = head.partition(b"\r\n\r\n")
    lines = [line for line in head.split(b"\r\n") if not line.lower().startswith(b"connection:")]
    length = next((int(line.split(b":")[1]) for line in lines if line.lower().startswith(b"content-length:")), 0)
    while len(body) < length:
        if not (more := client.recv(1 << 16)):
            return b""
        body += more
    return b"\r\n".join((*lines, b"Connection: close")) + b"\r\n\r\n" + body
