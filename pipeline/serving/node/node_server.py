"""A node from its settings to a listening server."""

import ssl
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from orthomill.pipeline.records.lock import only_run
from orthomill.pipeline.serving.node.access import Access, tokens_given
from orthomill.pipeline.serving.queue.object_places import allowed_address
from orthomill.pipeline.serving.queue.task_queue import QueueRules, TaskQueue
from orthomill.pipeline.serving.queue.task_state import TaskStatus
from orthomill.pipeline.serving.queue.upload_store import UploadLimits, UploadStore
from orthomill.schemas.errors import ResourceError
from orthomill.schemas.stage_contract import Stage

EVERYBODY = frozenset({"0.0.0.0", "::"})  # noqa: S104
LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})


@dataclass(frozen=True)
class NodeSettings:
    """Where a node listens, and for whom."""

    home: Path
    host: str = "127.0.0.1"
    port: int = 3000
    tokens: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    webhooks: bool = True
    prefixes: tuple[str, ...] = ()
    """of object stores that tasks may read from and write to"""
    rules: QueueRules = field(default_factory=QueueRules)
    limits: UploadLimits = field(default_factory=UploadLimits)

    @property
    def address(self) -> str:
        """Where a browser of this machine finds it."""
        host = "127.0.0.1" if self.host in EVERYBODY else self.host
        return f"{'https' if self.certificate else 'http'}://{f'[{host}]' if ':' in host else host}:{self.port}/"


def serve(settings: NodeSettings, catalogue: tuple[type[Stage], ...], say: Callable[[str], None]) -> None:
    """Serve until the process is asked to stop. Raises ResourceError for a folder in use, a port that is taken, certificates that
    do not work, and without the libraries of the extra `serve`."""
    try:
        import uvicorn
    except ImportError:
        raise ResourceError("The node needs the libraries of its extra: pip install 'orthomill[serve]'.") from None
    from orthomill.pipeline.serving.node.node_application import node_application
    from orthomill.pipeline.serving.node.node_pages import NodePages

    _check_certificates(settings)
    tokens, where = tokens_given(settings.tokens, settings.home)
    with only_run(settings.home):
        service = node_service(settings, Access(tokens), catalogue)

        def tidy() -> None:
            service.queue.tidy()
            service.uploads.tidy(settings.rules.upload_days)

        application = node_application(service, NodePages(service).routes(), tidy)
        # No log of requests: every one of them has the token in its address.
        config = uvicorn.Config(
            application,
            host=settings.host,
            port=settings.port,
            log_level="warning",
            access_log=False,
            server_header=False,
            proxy_headers=False,
            timeout_graceful_shutdown=5,
            ssl_certfile=str(settings.certificate) if settings.certificate else None,
            ssl_keyfile=str(settings.key) if settings.key else None,
        )
        say(f"orthomill node: {settings.address}")
        say(where)
        if settings.host not in LOOPBACK and not settings.certificate:
            say(
                "Tokens and photographs travel unencrypted: give --certificate and --key, or put a server with TLS in front, "
                "unless this network is yours alone."
            )
        try:
            # Ctrl-C is the way out, and loses nothing.
            with suppress(KeyboardInterrupt):
                uvicorn.Server(config).run()
        except SystemExit:
            raise ResourceError(
                f"The node cannot listen on {settings.host}, port {settings.port}: it is taken; choose another."
            ) from None
        if running := sum(state.status == TaskStatus.RUNNING for state in service.queue.tasks.values()):
            words = "task goes" if running == 1 else "tasks go"
            say(f"{running} {words} on without the node; start it again to see or to cancel what runs.")


def node_service(settings: NodeSettings, access: Access, catalogue: tuple[type[Stage], ...]):
    """The node without its web server: queue, uploads, options and webhooks together."""
    from orthomill.pipeline.serving.node.node_service import NodeService
    from orthomill.pipeline.serving.node.task_options import TaskOptions
    from orthomill.pipeline.serving.node.webhooks import Webhooks

    queue = TaskQueue(settings.home, settings.rules)
    service = NodeService(queue, UploadStore(settings.home, settings.limits), access, TaskOptions(catalogue), settings.webhooks)
    service.object_store = lambda address: allowed_address(address, settings.prefixes)
    queue.notify = Webhooks(service.told, queue.told).notify
    return service


def _check_certificates(settings: NodeSettings) -> None:
    if (settings.certificate is None) != (settings.key is None):
        raise ResourceError("--certificate and --key are given together, both as PEM files.")
    if settings.certificate is None or settings.key is None:
        return
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(settings.certificate, settings.key)
    except OSError as error:
        raise ResourceError(
            f"{settings.certificate} and {settings.key} do not fit together ({error.strerror or error}); both are PEM files, and "
            "the key belongs to the certificate."
        ) from error
