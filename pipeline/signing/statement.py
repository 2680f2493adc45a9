"""What a person signs: who, when, the figures that were looked at, and digests of products, figures and workflow."""

import hashlib
import json
from collections.abc import Iterable, Iterator
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from orthomill.pipeline.storage.depots.folder import blocks_of
from orthomill.pipeline.storage.depots.kept_products import KeptProducts

FORMAT = 3
"""version of the statement; 1 said nothing of classes, 2 nothing of inputs"""
_SINCE = {"classes": 2, "inputs": 3}
"""fields that statements of earlier formats were signed without"""
OTHERS = ("summary.json", "workflow.yaml")
"""files of a run that are signed beside the products"""
REPORT = "report.html"
"""signed as it is without the signature that it shows"""
ACCEPTED = ("acceptance.json", "acceptance.html")
"""signed where they are there; a delivery may also be accepted after it was signed"""


class SignedFile(BaseModel):
    """A file as it was when it was signed."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    size: int
    """bytes"""
    sha256: str
    """hexadecimal"""


class Signer(BaseModel):
    """Who signs, in what capacity, and what is to be said about it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    role: str
    remarks: str = ""


class Statement(BaseModel):
    """What is signed."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: int = FORMAT
    project: str
    orthomill: str
    """version that made the results"""
    signer: Signer
    signed: str
    """ISO 8601, UTC"""
    verdict: str
    """first sentence of the report"""
    answers: dict[str, str]
    """figures that were looked at: the answers of the report's first page, by question"""
    warnings: tuple[str, ...]
    """what the report warned of, the gravest first"""
    classes: tuple[str, ...] = ()
    """accuracy class of every product and whether it keeps what the survey allows, from check points and from checks without
    reference, apart"""
    files: dict[str, SignedFile]
    """by path in the run's folder"""
    inputs: dict[str, SignedFile] = {}
    """control, positions and cameras that the results were made from, by path in the project's folder"""

    def canonical(self) -> bytes:
        """The bytes that are signed: the same for the same content, whatever writes it."""
        known = self.model_dump(exclude={name for name, since in _SINCE.items() if self.format < since})
        return json.dumps(known, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()


def signed_paths(folder: Path) -> Iterator[str]:
    """The files of a run that a signature covers, in order of name, relative to its folder."""
    others = (name for name in (*OTHERS, *ACCEPTED, REPORT) if (folder / name).is_file())
    yield from sorted((*KeptProducts(folder).names, *others))


def digest_of_bytes(content: bytes) -> SignedFile:
    """Size and digest of what a file holds."""
    return SignedFile(size=len(content), sha256=hashlib.sha256(content).hexdigest())


def digest_of(path: Path) -> SignedFile:
    """Size and digest of a file. Raises OSError."""
    return digest_of_blocks(blocks_of(path))


def digest_of_blocks(blocks: Iterable[bytes]) -> SignedFile:
    """Size and digest of content that comes in pieces."""
    found, size = hashlib.sha256(), 0
    for block in blocks:
        found.update(block)
        size += len(block)
    return SignedFile(size=size, sha256=found.hexdigest())
