"""Bytes of a text file to text: UTF-8 and UTF-16 by their marks, UTF-8 without one, and Windows' own letters where UTF-8 fails."""

import codecs
from typing import Literal

from orthomill.schemas.errors import StoreError

Encoding = Literal["UTF-8", "UTF-16", "Windows-1252"]
LARGEST = 200_000_000
"""bytes: longer than any list of photographs or points"""
_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
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
    text = _as_unicode(data)
    if text is None or "\0" in text or _controls(text) > _CONTROL_SHARE * len(text):
        raise StoreError(
            f"{where} holds NUL bytes or other data that are no text; save it as plain text in UTF-8 (Unicode of Windows needs its "
            "byte order mark)."
        )
    return text


def _as_unicode(data: bytes) -> SurveyText | None:
    try:
        if data.startswith(_UTF16):
            return SurveyText.of(data.decode("utf-16"), "UTF-16")
        return SurveyText.of(data.decode("utf-8-sig"), "UTF-8")
    except UnicodeDecodeError:
        # cp1252 leaves five bytes undefined; files that have them are in a code page that nothing tells.
        return None if data.startswith(_UTF16) else SurveyText.of(data.decode("cp1252", errors="replace"), "Windows-1252")


def _controls(text: str) -> int:
    return sum(1 for letter in text[:100_000] if letter < " " and letter not in "\t\r\n\f\v\x1a")
