"""The key with which a person signs: Ed25519, in a file that nobody else can read."""

import hashlib
import os
from pathlib import Path

from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, PublicFormat, load_pem_private_key

from orthomill.schemas.errors import ResourceError


def default_key_path() -> Path:
    """Where a person's key is kept: in the folder for settings of programs."""
    return Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / "orthomill" / "signing_key.pem"


def new_key(path: Path) -> Ed25519PrivateKey:
    """A new key, written to a file that only its owner can read. Raises ResourceError."""
    key = Ed25519PrivateKey.generate()
    text = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        # Exclusively: an existing key is never replaced, and the file is private from its first moment.
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as stream:
            stream.write(text)
    except OSError as error:
        raise ResourceError(
            f"The signing key cannot be written to {path}: {error.strerror}; give another file with --key."
        ) from error
    return key


def read_key(path: Path, passphrase: str | None = None) -> Ed25519PrivateKey:
    """The key of a PEM file. Raises ResourceError where there is none, or where others may read it.

    Raises TypeError where the key is encrypted and no passphrase is given, so that it can be asked for.
    """
    try:
        text, mode = path.read_bytes(), path.stat().st_mode
    except OSError as error:
        raise ResourceError(f"The signing key {path} cannot be read: {error.strerror}.") from error
    if os.name == "posix" and mode & 0o077:
        raise ResourceError(f"The signing key {path} can be read by others; make it private with: chmod 600 {path}")
    try:
        key = load_pem_private_key(text, passphrase.encode() if passphrase else None)
    except (ValueError, UnsupportedAlgorithm) as error:
        raise ResourceError(f"{path} is no signing key (a private Ed25519 key as PEM), or the passphrase is wrong.") from error
    if not isinstance(key, Ed25519PrivateKey):
        raise ResourceError(f"{path} holds a key of another kind; signatures are made with Ed25519.")
    return key


def public_bytes(key: Ed25519PrivateKey | Ed25519PublicKey) -> bytes:
    """The 32 bytes of the public key."""
    public = key.public_key() if isinstance(key, Ed25519PrivateKey) else key
    return public.public_bytes(Encoding.Raw, PublicFormat.Raw)


def fingerprint(public: bytes) -> str:
    """A short name of a public key, to be compared over the telephone: 80 bits in groups of four hexadecimal digits."""
    digits = hashlib.sha256(public).hexdigest()[:20]
    return " ".join(digits[k : k + 4] for k in range(0, len(digits), 4))
