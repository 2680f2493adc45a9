"""Bytes of a text file to text: UTF-8, UTF-16 and UTF-32 by their marks, UTF-8 and UTF-16 without one, and Windows' own letters
where UTF-8 fails."""

import codecs
from typing import Literal

from orthomill.schemas.errors import StoreError
from orthomill.schemas.survey_files.foreign_kinds import binary_kind

Encoding = Literal["UTF-8", "UTF-16", "UTF-32", "Windows-1252"]
LARGEST = 200_000_000
"""bytes: longer than any list of photographs or points"""
_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_UTF32 = (codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)
_LOOKED_AT, _ZERO_SHARE = 4096, 0.9
"""bytes that tell UTF-16 without a mark, and how many of every second one are zero in lists of Latin letters and numbers"""
# Text has tabs and ends of lines; a file with more than one other control character in a hundred is something else.
_CONTROL_SHARE = 0.01


class SurveyText(str):
    """The text of a file, which knows how its bytes were read."""

    encoding: Encoding = "UTF-8"

    @classmethod
    def of(cls, text: str, encoding: Encoding) -> "SurveyText":
        """The text with its encoding."""
        own = cls(text)
        own.encoding = encoding
        return own


def encoding_of(text: str) -> Encoding:
    """How the bytes of a text were read, as far as it is known."""
    return text.encoding if isinstance(text, SurveyText) else "UTF-8"


def decoded(data: bytes, where: str) -> SurveyText:
    """The text of a file without its byte order mark; `where` names the file. Raises StoreError for what is no text."""
    if kind := binary_kind(data):
        raise StoreError(f"{where} {kind}.")
    text = _as_unicode(data)
    if text is None or "\0" in text or _controls(text) > _CONTROL_SHARE * len(text):
        raise StoreError(
            f"{where} holds NUL bytes or other data that are no text; save it as plain text in UTF-8 (Unicode of Windows needs its "
            "byte order mark)."
        )
    return text


def _as_unicode(data: bytes) -> SurveyText | None:
    try:
        if data.startswith(_UTF32):
            return SurveyText.of(data.decode("utf-32"), "UTF-32")
        if data.startswith(_UTF16):
            return SurveyText.of(data.decode("utf-16"), "UTF-16")
        if unmarked := _unmarked(data[:_LOOKED_AT]):
            return SurveyText.of(data.decode(unmarked), "UTF-16")
        return SurveyText.of(data.decode("utf-8-sig"), "UTF-8")
    except UnicodeDecodeError:
        # cp1252 leaves five bytes undefined; files that have them are in a code page that nothing tells.
        return None if data.startswith(_UTF16) else SurveyText.of(data.decode("cp1252", errors="replace"), "Windows-1252")


def _unmarked(head: bytes) -> str | None:
    """The order of the bytes of UTF-16 without its mark: every second one of a list is zero; None for other texts."""
    zeros = [head[first::2].count(0) for first in (0, 1)]
    if not head or max(zeros) < _ZERO_SHARE * len(head) / 2 or min(zeros):
        return None
    return "utf-16-be" if zeros[0] else "utf-16-le"


def _controls(text: str) -> int:
    return sum(1 for letter in text[:100_000] if letter < " " and letter not in "\t\r\n\f\v\x1a")
