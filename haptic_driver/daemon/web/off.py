"""What switches off, however a request writes it: `/off`, `/off/`, `/off?why`,
`http://host/off`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from starlette.types import ASGIApp, Receive, Scope, Send

from haptic_driver.daemon.verbs import COMMANDS, Verb

OFF_VERBS: dict[str, Verb[Any, Any]] = {verb.name: verb for verb in COMMANDS if verb.switches_off}
_PATHS = {verb.path: verb for verb in OFF_VERBS.values()}
_LINE = re.compile(rb"(?:\r?\n)*([A-Z]+) (?:(?i:https?)://[^/?#\s]*)?(/[^/?#\s]*)/?[?#\s]")
_ORIGIN = re.compile(r"(?i:https?)://[^/]*")


def begins_off(data: bytes) -> Verb[Any, Any] | None:
    """The verb, where a request that begins with `data` switches off."""
    line = _LINE.match(data)
    verb = _PATHS.get(line[2].decode("latin-1")) if line else None
    return verb if verb and line and verb.method.encode() == line[1] else None


def plain_path(path: str) -> str:
    """A path without the origin before it (RFC 9112, 3.2.2), and without a slash behind what
    switches off.
    """
    origin = _ORIGIN.match(path)
    path = (path[origin.end() :] or "/") if origin else path
    return path[:-1] if path[:-1] in _PATHS else path


@dataclass(frozen=True)
class PlainPaths:
    """Lets an app see plain paths alone."""

    app: ASGIApp

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            path = plain_path(scope["path"])
            scope = {**scope, "path": path, "raw_path": path.encode()}
        await self.app(scope, receive, send)


def is_off(scope: Scope) -> bool:
    """Whether a request switches off."""
    verb = _PATHS.get(plain_path(scope["path"]))
    return verb is not None and scope.get("method") == verb.method
