"""SeaweedFS: a real S3 server in one program, where `weed` is installed."""

import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tests.support.stores.server_ports import free_ports

WEED = shutil.which("weed")
KEY, SECRET = "keyofthetest01", "secretofthetest01"


class Server:
    """The program, with its data in a folder."""

    def __init__(self, folder: Path) -> None:
        master, volume, filer, s3 = free_ports(4)
        weed = str(WEED)
        self.s3, self.log = s3, folder / "log"
        self.shell = [weed, "shell", f"-master=127.0.0.1:{master}", f"-filer=127.0.0.1:{filer}"]
        may = ["Admin", "Read", "Write", "List"]
        identity = {"name": "t", "credentials": [{"accessKey": KEY, "secretKey": SECRET}], "actions": may}
        (folder / "s3.json").write_text(json.dumps({"identities": [identity]}))
        (folder / "data").mkdir()
        ports = [f"-master.port={master}", f"-volume.port={volume}", f"-filer.port={filer}", f"-s3.port={s3}"]
        self.words = [weed, f"-logdir={folder}", "server", f"-dir={folder / 'data'}", "-ip=127.0.0.1", "-ip.bind=127.0.0.1", "-s3"]
        self.words += [*ports, "-s3.port.iceberg=0", "-s3.port.lance=0", f"-s3.config={folder / 's3.json'}", "-volume.max=64"]
        self.words += ["-master.volumeSizeLimitMB=64", "-master.telemetry=false"]

    @property
    def environment(self) -> dict[str, str]:
        """The variables that a user would set for it."""
        keys = {"AWS_ACCESS_KEY_ID": KEY, "AWS_SECRET_ACCESS_KEY": SECRET, "AWS_REGION": "us-east-1"}
        return {**keys, "AWS_ENDPOINT_URL": f"http://127.0.0.1:{self.s3}"}

    def start(self) -> None:
        """Also again, after it was killed."""
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(self.words, stdout=log, stderr=log, start_new_session=True)

    def kill(self) -> None:
        """With -9."""
        self.process.kill()
        self.process.wait()

    def make_bucket(self) -> bool:
        """The bucket `trial`; whether the program came up and made it."""
        for _ in range(6):
            with suppress(subprocess.TimeoutExpired):
                asked = "s3.bucket.create -name trial\n"
                said = subprocess.run(self.shell, input=asked, capture_output=True, text=True, timeout=10)
                if "created bucket" in said.stdout + said.stderr:
                    return True
            time.sleep(1.0)
        return False


@contextmanager
def seaweed(folder: Path) -> Iterator[Server]:
    """The running program with its bucket. Raises RuntimeError with what it said where it does not start."""
    server = Server(folder)
    server.start()
    try:
        if not server.make_bucket():
            raise RuntimeError(f"SeaweedFS does not start here: {server.log.read_text()[-300:]}")
        yield server
    finally:
        server.kill()
