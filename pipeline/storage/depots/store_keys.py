"""How an object store is reached: what the environment and the usual files of its own tools say, and nothing else.

Keys are never part of an address, an order, a record or a sentence.
"""

import configparser
import os
import re
from pathlib import Path
from typing import Any

_SECRET = re.compile(r"KEY|TOKEN|SECRET|PASSWORD|CREDENTIAL")
_OF_A_STORE = ("AWS_", "GOOGLE_", "AZURE_")
_SHORTEST = 8
"""characters of what is taken for a secret"""
_LONGEST = 200
"""characters that are shown of an error"""
_FILES = {
    "credentials": (
        "AWS_SHARED_CREDENTIALS_FILE",
        "~/.aws/credentials",
        ("aws_access_key_id", "aws_secret_access_key", "aws_session_token"),
    ),
    "config": ("AWS_CONFIG_FILE", "~/.aws/config", ("region", "endpoint_url")),
}
_NAMES = {"endpoint_url": "endpoint"}
_FIRST = {"region": ("AWS_REGION", "AWS_DEFAULT_REGION"), "endpoint": ("AWS_ENDPOINT_URL", "AWS_ENDPOINT")}
"""variables that come before the files"""


def options_of(scheme: str) -> dict[str, Any]:
    """What is told to obstore beside what it reads from the environment itself."""
    options: dict[str, Any] = _of_aws_files() if scheme == "s3" else {}
    endpoint = options.get("endpoint") or os.environ.get("AWS_ENDPOINT_URL_S3") or _endpoint()
    if scheme == "s3" and endpoint:
        options["endpoint"] = endpoint
        options.setdefault("region", os.environ.get("AWS_REGION") or os.environ.get("AWS_DEFAULT_REGION") or "us-east-1")
    plain = scheme == "s3" and endpoint.startswith("http://")
    return options | {"client_options": {"timeout": "120s", "connect_timeout": "10s", **({"allow_http": True} if plain else {})}}


def _endpoint() -> str:
    return os.environ.get("AWS_ENDPOINT_URL") or os.environ.get("AWS_ENDPOINT") or ""


def _of_aws_files() -> dict[str, Any]:
    """Keys, region and endpoint of the profile, as the tools of Amazon keep them; those of the environment come first."""
    profile = os.environ.get("AWS_PROFILE", "default")
    found: dict[str, Any] = {}
    for kind, (variable, usual, words) in _FILES.items():
        if kind == "credentials" and os.environ.get("AWS_ACCESS_KEY_ID"):
            continue
        reader = configparser.ConfigParser(interpolation=None)
        try:
            reader.read(Path(os.environ.get(variable, usual)).expanduser(), encoding="utf-8")
        except (configparser.Error, UnicodeDecodeError):
            continue
        section = profile if kind == "credentials" or profile == "default" else f"profile {profile}"
        if reader.has_section(section):
            found |= {_NAMES.get(word, word): reader[section][word] for word in words if word in reader[section]}
    for word, variables in {
        "region": ("AWS_REGION", "AWS_DEFAULT_REGION"),
        "endpoint": ("AWS_ENDPOINT_URL", "AWS_ENDPOINT"),
    }.items():
        if any(os.environ.get(variable) for variable in variables):
            found.pop(word, None)
    return found


def hidden(text: str) -> str:
    """The first line of an error, without whatever the environment or the files hold as a secret."""
    line = " ".join(text.strip().split("\n")[0].split())
    secrets = [value for name, value in os.environ.items() if name.startswith(_OF_A_STORE) and _SECRET.search(name)]
    secrets += [str(value) for word, value in _of_aws_files().items() if word.startswith("aws_")]
    for secret in secrets:
        if len(secret) >= _SHORTEST:
            line = line.replace(secret, "***")
    # What stands before an @ of an address may be a password.
    return re.sub(r"//[^/@\s]+@", "//***@", line)[:_LONGEST]
