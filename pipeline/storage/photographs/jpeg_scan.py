"""Whether the picture of a JPEG is whole: its Huffman codes are followed from the first to the last block, without making pixels.

Decoders show what they get: where a part of the file was lost or overwritten, the codes after it are read from a wrong place, fall
into step again by chance, and the rest of the picture is displaced and recoloured, without an error. What cannot happen in a sound
file tells it: a code that the file does not define, a coefficient beyond the last of its block, a brightness that no pixels have,
the end of the data before the last block, data left after it, or a restart marker out of turn.

Source: ISO/IEC 10918-1 (ITU-T T.81), annexes B, C and F. Followed are sequential Huffman files of 8 bits, which cameras write;
libjpeg itself finds the same faults in progressive ones, all of whose scans it reads before the first row.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from orthomill.kernels.kernel_compilation import njit

SEQUENTIAL = frozenset({0xC0, 0xC1})
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_DHT, _SOF_END, _SOI, _EOI, _SOS, _DQT, _DRI = 0xC4, 0xCF, 0xD8, 0xD9, 0xDA, 0xDB, 0xDD
_LONGEST = 16  # bits of a code


class Fault(IntEnum):
    """What is wrong with a scan."""

    NONE = 0
    NO_SUCH_CODE = 1
    BEYOND_BLOCK = 2
    IMPOSSIBLE_GREY = 3
    ENDS_EARLY = 4
    DATA_LEFT = 5
    OUT_OF_TURN = 6


@dataclass(frozen=True)
class Broken:
    """Where the picture of a file stops making sense: the fault, and the share of the blocks before it."""

    fault: Fault
    share: float


@dataclass
class _Definitions:
    """What the segments before a scan define. Tables are kept by class (0: DC, 1: AC) and number, as the file names them."""

    width: int = 0
    height: int = 0
    components: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    """by identifier: horizontal and vertical sampling, number of the quantisation table"""
    codes: dict[int, np.ndarray] = field(default_factory=dict)
    steps: dict[int, int] = field(default_factory=dict)
    """by table: the quantisation of the DC coefficient"""
    restart: int = 0
    sequential: bool = True


def broken_jpeg(content: bytes) -> Broken | None:
    """The first fault of the picture of a JPEG file; None for a sound one, and for kinds that are not followed here (progressive,
    arithmetic, 12 bits). A file whose segments cannot be read is left to the decoder."""
    frame, data = _Definitions(), np.frombuffer(content, np.uint8)
    for marker, body, end in _segments(content):
        if marker in _FRAMES and not _read_frame(frame, marker, body):
            return None
        if marker == _DHT:
            _read_codes(frame, body)
        elif marker == _DQT:
            _read_steps(frame, body)
        elif marker == _DRI:
            frame.restart = int.from_bytes(body[:2], "big")
        elif marker == _SOS and (broken := _broken_scan(frame, body, data, end)):
            return broken
    return None


def _segments(content: bytes) -> Iterator[tuple[int, bytes, int]]:
    """Marker, body and end of every segment up to the end of the image; the data of scans lie between them."""
    at = 2
    while 0 <= at < len(content) - 3:
        marker = content[at + 1]
        if content[at] != 0xFF or marker in (0x00, 0xFF) or 0xD0 <= marker <= _SOI:
            # In the data of a scan, or fill bytes.
            at = content.find(b"\xff", at + 1)
            continue
        if marker == _EOI:
            return
        end = at + 2 + int.from_bytes(content[at + 2 : at + 4], "big")
        yield marker, content[at + 4 : end], end
        at = end


def _read_frame(frame: _Definitions, marker: int, body: bytes) -> bool:
    """Whether the frame is of a kind that is followed."""
    if marker not in SEQUENTIAL or len(body) < 6 or body[0] != 8:
        return False
    frame.height, frame.width = int.from_bytes(body[1:3], "big"), int.from_bytes(body[3:5], "big")
    parts = [body[6 + 3 * i : 9 + 3 * i] for i in range(body[5])]
    frame.components = {part[0]: (part[1] >> 4, part[1] & 15, part[2]) for part in parts if len(part) == 3}
    # A height of zero is stated after the first scan (DNL), which no camera does.
    return frame.height > 0 and all(h and v for h, v, _ in frame.components.values())


def _read_codes(frame: _Definitions, body: bytes) -> None:
    while len(body) > _LONGEST:
        number, lengths = body[0], body[1 : 1 + _LONGEST]
        symbols = body[1 + _LONGEST : 1 + _LONGEST + sum(lengths)]
        frame.codes[number] = _lookup(lengths, symbols)
        body = body[1 + _LONGEST + sum(lengths) :]


def _lookup(lengths: bytes, symbols: bytes) -> np.ndarray:
    """For every 16 bits that may follow: length << 8 | symbol of the code that they begin with (65536,) uint16; 0: no such code."""
    table, code, next_symbol = np.zeros(1 << _LONGEST, np.uint16), 0, 0
    for length, count in enumerate(lengths, start=1):
        span = 1 << (_LONGEST - length)
        for symbol in symbols[next_symbol : next_symbol + count]:
            table[code * span : (code + 1) * span] = length << 8 | symbol
            code += 1
        next_symbol, code = next_symbol + count, code << 1
    return table


def _read_steps(frame: _Definitions, body: bytes) -> None:
    while len(body) > 64:
        wide, number = body[0] >> 4, body[0] & 15
        frame.steps[number] = int.from_bytes(body[1 : 3 if wide else 2], "big")
        body = body[129 if wide else 65 :]


def _broken_scan(frame: _Definitions, body: bytes, data: np.ndarray, start: int) -> Broken | None:
    used = [(body[1 + 2 * i], body[2 + 2 * i]) for i in range(body[0])] if body and len(body) > 2 * body[0] else []
    known = [(frame.components[name], tables) for name, tables in used if name in frame.components]
    codes = [frame.codes.get(number) for _, tables in known for number in (tables >> 4, 16 | (tables & 15))]
    if not known or any(table is None for table in codes):
        return None  # the decoder says so
    blocks = np.concatenate([np.full(_blocks(one, known), i) for i, (one, _) in enumerate(known)])
    limits = np.array([_largest_dc(frame.steps.get(table, 1)) for (_, _, table), _ in known])
    units = _units(frame, [one for one, _ in known])
    fault, unit = _follow(data, start, np.array(codes), blocks, limits, units, frame.restart)
    return Broken(Fault(fault), unit / units) if fault else None


def _blocks(component: tuple[int, int, int], known: list) -> int:
    """Blocks of a component in a unit: a scan of one component has one."""
    return component[0] * component[1] if len(known) > 1 else 1


def _units(frame: _Definitions, scanned: list[tuple[int, int, int]]) -> int:
    """Number of units (MCU) in a scan (T.81, A.2)."""
    most_h, most_v = (max(one[axis] for one in frame.components.values()) for axis in (0, 1))
    if len(scanned) > 1:
        return -(-frame.width // (8 * most_h)) * -(-frame.height // (8 * most_v))
    h, v, _ = scanned[0]
    cols, rows = -(-frame.width * h // most_h), -(-frame.height * v // most_v)
    return -(-cols // 8) * -(-rows // 8)


def _largest_dc(step: int) -> int:
    """Quantised DC coefficients of 8-bit samples are no larger: 1024 before it, with room for the rounding of encoders."""
    return (1024 + 32) // max(step, 1) + 2


@njit(nogil=True)
def _follow(data, start, codes, blocks, limits, units, restart):
    """Follows the codes of a scan. codes (2 components, 65536): DC and AC of each; blocks: component of each block of a unit.
    Returns the fault and the number of the unit in which it shows."""
    size = data.size
    bits, held, padded, at, ended = np.uint64(0), 0, 0, start, False
    grey = np.zeros(limits.size, np.int64)
    turn = 0
    for unit in range(units):
        if restart > 0 and unit > 0 and unit % restart == 0:
            if held - padded >= 8:
                return 5, unit
            if at + 1 >= size or data[at] != 0xFF or data[at + 1] != 0xD0 + turn:
                return 6, unit
            at, turn = at + 2, (turn + 1) % 8
            bits, held, padded, ended = np.uint64(0), 0, 0, False
            grey[:] = 0
        for component in blocks:
            k = 0
            while k < 64:
                while held <= 48:
                    byte = 0
                    if not ended and at < size:
                        byte = data[at]
                        if byte == 0xFF:
                            if at + 1 < size and data[at + 1] == 0:
                                at += 1
                            else:
                                ended = True
                    if ended or at >= size:
                        byte, padded = 0, padded + 8
                    else:
                        at += 1
                    bits = (bits << np.uint64(8)) | np.uint64(byte)
                    held += 8
                found = codes[2 * component + (1 if k else 0), (bits >> np.uint64(held - 16)) & np.uint64(0xFFFF)]
                if found == 0:
                    return (4, unit) if held - 16 < padded else (1, unit)
                held -= found >> 8
                run, extra = (found & 0xFF) >> 4, found & 15
                if k == 0:
                    if run > 0 or extra > 11:
                        return 1, unit
                    if extra:
                        held -= extra
                        value = np.int64((bits >> np.uint64(held)) & np.uint64((1 << extra) - 1))
                        if value < 1 << (extra - 1):
                            value -= (1 << extra) - 1
                        grey[component] += value
                        if abs(grey[component]) > limits[component]:
                            return 3, unit
                    k = 1
                elif extra == 0:
                    if run == 0:
                        k = 64
                    elif run == 15:
                        k += 16
                        if k > 63:
                            return 2, unit
                    else:
                        return 1, unit
                else:
                    if extra > 10:
                        return 1, unit
                    held -= extra
                    k += run + 1
                    if k > 64:
                        return 2, unit
                if held < padded:
                    return 4, unit
    if held - padded >= 8:
        return 5, units
    # A restart marker after the last interval is superfluous and harmless.
    if at + 1 < size and data[at] == 0xFF and 0xD0 <= data[at + 1] <= 0xD7:
        at += 2
    if at + 1 < size and data[at] != 0xFF:
        return 5, units
    return 0, units
