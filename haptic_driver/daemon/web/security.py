"""Who may talk to the API over TCP, and how much: token, Host and Origin, size of a request.

A page of another site can make a browser send requests to loopback. It can also give its own name
the address of loopback (DNS rebinding). The first lacks the token and has a foreign Origin, the
second has a foreign Host.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from http.client import HTTPException, parse_headers
from io import BytesIO
from urllib.parse import urlsplit

from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from haptic_driver.daemon.messages import ErrorReport
from haptic_driver.errors import BadInputError, HapticError, shown

MOST_BODY_BYTES = 16 * 1024
LARGER_BODY_BYTES = {"/scene": 256 * 1024}  # hundreds of objects at once
BODY_TIMEOUT_S = 2.0
POLICY_VIOLATION = 1008  # of WebSockets, RFC 6455 section 7.4.1
TRY_AGAIN_LATER = 1013  # of WebSockets, IANA's registry
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
        "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


@dataclass(frozen=True)
class TokenGate:
    """Lets through what knows the token and comes from a page of ours, or from no page at all.

    `hosts`: what `Host` may say, as `name:port`. `origins`: whose pages may use the API besides, as
    `http://name:port`; they need the token. The static files below `public` need none; they hold no
    secrets. The token comes in `Authorization: Bearer` or, for WebSockets of a
    browser, which cannot send that, in `?token=`.
    """

    app: ASGIApp
    token: str
    hosts: frozenset[str]
    public: str
    origins: frozenset[str] = frozenset()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        refused = self._refused(HTTPConnection(scope))
        if refused is None:
            await self.app(scope, receive, _with_headers(send, HEADERS))
        elif scope["type"] == "websocket":
            await send(
                {"type": "websocket.close", "code": POLICY_VIOLATION, "reason": refused[1].message}
            )
        else:
            await refusal(*refused)(scope, receive, _with_headers(send, HEADERS))

    def lets(self, head: bytes) -> bool:
        """Whether it lets a request through whose head is in these bytes."""
        line, _, fields = head.lstrip(b"\r\n").partition(b"\n")
        method, target, *_ = line.decode("latin-1").split(" ")
        path, _, query = target.partition("?")
        try:
            said = parse_headers(BytesIO(fields)).items()
        except HTTPException:  # too many, or too long
            return False
        headers = [(name.lower().encode(), value.encode("latin-1")) for name, value in said]
        scope = {"type": "http", "method": method, "path": path, "headers": headers}
        return self._refused(HTTPConnection({**scope, "query_string": query.encode()})) is None

    def _refused(self, connection: HTTPConnection) -> tuple[int, HapticError] | None:
        host, origin = connection.headers.get("host", ""), connection.headers.get("origin")
        if host.lower() not in self.hosts:
            return 403, HapticError(
                "bad_host", "this address is not where the API is", "use the address it printed"
            )
        if origin is not None and not self._ours(origin):
            return 403, HapticError(
                "bad_origin",
                f"pages of {shown(origin)} may not use the API",
                "open its own page, or start the daemon with --allow-origin",
            )
        if self._is_public(connection) or self._knows_token(connection):
            return None
        return 401, HapticError(
            "no_token", "this needs the token", "send Authorization: Bearer TOKEN"
        )

    def _ours(self, origin: str) -> bool:
        try:
            parts = urlsplit(origin)
        except ValueError:  # of `http://[`
            return False
        ours = parts.scheme == "http" and parts.netloc.lower() in self.hosts
        return ours or origin.lower() in self.origins

    def _is_public(self, connection: HTTPConnection) -> bool:
        path, method = connection.scope["path"], connection.scope.get("method")
        return method in ("GET", "HEAD") and (path == "/" or path.startswith(self.public))

    def _knows_token(self, connection: HTTPConnection) -> bool:
        scheme, _, given = connection.headers.get("authorization", "").partition(" ")
        if scheme.lower() != "bearer":
            given = connection.query_params.get("token", "")
        return secrets.compare_digest(given.strip().encode(), self.token.encode())


@dataclass(frozen=True)
class OneRequest:
    """Ends a connection with the answer to its first request, so that each comes through a door."""

    app: ASGIApp

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await self.app(scope, receive, _with_headers(send, {"Connection": "close"}))


class AtMost:
    """Refuses requests and streams beyond so many at once."""

    def __init__(self, app: ASGIApp, most: int) -> None:
        self._app = app
        self._most = most
        self._open = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if self._open >= self._most:
            error = HapticError(
                "busy",
                f"{self._most} requests and streams are open",
                "close some; OFF is still heard",
            )
            if scope["type"] == "websocket":
                await send(
                    {"type": "websocket.close", "code": TRY_AGAIN_LATER, "reason": error.message}
                )
            else:
                await refusal(503, error)(scope, receive, send)
            return
        self._open += 1
        try:
            await self._app(scope, receive, send)
        finally:
            self._open -= 1


@dataclass(frozen=True)
class BodyLimit:
    """Refuses a body of more than `MOST_BODY_BYTES` (or of what its path may have), whatever length
    it claims to have, and one that is late.
    """

    app: ASGIApp

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request; its body is read here and handed on whole."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        most = LARGER_BODY_BYTES.get(scope["path"], MOST_BODY_BYTES)
        try:
            async with asyncio.timeout(BODY_TIMEOUT_S):
                body = await _body(receive, most)
        except TimeoutError:
            error = HapticError(
                "too_late",
                f"a request takes at most {BODY_TIMEOUT_S:g} s to come",
                "send it at once",
            )
            await refusal(408, error)(scope, receive, send)
            return
        if body is None:
            return
        if len(body) > most:
            error = HapticError("too_large", f"a request has at most {most} bytes", "send less")
            await refusal(413, error)(scope, receive, send)
            return
        whole: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

        async def hand_on() -> Message:
            return whole.pop() if whole else await receive()

        await self.app(scope, hand_on, send)


async def _body(receive: Receive, most: int) -> bytes | None:
    """A body, or a little more than the most that it may have; None when the client has gone."""
    body = b""
    while len(body) <= most:
        message = await receive()
        if message["type"] == "http.disconnect":
            return None
        body += message.get("body", b"")
        if not message.get("more_body", False):
            break
    return body


def origin_of(page: str) -> str:
    """What a browser says of pages of such an address. Raises BadInputError for another text."""
    try:
        parts = urlsplit(page)
    except ValueError:
        parts = urlsplit("")
    if parts.scheme not in ("http", "https") or not parts.netloc:
        raise BadInputError(
            "bad_origin", f"'{shown(page)}' is no address of pages", "Try http://localhost:5173"
        )
    return f"{parts.scheme}://{parts.netloc}".lower()


def status_of(error: HapticError) -> int:
    """Of a refusal: unusable input, another's lease, or not in this state."""
    if isinstance(error, BadInputError):
        return 422
    return 403 if error.code == "not_yours" else 409


def refusal(status: int, error: HapticError) -> JSONResponse:
    """The response that says an error."""
    headers = {"WWW-Authenticate": "Bearer"} if status == 401 else None
    return JSONResponse(ErrorReport.of(error).model_dump(), status, headers)


def _with_headers(send: Send, headers: Mapping[str, str]) -> Send:
    async def adding(message: Message) -> None:
        if message["type"] == "http.response.start":
            extra = [(name.lower().encode(), value.encode()) for name, value in headers.items()]
            message["headers"] = [*message["headers"], *extra]
        await send(message)

    return adding
