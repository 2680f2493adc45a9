"""JSON with a checksum of its own: a digit that rots on the disk leaves a file that reads as well as before, with another number.

The seal is the last value of the outermost object, and covers all the text before it.
"""

import zlib

_SEAL = b',"seal":"'


def seal(text: bytes) -> bytes:
    """The text of a JSON object with its seal; other values, and the empty object, have none."""
    if not text.endswith(b"}") or text.rstrip(b"} \n").endswith(b"{"):
        return text
    return text[:-1] + _SEAL + _checksum(text)


def unsealed(content: bytes) -> bytes | None:
    """The text without its seal, None where the two contradict each other. Files of earlier versions have no seal."""
    start, mark, checksum = content.rpartition(_SEAL)
    if not mark:
        return content
    text = start + b"}"
    return text if checksum == _checksum(text) else None


def _checksum(text: bytes) -> bytes:
    """The checksum of a text, with the end of the file."""
    return b'%08x"}' % zlib.crc32(text)
