"""The addresses of NodeODM's interface, and who is answered at them.

Errors of a request are answered with 200 and ``{"error": …}``, as NodeODM does it and its clients expect it; a token
that is missing or wrong with 401.
"""

import secrets
from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

from photogram.errors import PhotogramError
from photogram.node.forms import received_form, small_body
from photogram.node.node import Node
from photogram.node.options import option_views
from photogram.node.refusals import RequestError
from photogram.node.tasks import Task
from photogram.node.uploads import new_task
from photogram.wording import printable

SUCCESS: Mapping[str, object] = {"success": True}

Handler = Callable[[Request], Awaitable[Any]]
"""Returns what is answered as JSON, or a response."""


class Addresses:
    """The addresses of a node; ``token`` is what a request must name, empty where none must."""

    def __init__(self, node: Node, token: str) -> None:
        self._node, self._token = node, token

    def routes(self) -> list[Route]:
        """Return all addresses."""
        return [
            self._route("GET", "/info", self._info),
            self._route("GET", "/options", self._options),
            self._route("GET", "/auth/info", self._auth, is_open=True),
            self._route("GET", "/task/list", self._list),
            self._route("POST", "/task/new", self._new),
            self._route("POST", "/task/new/init", self._init),
            self._route("POST", "/task/new/upload/{uuid}", self._upload),
            self._route("POST", "/task/new/commit/{uuid}", self._commit),
            self._route("POST", "/task/cancel", partial(self._act, self._node.cancel)),
            self._route("POST", "/task/remove", partial(self._act, self._node.remove)),
            self._route("POST", "/task/restart", self._restart),
            self._route("GET", "/task/{uuid}/info", self._task),
            self._route("GET", "/task/{uuid}/output", self._output),
            self._route("GET", "/task/{uuid}/download/{asset:path}", self._download),
        ]

    def _route(self, method: str, address: str, handler: Handler, *, is_open: bool = False) -> Route:
        async def answer(request: Request) -> Response:
            if not (is_open or self._is_known(request)):
                return JSONResponse({"error": "Invalid authentication token: name the token of this node"}, 401)
            try:
                outcome = await handler(request)
            except PhotogramError as error:
                return JSONResponse({"error": printable(str(error))})
            except OSError as error:
                return JSONResponse({"error": printable(f"this node cannot do it: {error.strerror or error}")})
            return outcome if isinstance(outcome, Response) else JSONResponse(outcome)

        return Route(address, answer, methods=[method])

    def _is_known(self, request: Request) -> bool:
        given = request.query_params.get("token", "")
        return not self._token or secrets.compare_digest(given.encode(), self._token.encode())

    # ---- the node --------------------------------------------------------------------------------------------------

    async def _info(self, _: Request) -> object:
        return await run_in_threadpool(self._node.info)

    async def _options(self, _: Request) -> object:
        return option_views()

    async def _auth(self, _: Request) -> object:
        needed = "This node needs its token." if self._token else "This node needs no token."
        return {"message": needed, "loginUrl": None, "registerUrl": None}

    async def _list(self, _: Request) -> object:
        return [{"uuid": name} for name in await run_in_threadpool(self._node.uuids)]

    # ---- new tasks -------------------------------------------------------------------------------------------------

    async def _new(self, request: Request) -> object:
        """Take a task whole. Its fields may come behind its files, so that it is begun without them."""
        draft = new_task({}, request.headers.get("set-uuid", ""))
        await run_in_threadpool(self._node.begin, draft)
        try:
            await self._received(request, draft)
            await run_in_threadpool(self._node.commit, draft.uuid)
        except BaseException:
            await run_in_threadpool(self._node.uploads.remove, draft.uuid)
            raise
        return {"uuid": draft.uuid}

    async def _received(self, request: Request, draft: Task) -> None:
        uploads = self._node.uploads
        with uploads.incoming(draft.uuid) as folder:
            form = await received_form(request, folder, await run_in_threadpool(uploads.room, draft.uuid))
            task = new_task(form.fields, draft.uuid)
            await run_in_threadpool(uploads.describe, task)
            await run_in_threadpool(uploads.keep, draft.uuid, form.files)

    async def _init(self, request: Request) -> object:
        fields = await self._fields(request)
        task = new_task(fields, request.headers.get("set-uuid", ""))
        await run_in_threadpool(self._node.begin, task)
        return {"uuid": task.uuid}

    async def _fields(self, request: Request) -> dict[str, str]:
        """Return the fields of a form without files."""
        with self._node.uploads.scratch() as folder:
            form = await received_form(request, folder, await run_in_threadpool(self._node.uploads.room))
        if form.files:
            raise RequestError("files are sent to /task/new/upload once the task is begun")
        return form.fields

    async def _upload(self, request: Request) -> object:
        name, uploads = request.path_params["uuid"], self._node.uploads
        with uploads.incoming(name) as folder:
            form = await received_form(request, folder, await run_in_threadpool(uploads.room, name))
            await run_in_threadpool(uploads.keep, name, form.files)
        return SUCCESS

    async def _commit(self, request: Request) -> object:
        name = request.path_params["uuid"]
        await run_in_threadpool(self._node.commit, name)
        return {"uuid": name}

    # ---- tasks -----------------------------------------------------------------------------------------------------

    async def _act(self, act: Callable[[str], None], request: Request) -> object:
        body = await small_body(request)
        await run_in_threadpool(act, body.get("uuid", ""))
        return SUCCESS

    async def _restart(self, request: Request) -> object:
        body = await small_body(request)
        await run_in_threadpool(self._node.restart, body.get("uuid", ""), body.get("options"))
        return SUCCESS

    async def _task(self, request: Request) -> object:
        asked = request.query_params.get("with_output")
        first = None if asked is None else _line(asked)
        return await run_in_threadpool(self._node.task, request.path_params["uuid"], first)

    async def _output(self, request: Request) -> object:
        first = _line(request.query_params.get("line", "0"))
        return await run_in_threadpool(self._node.output, request.path_params["uuid"], first)

    async def _download(self, request: Request) -> object:
        name, asset = request.path_params["uuid"], request.path_params["asset"]
        path = await run_in_threadpool(self._node.asset, name, asset)
        return FileResponse(path, filename=path.name)


def _line(text: str) -> int:
    try:
        return int(text)
    except ValueError as error:
        raise RequestError("the number of a line is expected") from error
