"""The signature under a run: `signature.json` in its folder, and whether products, figures and signature still belong together.

A signature proves that whoever has the key stated this about exactly these files. Whose key it is, no file can prove: its
fingerprint is compared with the one that the signer gives by other means.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from pydantic import BaseModel, ConfigDict, ValidationError

from orthomill.pipeline.signing.signing_key import fingerprint, public_bytes
from orthomill.pipeline.signing.statement import ACCEPTED, REPORT, SignedFile, Statement, digest_of, digest_of_blocks, signed_paths
from orthomill.pipeline.storage.depots.kept_products import KeptProducts
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.errors import StoreError

SIGNATURE = "signature.json"


class SignedStatement(BaseModel):
    """A statement with the signature under it; keys and signature in hexadecimal."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    statement: Statement
    public_key: str
    signature: str

    @property
    def fingerprint(self) -> str:
        """The short name of the key."""
        return fingerprint(bytes.fromhex(self.public_key))

    @property
    def is_genuine(self) -> bool:
        """Whether the key signed exactly this statement."""
        try:
            key = Ed25519PublicKey.from_public_bytes(bytes.fromhex(self.public_key))
            key.verify(bytes.fromhex(self.signature), self.statement.canonical())
        except (InvalidSignature, ValueError):
            return False
        return True


Page = Callable[[Path, SignedStatement], SignedFile]


@dataclass(frozen=True)
class SignatureCheck:
    """A signature beside the files of its run: paths that have changed, are missing, or were made after it."""

    signature: SignedStatement
    changed: tuple[str, ...]
    missing: tuple[str, ...]
    added: tuple[str, ...]
    inputs: tuple[str, ...] = ()
    """files that the results were made from, and that are not as they were"""

    @property
    def holds(self) -> bool:
        """Whether the statement is genuine and every file is as it was signed."""
        return self.signature.is_genuine and not (self.changed or self.missing or self.added or self.inputs)


def sign(statement: Statement, key: Ed25519PrivateKey) -> SignedStatement:
    """The statement, signed."""
    return SignedStatement(statement=statement, public_key=public_bytes(key).hex(), signature=key.sign(statement.canonical()).hex())


def keep(signature: SignedStatement, folder: Path) -> Path:
    """Write the signature to the folder of its run; returns the path. Raises StoreError."""
    write_whole(folder / SIGNATURE, signature.model_dump_json(indent=1).encode())
    return folder / SIGNATURE


def read_signature(folder: Path) -> SignedStatement | None:
    """The signature of a run; None without one. Raises StoreError where it cannot be understood."""
    path = folder / SIGNATURE
    if not path.exists():
        return None
    try:
        return SignedStatement.model_validate_json(path.read_bytes())
    except (OSError, ValidationError) as error:
        raise StoreError(f"{path} is damaged or of another version of orthomill; sign again with: orthomill sign.") from error


def check_signature(folder: Path, page: Page | None) -> SignatureCheck | None:
    """The signature of a run, runs/<project>, beside its files and those of its project as they are now; None without one.

    page: the digest of the report without what a signature adds to it; None: the report is not looked at. Raises StoreError.
    """
    signature = read_signature(folder)
    if signature is None:
        return None
    present, signed = set(signed_paths(folder)), signature.statement.files
    products = KeptProducts(folder)
    changed = tuple(path for path in sorted(present & set(signed)) if _has_changed(folder, products, path, signature, page))
    missing, added = sorted(set(signed) - present), sorted(present - set(signed) - {REPORT, *ACCEPTED})
    if page is None:
        missing = [path for path in missing if path != REPORT]
    root, given = folder.resolve().parent.parent, signature.statement.inputs
    inputs = tuple(path for path in sorted(given) if not (root / path).is_file() or digest_of(root / path) != given[path])
    return SignatureCheck(signature, changed, tuple(missing), tuple(added), inputs)


def _has_changed(folder: Path, products: KeptProducts, path: str, signature: SignedStatement, page: Page | None) -> bool:
    if path != REPORT:
        return digest_of_blocks(products.blocks(path)) != signature.statement.files[path]
    return page is not None and page(folder / path, signature) != signature.statement.files[path]
