"""The report as a signature covers it, and the signature as the report shows it.

Two parts are written into the page after it was signed: the signature, and an acceptance that came later. Both follow from files
beside the page, so that they are written again and taken out only where they are there word for word; whatever else was changed in
the page, in these parts too, stays and is found.
"""

from dataclasses import dataclass
from pathlib import Path

from orthomill.pipeline.report.accepted_part import ACCEPTANCE, read_acceptance
from orthomill.pipeline.report.page_template import page_template
from orthomill.pipeline.signing.signature import SignedStatement, check_signature
from orthomill.pipeline.signing.signature_lines import signature_lines
from orthomill.pipeline.signing.statement import SignedFile, Statement, digest_of_bytes
from orthomill.schemas.errors import StoreError


@dataclass(frozen=True)
class SignedPart:
    """The signature under the run, and what is to be said of it now."""

    statement: Statement
    fingerprint: str
    holds: bool
    lines: tuple[str, ...] = ()


def signed_part(folder: Path) -> SignedPart | None:
    """The signature of a run as the page shows it; None without one, and for one that cannot be read."""
    try:
        check = check_signature(folder, None)
    except StoreError:  # `orthomill verify` says what is wrong with it; the page is about the results
        return None
    if check is None:
        return None
    return SignedPart(check.signature.statement, check.signature.fingerprint, check.holds, tuple(signature_lines(check)))


def covered_page(page: Path, signature: SignedStatement) -> SignedFile:
    """Digest of a report without what was written into it after it was signed. Raises OSError."""
    text = page.read_bytes()
    for part in _later_parts(page.parent, signature):
        text = text.replace(part.encode(), b"", 1)
    return digest_of_bytes(text)


def _later_parts(folder: Path, signature: SignedStatement) -> tuple[str, ...]:
    parts = page_template("parts.html").module
    shown = parts.signature_part(SignedPart(signature.statement, signature.fingerprint, True))  # type: ignore[attr-defined]
    later = None if ACCEPTANCE in signature.statement.files else read_acceptance(folder)
    return (str(shown), *([str(parts.acceptance_part(later))] if later else []))  # type: ignore[attr-defined]
