"""The daemon's API: HTTP and JSON for commands and views, two WebSockets for what changes; `server.py` serves it.

Whatever is refused is answered with `{"error": {"code", "message", "hint"}}`: 422 for what cannot be used as given, 409
for what the daemon cannot do in its present state, 403 for another's lease.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

from anyio import CapacityLimiter, create_task_group, to_thread
from fastapi import APIRouter, FastAPI, Header, Query, Request, WebSocket, WebSocketDisconnect
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, RedirectResponse
from fastapi.staticfiles import StaticFiles
from starlette.exceptions import HTTPException

from haptic_driver.daemon.messages import ArmRequest, Control, Lease, ModelChoice, Status, Target, TextureChoice
from haptic_driver.daemon.web.frames import sample_columns, state_frame
from haptic_driver.daemon.web.records import (
    LEASE_HEADER,
    ErrorReport,
    Events,
    RecordingRequest,
    SampleColumns,
    SurfaceMap,
    TextureMap,
    TextureNames,
)
from haptic_driver.daemon.web.security import BodyLimit, refusal
from haptic_driver.errors import BadInputError, HapticError
from model.support.errors import nearest

FRAME_PERIOD_S = 0.05
FRAME_SAMPLES = 1000
EVENT_PERIOD_S = 0.05
MOST_SAMPLES = 2000  # what turns into JSON in a few milliseconds, of which the set-point pump loses as many
MOST_COUNT = 2**62
OFF_THREADS = 8  # for switching off alone: it never waits for a thread that another request holds
PAGE = "/page"

LeaseToken = Annotated[str, Header(alias=LEASE_HEADER, description="The token that `/arm` gave.")]
Since = Annotated[int, Query(ge=0, le=MOST_COUNT, description="Only what comes after this number.")]
SAID = {400: "not JSON", 403: "another's lease", 409: "not in this state", 413: "too large", 422: "not usable as given"}


def create_app(control: Control, page: Path | None = None) -> FastAPI:
    """The API in front of `control`; `page`: a folder of static files to serve below `/page`, with an index.html."""
    app = FastAPI(
        title="haptic-driver",
        summary="Friction under a finger: arm, ask for friction, switch off.",
        version=version("haptic-driver"),
        docs_url=None,  # their pages load scripts from elsewhere
        redoc_url=None,
        responses={status: {"model": ErrorReport, "description": what} for status, what in SAID.items()},
    )
    for router in (_commands(control), _views(control), _streams(control)):
        app.include_router(router)
    if page is not None:
        app.mount(PAGE, StaticFiles(directory=page, html=True))
        app.add_api_route("/", lambda: RedirectResponse(PAGE + "/"), include_in_schema=False)
    app.add_middleware(BodyLimit)
    _answer_errors(app)
    return app


def _commands(control: Control) -> APIRouter:
    router = APIRouter(tags=["commands"])
    off_threads = CapacityLimiter(OFF_THREADS)

    @router.post("/arm")
    def arm(request: ArmRequest) -> Lease:
        """Idle to armed. The lease is to be renewed within `lease_s`, or the output ramps to zero."""
        return control.arm(request.lease_s)

    @router.post("/renew")
    def renew(lease_token: LeaseToken = "") -> Lease:
        """Keep the lease alive."""
        return control.renew(lease_token)

    @router.post("/set")
    def set_target(target: Target, lease_token: LeaseToken = "") -> Status:
        """Ask for one friction everywhere; armed to rendering. Renews the lease."""
        return control.set_target(lease_token, target.cof)

    @router.post("/texture")
    def play(choice: TextureChoice, lease_token: LeaseToken = "") -> Status:
        """Ask for a texture; armed to rendering. Renews the lease."""
        return control.play(lease_token, choice.name)

    @router.post("/off")
    async def off() -> Status:
        """Output to zero at once, from anyone, in any state; rendering to armed."""
        return await to_thread.run_sync(control.off, limiter=off_threads)

    @router.post("/disarm")
    async def disarm() -> Status:
        """Off, and the lease ends; from anyone."""
        return await to_thread.run_sync(control.disarm, limiter=off_threads)

    @router.post("/reset")
    def reset() -> Status:
        """Acknowledge a fault or trip whose cause is gone; fault to idle."""
        return control.reset()

    @router.post("/model")
    def use_model(choice: ModelChoice) -> Status:
        """Render by another model, such as one of the finger that is there now; while idle. Takes about a second."""
        return control.use_model(choice.name)

    @router.post("/record")
    def record(request: RecordingRequest) -> Status:
        """Record into a file on the daemon's machine, or stop with null."""
        return control.record(request.path)

    return router


