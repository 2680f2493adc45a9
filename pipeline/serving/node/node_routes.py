"""The routes of the NodeODM contract. Errors are sentences with HTTP 200, as its clients expect; 401 is a wrong token."""

import functools
from collections.abc import Awaitable, Callable
from typing import Any

import psutil
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

from orthomill import __version__
from orthomill.pipeline.serving.node.access import Token
from orthomill.pipeline.serving.node.node_service import NodeService
from orthomill.pipeline.serving.node.request_fields import fields_of, text_of, whole_number
from orthomill.pipeline.serving.node.streamed_uploads import MultipartReader
from orthomill.pipeline.serving.outputs.asset_files import asset_path, listed_assets, task_assets
from orthomill.pipeline.serving.queue.task_state import TaskStatus
from orthomill.schemas.errors import OrthomillError, ResourceError, WorkflowError

CONTRACT = "2.2.1"
"""version of NodeODM whose contract is kept: clients choose their way of uploading by it"""
MOST_LISTED = 1000
"""files that an answer lists besides those that everybody asks for"""
Answer = Callable[[Request], Awaitable[Response]]


def told(answer: Answer) -> Answer:
    """Errors that can be explained are answers."""

    @functools.wraps(answer)
    async def answered(request: Request) -> Response:
        try:
            return await answer(request)
        except OrthomillError as error:
            # Sending the same again helps nobody, unless the disk gets room meanwhile.
            again = {} if isinstance(error, ResourceError) else {"noRetry": True}
            return JSONResponse({"error": str(error)} | again)
        except OSError as error:
            return JSONResponse(
                {"error": f"The disk of this node refuses it ({error.strerror}); nothing is lost, try again later."}
            )

    return answered


def bearer(request: Request) -> Token:
    """Whose request it is; the guard has let it through."""
    token = request.state.token
    assert isinstance(token, Token)
    return token


