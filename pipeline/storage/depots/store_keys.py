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
_AZURE = {"account_name": "AZURE_STORAGE_ACCOUNT", "account_key": "AZURE_STORAGE_KEY"}
_CONNECTION = {
    "AccountName": "account_name",
    "AccountKey": "account_key",
    "SharedAccessSignature": "sas_key",
    "BlobEndpoint": "endpoint",
}


def options_of(scheme: str) -> dict[str, Any]:
    """What is told to obstore beside what it reads from the environment itself."""
    options = {"s3": _of_amazon, "gs": _of_google, "az": _of_azure}[scheme]()
    plain = str(options.get("endpoint") or options.get("base_url") or "").startswith("http://")
    return options | {"client_options": {"timeout": "120s", "connect_timeout": "10s", **({"allow_http": True} if plain else {})}}


def _variable(*names: str) -> str:
    """The first of these variables that is set, or nothing."""
    return next((found for name in names if (found := os.environ.get(name))), "")


def _of_amazon() -> dict[str, Any]:
    options = _of_aws_files()
    endpoint = options.get("endpoint") or _variable("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AWS_ENDPOINT")
    if endpoint:
        options["endpoint"] = endpoint
        options.setdefault("region", _variable("AWS_REGION", "AWS_DEFAULT_REGION") or "us-east-1")
    return options


def _of_google() -> dict[str, Any]:
    """The address of another server. An emulator asks for no key, and none is looked for, as by Google's own tools."""
    emulator = _variable("STORAGE_EMULATOR_HOST").rstrip("/")
    if emulator:
        return {"base_url": emulator if "://" in emulator else f"http://{emulator}", "bearer_token": "none"}
    return {"base_url": base} if (base := _variable("GOOGLE_BASE_URL")) else {}


def _of_azure() -> dict[str, Any]:
    """What the variables of Azure's own command say (AZURE_STORAGE_CONNECTION_STRING, _ACCOUNT, _KEY) and obstore does not read."""
    if not _variable("AZURE_STORAGE_ACCOUNT_NAME", "AZURE_STORAGE_USE_EMULATOR"):
        found = _of_connection(_variable("AZURE_STORAGE_CONNECTION_STRING"))
        found = found or {word: os.environ[name] for word, name in _AZURE.items() if os.environ.get(name)}
    else:
        found = {}
    endpoint = found.get("endpoint") or _variable("AZURE_STORAGE_ENDPOINT", "AZURE_ENDPOINT", "AZURE_STORAGE_SERVICE_ENDPOINT")
    return found | ({"endpoint": endpoint} if endpoint else {})


def _of_connection(text: str) -> dict[str, Any]:
    """The parts of a connection string of Azure, as its portal shows it."""
    parts = dict(part.strip().split("=", 1) for part in text.split(";") if "=" in part)
    if parts.get("UseDevelopmentStorage", "").lower() == "true":
        return {"use_emulator": True}
    found: dict[str, Any] = {word: parts[name] for name, word in _CONNECTION.items() if parts.get(name)}
    if "EndpointSuffix" in parts and "AccountName" in parts and "endpoint" not in found:
        scheme = parts.get("DefaultEndpointsProtocol", "https")
        found["endpoint"] = f"{scheme}://{parts['AccountName']}.blob.{parts['EndpointSuffix']}"
    return found


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
    secrets += [str(value) for word, value in _of_azure().items() if word in ("account_key", "sas_key")]
    for secret in secrets:
        if len(secret) >= _SHORTEST:
            line = line.replace(secret, "***")
    # What stands before an @ of an address may be a password; a signed address of Azure carries its signature.
    return re.sub(r"\bsig=[^&\s]+", "sig=***", re.sub(r"//[^/@\s]+@", "//***@", line))[:_LONGEST]
