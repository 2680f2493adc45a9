"""Google's XML interface in front of fake-gcs-server, which reads and lists in it but takes uploads in the JSON one alone.

Conditions of an upload, generations and what wins are those of the emulator. Parts of a large object are held here until all are
there.

    fake-gcs-server -scheme http -host 127.0.0.1 -port 9024 -public-host 127.0.0.1:9024 -backend memory
    python tests/support/stores/google_uploads.py 9025 9024        # STORAGE_EMULATOR_HOST=127.0.0.1:9025
"""

import http.client
import json
import sys
import threading
import uuid
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, quote, unquote, urlsplit

JOINED = b"orthomill-upload"
KEPT = ("content-type", "etag", "last-modified", "x-goog-generation", "content-range", "accept-ranges")


class GoogleUploads(ThreadingHTTPServer):
    """Listens on `port` (0: a free one) and hands on to the emulator that listens on `emulator`."""

    daemon_threads = True
    request_queue_size = 128

    def __init__(self, port: int, emulator: int) -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.emulator = emulator
        self.parts: dict[str, dict[int, bytes]] = {}
        self.links = threading.local()

    def ask(self, method: str, path: str, body: bytes = b"", headers: dict[str, str] | None = None):
        """(status, headers, content) of the emulator's answer, once more over a new link where it has closed the old one."""
        for last in (False, True):
            link = getattr(self.links, "link", None) or http.client.HTTPConnection("127.0.0.1", self.emulator, timeout=60)
            self.links.link = link
            try:
                link.request(method, path, body, headers or {})
                answer = link.getresponse()
                return answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
            except (OSError, http.client.HTTPException):
                link.close()
                self.links.link = None
                if last:
                    raise
        raise AssertionError

    def upload(self, bucket: str, name: str, content: bytes, generation: str | None):
        """Write an object, if it has this generation (0: none yet)."""
        told = b"Content-Type: application/json\r\n\r\n" + json.dumps({"name": name}).encode()
        body = b"--%b\r\n%b\r\n--%b\r\nContent-Type: application/octet-stream\r\n\r\n%b\r\n--%b--\r\n"
        words = f"uploadType=multipart{'' if generation is None else f'&ifGenerationMatch={generation}'}"
        kind = {"Content-Type": f"multipart/related; boundary={JOINED.decode()}"}
        return self.ask("POST", f"/upload/storage/v1/b/{bucket}/o?{words}", body % (JOINED, told, JOINED, content, JOINED), kind)


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: GoogleUploads

    def log_message(self, format: str, *args: object) -> None:
        """Silent."""

    def setup(self) -> None:
        super().setup()
        self.wfile = self.connection.makefile("wb", buffering=2**16)

    def do_GET(self) -> None:
        """What is read, listed and removed goes through as it is."""
        headers = {"Range": self.headers["Range"]} if self.headers["Range"] else {}
        status, told, content = self.server.ask(self.command, self.path, headers=headers)
        if status == 500 and b"no bucket named" in content:  # as Google's own answer to a list has it
            status, content = 404, b"<Error><Code>NoSuchBucket</Code></Error>"
        self._answer(status, told, content)

    do_HEAD = do_DELETE = do_GET  # noqa: N815

    def do_PUT(self) -> None:
        """An object, or a part of one."""
        bucket, name, query = self._asked()
        content = self.rfile.read(int(self.headers["Content-Length"] or 0))
        if "uploadId" in query:
            self.server.parts[query["uploadId"]][int(query["partNumber"])] = content
            self._answer(200, {"etag": f'"{uuid.uuid4().hex}"'}, b"")
        else:
            self._uploaded(bucket, name, content, self.headers["x-goog-if-generation-match"])

    def do_POST(self) -> None:
        """The beginning and the end of an object in parts."""
        bucket, name, query = self._asked()
        self.rfile.read(int(self.headers["Content-Length"] or 0))
        if "uploadId" in query:
            parts = self.server.parts.pop(query["uploadId"])
            self._uploaded(bucket, name, b"".join(parts[number] for number in sorted(parts)), None)
        else:
            token = uuid.uuid4().hex
            self.server.parts[token] = {}
            tags = f"<Bucket>{bucket}</Bucket><Key>{quote(name)}</Key><UploadId>{token}</UploadId>"
            self._answer(200, {}, f"<InitiateMultipartUploadResult>{tags}</InitiateMultipartUploadResult>".encode())

    def _asked(self) -> tuple[str, str, dict[str, str]]:
        parts = urlsplit(self.path)
        bucket, _, name = parts.path[1:].partition("/")
        return bucket, unquote(name), {word: values[0] for word, values in parse_qs(parts.query, keep_blank_values=True).items()}

    def _uploaded(self, bucket: str, name: str, content: bytes, generation: str | None) -> None:
        status, _, answer = self.server.upload(bucket, name, content, generation)
        if status != 200:
            return self._answer(status, {}, answer)
        told = json.loads(answer)
        tag = f'<CompleteMultipartUploadResult><ETag>"{told["etag"]}"</ETag></CompleteMultipartUploadResult>'
        headers = {"etag": f'"{told["etag"]}"', "x-goog-generation": told["generation"]}
        self._answer(200, headers, tag.encode() if self.command == "POST" else b"")

    def _answer(self, status: int, headers: dict[str, str], content: bytes) -> None:
        self.send_response(status)
        for name in KEPT:
            if name in headers:
                self.send_header(name, headers[name])
        self.send_header("Content-Length", headers.get("content-length", "0") if self.command == "HEAD" else str(len(content)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)
        self.wfile.flush()


if __name__ == "__main__":
    GoogleUploads(int(sys.argv[1]), int(sys.argv[2])).serve_forever()
