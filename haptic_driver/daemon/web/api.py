"""The daemon's API: HTTP and JSON for commands and views, WebSockets for what changes and for many
commands a second; `server.py` serves it.

Every refusal is answered with `{"error": {"code", "message", "hint"}}`. 422 is for unusable input,
409 for what the daemon's present state forbids, 403 for another's lease.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import suppress
from importlib.metadata import version
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any

from anyio import CapacityLimiter, create_task_group, to_thread
from fastapi import (
    APIRouter,
    FastAPI,
    Header,
    Query,
    Request,
    Response,
    WebSocket,
    WebSocketDisconnect,
)
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, RedirectResponse
from fastapi.staticfiles import StaticFiles
from starlette.exceptions import HTTPException

from haptic_driver.config import Checked, foremost
from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.messages import LEASE_HEADER, ErrorReport
from haptic_driver.daemon.verbs import Empty, Leased, Since, Verb, all_verbs
from haptic_driver.daemon.web.commands import CommandChannel
from haptic_driver.daemon.web.frames import state_frame
from haptic_driver.daemon.web.off import OFF_VERBS, OffThreads
from haptic_driver.daemon.web.security import BodyLimit, refusal, status_of
from haptic_driver.errors import BadInputError, HapticError
from model.support.errors import nearest

FRAME_PERIOD_S = 0.05
PERIODS_S = (0.02, 1.0)
FRAME_SAMPLES = 1000
# for all streams together: what switches off shares the interpreter with no more of them
FRAME_THREADS = 2
EVENT_PERIOD_S = 0.05
PAGE = "/page"
BEYOND = {"finite_number", "greater_than", "greater_than_equal", "less_than", "less_than_equal"}

SEND_JSON = "send a JSON object, and the header Content-Type: application/json"
LeaseToken = Annotated[str, Header(alias=LEASE_HEADER, description="The token that `/arm` gave.")]
SAID = {
    400: "not JSON",
    403: "another's lease",
    408: "came too slowly",
    409: "not in this state",
    413: "too large",
    422: "not usable as given",
}


def create_app(daemon: Daemon, page: Path | None = None, off: OffThreads | None = None) -> FastAPI:
    """The API in front of `daemon`.

    `page`: a folder of static files to serve below `/page`, with an index.html. `off` does what
    streams say of switching off.
    """
    app = FastAPI(
        title="haptic-driver",
        summary="Friction under a finger: arm, ask for friction, switch off.",
        version=version("haptic-driver"),
        docs_url=None,  # their pages load scripts from elsewhere
        redoc_url=None,
        responses={
            status: {"model": ErrorReport, "description": what} for status, what in SAID.items()
        },
    )
    for name, verb in all_verbs().items():
        app.add_api_route(
            verb.path,
            _route(daemon, verb),
            methods=[verb.method],
            response_model=verb.answer,
            name=name,
            description=verb.said,
            tags=["commands" if verb.method == "POST" else "views"],
        )
    app.include_router(_streams(daemon, off))
    if page is not None:
        app.mount(PAGE, StaticFiles(directory=page, html=True))
        app.add_api_route("/", lambda: RedirectResponse(PAGE + "/"), include_in_schema=False)
    app.add_middleware(BodyLimit)
    _answer_errors(app)
    return app


def _route(daemon: Daemon, verb: Verb[..., Any, Any]) -> Callable[..., Awaitable[Response]]:
    """What answers one verb, with the parameters that FastAPI reads and describes; the answer is
    JSON already.
    """

    async def answer(asked: Checked | None = None, lease_token: str = "") -> Response:
        said = await to_thread.run_sync(verb.said_json, daemon, asked, lease_token)
        return Response(said, media_type="application/json")

    parameters = []
    if verb.asked is not Empty:
        asked = verb.schema if verb.method == "POST" else Annotated[verb.schema, Query()]
        parameters.append(Parameter("asked", Parameter.KEYWORD_ONLY, annotation=asked))
    if isinstance(verb, Leased):
        parameters.append(
            Parameter("lease_token", Parameter.KEYWORD_ONLY, default="", annotation=LeaseToken)
        )
    answer.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    return answer


def _streams(daemon: Daemon, off: OffThreads | None) -> APIRouter:
    router = APIRouter()
    frame_threads = CapacityLimiter(FRAME_THREADS)

    async def hear(said: str) -> None:
        if off is not None and said in OFF_VERBS:
            await asyncio.wrap_future(off.ask(OFF_VERBS[said]))  # the state says what came of it

    @router.websocket("/state")
    async def state(
        socket: WebSocket,
        period_s: Annotated[float, Query(ge=PERIODS_S[0], le=PERIODS_S[1])] = FRAME_PERIOD_S,
        column: Annotated[list[str], Query()] = [],  # noqa: B006 - FastAPI copies it
    ) -> None:
        """A `StateFrame` every `period_s`, or as fast as the client takes them; always the newest.

        The texts `off` and `disarm` are heard, here and at `/events`.
        """
        newest_tick = 0

        def next_frame() -> str:
            nonlocal newest_tick
            samples = daemon.samples(newest_tick, FRAME_SAMPLES)
            if samples.size:
                newest_tick = int(samples["tick"][-1])
            return state_frame(daemon.status(), samples, column).model_dump_json()

        async def send_frames() -> None:
            while True:
                await socket.send_text(await to_thread.run_sync(next_frame, limiter=frame_threads))
                await asyncio.sleep(period_s)

        await socket.accept()
        await _until_gone(socket, send_frames(), hear)

    @router.websocket("/events")
    async def events(socket: WebSocket, since: Since = 0) -> None:
        """Every `Event` after number `since`, one message each."""

        async def send_events() -> None:
            newest = since
            while True:
                for event in daemon.events(newest):
                    await socket.send_text(event.model_dump_json())
                    newest = event.number
                await asyncio.sleep(EVENT_PERIOD_S)

        await socket.accept()
        await _until_gone(socket, send_events(), hear)

    @router.websocket("/commands")
    async def commands(socket: WebSocket) -> None:
        """See `CommandChannel`."""
        assert off is not None
        channel = CommandChannel(daemon, off, socket.send_text)

        async def serve() -> None:
            async with create_task_group() as tasks:
                tasks.start_soon(channel.work)
                tasks.start_soon(channel.keep)

        await socket.accept()
        try:
            await _until_gone(socket, serve(), channel.hear)
        finally:
            await channel.close()

    return router


async def _until_gone(
    socket: WebSocket, sending: Coroutine[Any, Any, None], hear: Callable[[str], Awaitable[None]]
) -> None:
    """Send, and hear what the client says, until it closes."""
    async with create_task_group() as tasks:

        async def send() -> None:
            with suppress(WebSocketDisconnect):
                await sending

        tasks.start_soon(send)
        while (message := await socket.receive())["type"] != "websocket.disconnect":
            await hear(message.get("text") or "")
        tasks.cancel_scope.cancel()


def _answer_errors(app: FastAPI) -> None:
    # The description is made when it is asked for.
    paths = sorted({verb.path for verb in all_verbs().values()})

    @app.exception_handler(HapticError)
    async def refused(request: Request, error: HapticError) -> JSONResponse:
        return refusal(status_of(error), error)

    @app.exception_handler(RequestValidationError)
    async def invalid(request: Request, error: RequestValidationError) -> JSONResponse:
        # without "body" or "query"
        faults = [{**fault, "loc": fault["loc"][1:]} for fault in error.errors()]
        if faults[0]["type"] == "json_invalid" or not faults[0]["loc"]:
            return refusal(422, BadInputError("bad_request", "no JSON object was sent", SEND_JSON))
        asked = request.method, request.url.path
        known: dict[tuple[str, str], type] = {
            (verb.method, verb.path): verb.schema for verb in all_verbs().values()
        }
        first, said, hint = foremost(faults, known.get(asked))
        code = "out_of_range" if first["type"] in BEYOND else "bad_request"
        return refusal(422, BadInputError(code, said, hint))

    @app.exception_handler(HTTPException)
    async def not_routed(request: Request, error: HTTPException) -> JSONResponse:
        path = request.url.path
        hint = nearest(path, paths) if error.status_code == 404 else "see /openapi.json"
        code = {404: "not_found", 405: "method_not_allowed"}.get(error.status_code, "bad_request")
        response = refusal(
            error.status_code, HapticError(code, f"{request.method} {path}: {error.detail}", hint)
        )
        response.headers.update(error.headers or {})
        return response

    @app.exception_handler(Exception)
    async def failed(request: Request, error: Exception) -> JSONResponse:
        return refusal(
            500,
            HapticError("internal", f"{type(error).__name__}: {error}", "a fault of the program"),
        )
