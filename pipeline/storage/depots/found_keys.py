"""Whether anything gives keys for an object store, asked before its first request.

Without any the library asks the machines of the clouds for keys, and goes on asking for minutes where this is none of them.
"""

import http.client
import os
import re
from pathlib import Path
from typing import Any

from orthomill.schemas.errors import StoreError

_OF_A_STORE = {"s3": "AWS_", "gs": "GOOGLE_", "az": "AZURE_"}
_GIVES_KEYS = re.compile(r"KEY|TOKEN|SECRET|CREDENTIAL|SERVICE_ACCOUNT|SKIP_SIGNATURE|EMULATOR|AZURE_CLI|FEDERATED")
_OF_A_MACHINE = re.compile(r"^(IDENTITY_ENDPOINT|MSI_ENDPOINT|GCE_METADATA_\w+|AWS_METADATA_ENDPOINT|AZURE_MSI_ENDPOINT)$")
_OPTIONS = ("aws_access_key_id", "bearer_token", "account_key", "sas_key", "use_emulator")
_OF_GCLOUD = "gcloud/application_default_credentials.json"
_MACHINE = "169.254.169.254"
"""where machines of all three clouds answer what they are allowed to"""
_PATIENCE = 2.0
"""seconds in which they do"""
_NEEDED = {
    "s3": "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE of ~/.aws/credentials",
    "gs": "GOOGLE_APPLICATION_CREDENTIALS, the file with the key of a service account",
    "az": "AZURE_STORAGE_CONNECTION_STRING, or AZURE_STORAGE_ACCOUNT and AZURE_STORAGE_KEY",
}


def check_keys(address: str, scheme: str, options: dict[str, Any]) -> None:
    """`options`: what the environment and the files of the store's own tools say. Raises StoreError where nothing gives a key."""
    if not (_told(scheme, options) or _machine_answers()):
        raise StoreError(f"There are no keys for {address}; set {_NEEDED[scheme]} in the environment, then run again.")


def _told(scheme: str, options: dict[str, Any]) -> bool:
    begin = _OF_A_STORE[scheme]
    named = (name for name, value in os.environ.items() if value)
    if any(_OF_A_MACHINE.match(name) or (name.startswith(begin) and _GIVES_KEYS.search(name)) for name in named):
        return True
    folder = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
    return any(options.get(word) for word in _OPTIONS) or (scheme == "gs" and (folder / _OF_GCLOUD).is_file())


def _machine_answers() -> bool:
    """Whether this is a machine of a cloud. One that may not tell keys answers 403, as a network that lets nobody ask does."""
    link = http.client.HTTPConnection(_MACHINE, timeout=_PATIENCE)
    try:
        link.request("GET", "/", headers={"Metadata-Flavor": "Google", "Metadata": "true"})
        return link.getresponse().status != http.client.FORBIDDEN
    except (OSError, http.client.HTTPException):
        return False
    finally:
        link.close()