def _views(control: Control) -> APIRouter:
    router = APIRouter(tags=["views"])

    @router.get("/status")
    def status() -> Status:
        """The present state."""
        return control.status()

    @router.get("/textures")
    def textures() -> TextureNames:
        """Names that `/texture` knows."""
        return TextureNames(textures=control.textures())

    @router.get("/events")
    def events(since: Since = 0) -> Events:
        """What happened after event `since`, as far back as it is kept."""
        return Events(events=list(control.events(since)))

    @router.get("/samples", response_model=SampleColumns)
    def samples(
        since: Since = 0, most: Annotated[int, Query(ge=1, le=MOST_SAMPLES, description="The newest so many.")] = 1000
    ) -> JSONResponse:
        """Ticks after tick `since`, one list per field, oldest first."""
        return JSONResponse(sample_columns(control.samples(since, most)))

    @router.get("/surface")
    def surface() -> SurfaceMap:
        """Friction over frequency and voltage."""
        return SurfaceMap(**control.surface_map())

    @router.get("/texture")
    def texture() -> TextureMap:
        """Friction over the screen, of the texture that plays."""
        return TextureMap(**control.texture_map())

    return router


def _streams(control: Control) -> APIRouter:
    router = APIRouter()

    @router.websocket("/state")
    async def state(socket: WebSocket) -> None:
        """A `StateFrame` every 50 ms, or as fast as the client takes them; always the newest."""
        newest_tick = 0

        def next_frame() -> str:
            nonlocal newest_tick
            samples = control.samples(newest_tick, FRAME_SAMPLES)
            if samples.size:
                newest_tick = int(samples["tick"][-1])
            return state_frame(control.status(), samples).model_dump_json()

        async def send_frames() -> None:
            while True:
                await socket.send_text(await to_thread.run_sync(next_frame))
                await asyncio.sleep(FRAME_PERIOD_S)

        await socket.accept()
        await _until_gone(socket, send_frames())

    @router.websocket("/events")
    async def events(socket: WebSocket, since: Since = 0) -> None:
        """Every `Event` after number `since`, one message each."""

        async def send_events() -> None:
            newest = since
            while True:
                for event in control.events(newest):
                    await socket.send_text(event.model_dump_json())
                    newest = event.number
                await asyncio.sleep(EVENT_PERIOD_S)

        await socket.accept()
        await _until_gone(socket, send_events())

    return router


async def _until_gone(socket: WebSocket, sending: Coroutine[Any, Any, None]) -> None:
    """Send until the client closes; what it says is ignored."""
    async with create_task_group() as tasks:

        async def send() -> None:
            with suppress(WebSocketDisconnect):
                await sending

        tasks.start_soon(send)
        while (await socket.receive())["type"] != "websocket.disconnect":
            pass
        tasks.cancel_scope.cancel()


def _answer_errors(app: FastAPI) -> None:
    paths = sorted(path for path in app.openapi()["paths"])

    @app.exception_handler(HapticError)
    async def refused(request: Request, error: HapticError) -> JSONResponse:
        return refusal(_status_of(error), error)

    @app.exception_handler(RequestValidationError)
    async def invalid(request: Request, error: RequestValidationError) -> JSONResponse:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        return refusal(422, BadInputError("bad_request", f"{where}: {first['msg']}", "see /openapi.json"))

    @app.exception_handler(HTTPException)
    async def not_routed(request: Request, error: HTTPException) -> JSONResponse:
        path = request.url.path
        hint = nearest(path, paths) if error.status_code == 404 else "see /openapi.json"
        code = {404: "not_found", 405: "method_not_allowed"}.get(error.status_code, "bad_request")
        response = refusal(error.status_code, HapticError(code, f"{request.method} {path}: {error.detail}", hint))
        response.headers.update(error.headers or {})
        return response

    @app.exception_handler(Exception)
    async def failed(request: Request, error: Exception) -> JSONResponse:
        return refusal(500, HapticError("internal", f"{type(error).__name__}: {error}", "a fault of the program"))


def _status_of(error: HapticError) -> int:
    if isinstance(error, BadInputError):
        return 422
    return 403 if error.code == "not_yours" else 409
