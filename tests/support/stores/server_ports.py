"""Ports for servers that a test starts."""

import os
import socket

_GIVEN: set[int] = set()
"""in this process: a server that starts binds its ports later, and the next one must not be given them meanwhile"""


def free_ports(count: int) -> list[int]:
    """Ports below those that the system gives away, since the server adds 10 000 to some of them."""
    found = []
    for port in range(12000 + os.getpid() % 4000, 20000):
        if port in _GIVEN:
            continue
        with socket.socket() as one, socket.socket() as other:
            try:
                one.bind(("127.0.0.1", port))
                other.bind(("127.0.0.1", port + 10000))
            except OSError:
                continue
            found.append(port)
        _GIVEN.add(port)
        if len(found) == count:
            return found
    raise RuntimeError("no free ports")
