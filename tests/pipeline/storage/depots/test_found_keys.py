"""A store for which nothing gives a key is named before its first request, which would be repeated for minutes."""

import os
import socket
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

pytest.importorskip("obstore")

from orthomill.pipeline.storage.depots import found_keys
from orthomill.pipeline.storage.depots.bucket import bucket_of
from orthomill.pipeline.storage.depots.found_keys import check_keys
from orthomill.pipeline.storage.depots.store_keys import options_of
from orthomill.schemas.errors import StoreError

BEGINS = ("AWS_", "GOOGLE_", "AZURE_", "GCE_", "IDENTITY_", "MSI_", "STORAGE_EMULATOR_HOST")
GIVEN = {
    "s3": {"AWS_ACCESS_KEY_ID": "keyofoffice"},
    "gs": {"GOOGLE_APPLICATION_CREDENTIALS": "/keys/account.json"},
    "az": {"AZURE_STORAGE_ACCOUNT": "office", "AZURE_STORAGE_KEY": "keyofoffice"},
}
ALSO = [
    ("s3", {"AWS_WEB_IDENTITY_TOKEN_FILE": "/keys/token"}),
    ("s3", {"AWS_CONTAINER_CREDENTIALS_FULL_URI": "http://127.0.0.1/keys"}),
    ("s3", {"AWS_SKIP_SIGNATURE": "true"}),
    ("gs", {"STORAGE_EMULATOR_HOST": "127.0.0.1:1"}),
    ("az", {"AZURE_STORAGE_CONNECTION_STRING": "AccountName=office;SharedAccessSignature=sv=1&sig=2"}),
    ("az", {"AZURE_FEDERATED_TOKEN_FILE": "/keys/token"}),
    ("az", {"IDENTITY_ENDPOINT": "http://127.0.0.1/keys"}),
]


@pytest.fixture
def nothing(tmp_path, monkeypatch):
    """An environment and a home without keys, on a machine of no cloud."""
    for name in [name for name in os.environ if name.startswith(BEGINS)]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.setattr(found_keys, "_machine_answers", lambda: False)
    bucket_of.cache_clear()
    return tmp_path


@pytest.mark.parametrize("scheme", GIVEN)
def test_keys_that_are_missing_are_named_with_their_variables(scheme, nothing, monkeypatch):
    with pytest.raises(StoreError, match=f"^There are no keys for {scheme}://trial/x; set {next(iter(GIVEN[scheme]))[:8]}"):
        bucket_of(f"{scheme}://trial/x")
    # Places and addresses are no keys.
    for name, value in {"AWS_REGION": "eu", "AWS_ENDPOINT_URL": "http://127.0.0.1:1", "AZURE_STORAGE_ACCOUNT": "office"}.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(StoreError, match="no keys"):
        bucket_of(f"{scheme}://trial/x")
    for name, value in GIVEN[scheme].items():
        monkeypatch.setenv(name, value)
    check_keys(f"{scheme}://trial/x", scheme, options_of(scheme))


@pytest.mark.parametrize(("scheme", "variables"), ALSO)
def test_other_ways_to_keys_are_known(scheme, variables, nothing, monkeypatch):
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    check_keys(f"{scheme}://trial/x", scheme, options_of(scheme))


def test_files_of_the_tools_are_known(nothing):
    (nothing / ".aws").mkdir()
    (nothing / ".aws/credentials").write_text("[default]\naws_access_key_id = key\naws_secret_access_key = secret\n")
    (nothing / ".config/gcloud").mkdir(parents=True)
    (nothing / ".config/gcloud/application_default_credentials.json").write_text("{}")
    for scheme in ("s3", "gs"):
        check_keys(f"{scheme}://trial/x", scheme, options_of(scheme))


@pytest.mark.parametrize(("status", "answers"), [(200, True), (401, True), (400, True), (403, False), (None, False)])
def test_machines_of_a_cloud_give_keys_themselves(status, answers, monkeypatch):
    class Metadata(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(status)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *words):
            """Silent."""

    with HTTPServer(("127.0.0.1", 0), Metadata) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        place = f"127.0.0.1:{server.server_address[1]}" if status else f"127.0.0.1:{free()}"
        monkeypatch.setattr(found_keys, "_MACHINE", place)
        assert found_keys._machine_answers() is answers
        server.shutdown()


def free():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]