class NodeRoutes:
    """The routes, and what they ask."""

    def __init__(self, service: NodeService) -> None:
        self._service = service

    def routes(self) -> list[Route]:
        """All of them. Fixed paths come before those with a task in them."""
        return [
            Route("/info", self._info),
            Route("/options", self._options),
            Route("/task/list", self._list),
            Route("/task/new", told(self._new), methods=["POST"]),
            Route("/task/new/init", told(self._init), methods=["POST"]),
            Route("/task/new/upload/{uuid}", told(self._upload), methods=["POST"]),
            Route("/task/new/commit/{uuid}", told(self._commit), methods=["POST"]),
            Route("/task/{uuid}/info", told(self._task_info)),
            Route("/task/{uuid}/output", told(self._task_output)),
            Route("/task/{uuid}/assets", told(self._assets)),
            Route("/task/{uuid}/download/{asset:path}", told(self._download)),
            Route("/task/{verb:str}", self._command, methods=["POST"]),
            Route("/auth/info", self._auth),
            Route("/auth/login", self._no_login, methods=["POST"]),
            Route("/auth/register", self._no_login, methods=["POST"]),
        ]

    async def _info(self, request: Request) -> Response:
        memory, queue = psutil.virtual_memory(), self._service.queue
        return JSONResponse(
            {
                "version": CONTRACT,
                "taskQueueCount": sum(not state.status.ended for state in queue.tasks.values()),
                "totalMemory": memory.total,
                "availableMemory": memory.available,
                "cpuCores": psutil.cpu_count() or 1,
                "maxImages": bearer(request).photographs,
                "maxParallelTasks": queue.rules.parallel,
                "engineVersion": __version__,
                "engine": "orthomill",
            }
        )

    async def _options(self, request: Request) -> Response:
        return JSONResponse([option.as_json() for option in self._service.options.listed])

    async def _list(self, request: Request) -> Response:
        return JSONResponse([{"uuid": state.uuid} for state in self._service.tasks(bearer(request))])

    async def _auth(self, request: Request) -> Response:
        message = "Tokens are given by whoever runs this node; there is nothing to register."
        return JSONResponse({"message": message, "loginUrl": None, "registerUrl": None})

    async def _no_login(self, request: Request) -> Response:
        return JSONResponse({"error": "Tokens are given by whoever runs this node; there is no login."})

    async def _init(self, request: Request) -> Response:
        fields = await fields_of(request)
        wanted = request.headers.get("set-uuid", "")
        state = await run_in_threadpool(self._service.begin, bearer(request), fields, wanted)
        return JSONResponse({"uuid": state.uuid})

    async def _upload(self, request: Request) -> Response:
        receive = await run_in_threadpool(self._service.receiver, bearer(request), request.path_params["uuid"])
        reader = MultipartReader(receive)
        await reader.read(request.headers.get("content-type", ""), request.stream())
        if not reader.files:
            raise WorkflowError("Need at least 1 file, in the field 'images'.")
        return JSONResponse({"success": True})

    async def _commit(self, request: Request) -> Response:
        uuid = await run_in_threadpool(self._service.commit, bearer(request), request.path_params["uuid"])
        return JSONResponse({"uuid": uuid})

    async def _new(self, request: Request) -> Response:
        """All in one request: fields may come after the files, so these are kept under a task that is not named yet."""
        token = bearer(request)
        wanted = request.headers.get("set-uuid", "")
        state = await run_in_threadpool(self._service.begin, token, {}, wanted)
        try:
            kind = request.headers.get("content-type", "")
            if kind.startswith("multipart/form-data"):
                reader = MultipartReader(self._service.receiver(token, state.uuid))
                await reader.read(kind, request.stream())
                fields: dict[str, Any] = dict(reader.fields)
            else:
                fields = await fields_of(request)
            await run_in_threadpool(self._service.describe, token, state.uuid, fields)
            return JSONResponse({"uuid": await run_in_threadpool(self._service.commit, token, state.uuid)})
        except BaseException:
            await run_in_threadpool(self._service.give_up, state.uuid)
            raise

    async def _task_info(self, request: Request) -> Response:
        state = self._service.task(bearer(request), request.path_params["uuid"])
        first = request.query_params.get("with_output")
        lines = None if first is None else whole_number(first, "with_output")
        return JSONResponse(await run_in_threadpool(self._service.told, state, lines))

    async def _task_output(self, request: Request) -> Response:
        state = self._service.task(bearer(request), request.path_params["uuid"])
        first = whole_number(request.query_params.get("line", "0"), "line")
        return JSONResponse(await run_in_threadpool(self._service.queue.of(state.uuid).lines, first))

    async def _assets(self, request: Request) -> Response:
        """What a task has to be downloaded, as ScaleODM answers."""
        state, query = self._service.task(bearer(request), request.path_params["uuid"]), request.query_params
        wanted = query.get("includeAdditional") == "true"
        most = min(max(whole_number(query.get("additionalLimit", "100"), "additionalLimit"), 1), MOST_LISTED) if wanted else 0
        folder = self._service.queue.of(state.uuid)
        places = await run_in_threadpool(lambda: [asset.place for asset in task_assets(folder.path)])
        there = ["all.zip", *places] if state.status == TaskStatus.COMPLETED else []
        return JSONResponse(listed_assets(state.uuid, there, most))

    async def _download(self, request: Request) -> Response:
        state = self._service.task(bearer(request), request.path_params["uuid"])
        if state.status != TaskStatus.COMPLETED:
            raise WorkflowError("Asset not ready: the task has not been completed.")
        name = request.path_params["asset"]
        path = await run_in_threadpool(asset_path, self._service.queue.of(state.uuid).path, name)
        if path is None:
            raise WorkflowError(f"Invalid asset: the task has no {name[:100]!r}; all.zip holds everything.")
        return FileResponse(path, filename=path.name)

    async def _command(self, request: Request) -> Response:
        """Cancel, remove and restart: their errors have `success` as well."""
        verb = request.path_params["verb"]
        does = {"cancel": self._service.cancel, "remove": self._service.remove, "restart": self._service.restart}
        if verb not in does:
            return JSONResponse({"error": f"There is no command {verb[:40]!r}."}, 404)
        try:
            fields = await fields_of(request)
            uuid = text_of(fields, "uuid", 40)
            if not uuid:
                return JSONResponse({"error": "uuid param missing."})
            await run_in_threadpool(does[verb], bearer(request), uuid, fields)
        except (OrthomillError, OSError) as error:
            return JSONResponse({"success": False, "error": str(error)})
        return JSONResponse({"success": True})
