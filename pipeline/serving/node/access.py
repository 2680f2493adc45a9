"""Who may use the node: tokens with their quotas, compared in constant time, and the cookie of the page.

NodeODM's clients send the token in the query of every call. The page of a browser gets a cookie instead, so that the token stays
out of the history: it is made from the token, is for this site only, and changes nothing without a header
that no other site can send.
"""

import hashlib
import hmac
import os
import secrets
from collections.abc import Mapping
from pathlib import Path

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from orthomill.schemas.errors import ResourceError, WorkflowError

COOKIE = "orthomill_page"
CHANGES = "x-orthomill-page"
"""header that the page sends with what changes anything"""
FILE = "token.txt"
"""in the folder of the node, where nobody gave tokens"""
VARIABLE = "ORTHOMILL_TOKEN"
_SHORTEST = 12


class Token(BaseModel):
    """A token with what its bearer may use."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(pattern=r"^[A-Za-z0-9._-]{1,64}$")
    token: str = Field(min_length=_SHORTEST, max_length=200, pattern=r"^[!-~]+$")
    tasks: int | None = Field(None, ge=1)
    """tasks that have not ended, at most"""
    gigabytes: float | None = Field(None, gt=0)
    """of uploads and results that are kept, at most"""
    photographs: int | None = Field(None, ge=2)
    """of a task, at most"""


class TokenFile(BaseModel):
    """The file of tokens."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    tokens: tuple[Token, ...] = Field(min_length=1)


class Access:
    """Knows the tokens."""

    def __init__(self, tokens: tuple[Token, ...]) -> None:
        self.tokens = tokens
        self._cookies = {
            token.name: hmac.new(token.token.encode(), b"orthomill page", hashlib.sha256).hexdigest() for token in tokens
        }

    def bearer(self, given: str) -> Token | None:
        """Whose token this is."""
        # All are compared: the time of an answer tells neither which one nor how much of one was right.
        found = [token for token in self.tokens if hmac.compare_digest(token.token.encode(), given.encode(errors="replace"))]
        return found[0] if found else None

    def visitor(self, cookie: str) -> Token | None:
        """Whose page has this cookie."""
        given = cookie.encode(errors="replace")
        found = [token for token in self.tokens if hmac.compare_digest(self._cookies[token.name].encode(), given)]
        return found[0] if found else None

    def cookie(self, token: Token) -> str:
        """What the page of a bearer has instead of the token."""
        return self._cookies[token.name]

    def ticket(self, token: Token, uuid: str) -> str:
        """What opens the pages of one task and nothing else: they run in a box without cookies."""
        return hmac.new(token.token.encode(), f"orthomill task {uuid}".encode(), hashlib.sha256).hexdigest()[:40]

    def named(self, name: str) -> Token | None:
        """The token of a name."""
        return next((token for token in self.tokens if token.name == name), None)


def tokens_given(file: Path | None, home: Path, environment: Mapping[str, str] = os.environ) -> tuple[tuple[Token, ...], str]:
    """The tokens of a node, and a sentence that says where they are from: a file, the environment, or one that is made and kept in
    the node's folder. Raises WorkflowError for a file that holds none."""
    if file is not None:
        return _read(file), f"The tokens are those of {file}."
    if given := environment.get(VARIABLE, ""):
        return (
            _token(given, f"The environment variable {VARIABLE}"),
        ), f"The token is that of the environment variable {VARIABLE}."
    kept = home / FILE
    if not kept.exists():
        home.mkdir(parents=True, exist_ok=True)
        try:
            with os.fdopen(os.open(kept, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as stream:
                stream.write(secrets.token_urlsafe(24) + "\n")
        except OSError as error:
            raise ResourceError(f"The token cannot be kept in {kept} ({error.strerror}); give one by {VARIABLE}.") from error
    token = _token(kept.read_text().strip(), str(kept))
    return (token,), f"token: {token.token}   (kept in {kept}, which only you can read)"


def _token(text: str, where: str) -> Token:
    try:
        return Token(name="user", token=text)
    except ValidationError as error:
        raise WorkflowError(
            f"{where} holds no token: it needs {_SHORTEST} to 200 letters, digits and signs without spaces."
        ) from error


def _read(file: Path) -> tuple[Token, ...]:
    try:
        found = TokenFile.model_validate(yaml.safe_load(file.read_text(encoding="utf-8")))
    except OSError as error:
        raise WorkflowError(f"The file of tokens {file} cannot be read: {error.strerror}.") from error
    except (ValidationError, yaml.YAMLError, UnicodeDecodeError) as error:
        first = error.errors()[0] if isinstance(error, ValidationError) else {"loc": (), "msg": "it is no YAML"}
        place = " > ".join(map(str, first["loc"]))
        raise WorkflowError(
            f"The file of tokens {file} is wrong ({place or 'all of it'}: {first['msg']}); it holds 'tokens:' "
            f"and lines such as '- {{name: ana, token: ..., tasks: 10, gigabytes: 200}}', each token of {_SHORTEST} signs or more."
        ) from None
    for what in ("name", "token"):
        values = [getattr(token, what) for token in found.tokens]
        if len(set(values)) < len(values):
            raise WorkflowError(f"The file of tokens {file} has a {what} twice; each must be its own.")
    return found.tokens
