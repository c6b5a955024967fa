"""The command channel: one WebSocket by which a program arms, asks for friction and moves objects
many times a second.

    -> {"id": 1, "verb": "arm", "asked": {"lease_s": 2}}
    <- {"id": 1, "tick": 5120, "answer": {"token": "...", "lease_s": 2.0}}
    <- {"id": 2, "status": 409, "error": {"code": "not_armed", "message": "...", "hint": "..."}}

Verbs are methods of the Python client, by their names. An answer holds from tick `tick` on. The
channel keeps the lease that it was given, and ends it when it closes. What was asked is done in
order. Changes of a scene that have come meanwhile become one, in which the newest place of an
object counts. What switches off waits for nothing: what came before it and is not done yet is
refused.
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any, NamedTuple

from anyio import to_thread
from pydantic import BaseModel, Field, ValidationError

from haptic_driver.config import Checked, foremost, problem
from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.messages import Asked, ErrorReport, RefusedError
from haptic_driver.daemon.verbs import MOST_CHANGES, ArmRequest, SceneChange, Verbs, methods
from haptic_driver.daemon.web.off import OFF_VERBS, OffThreads
from haptic_driver.daemon.web.security import status_of
from haptic_driver.errors import BadInputError, HapticError, message_of
from haptic_driver.textures.objects import Move, Turn
from model.support.errors import nearest

MOST_WAITING = 256
RENEWAL_S = 0.025  # a quarter of the shortest lease
TAKEN_TICKS = 2  # after the newest tick: render may be computing the next one

_VERBS = methods()


class _Numbered(BaseModel):
    """What there is of a message in any case."""

    id: int | str | None = None


class Command(Checked):
    """One message of a client; `id` comes back with the answer. `lease`: the token of another lease
    than the channel's own.
    """

    id: int | str | None = None
    verb: str
    asked: dict[str, Any] = Field(default={})
    lease: str = ""


class _Waiting(NamedTuple):
    """What is to be done, and whom to tell."""

    id: int | str | None
    do: Callable[[Daemon, Asked, str], str]
    asked: Asked
    lease: str


class CommandChannel:
    """What one client says, from its first message to `close`. `send` takes the answers."""

    def __init__(
        self, daemon: Daemon, off: OffThreads, send: Callable[[str], Awaitable[None]]
    ) -> None:
        self._daemon, self._off, self._send = daemon, off, send
        self._token = ""
        self._waiting: deque[_Waiting] = deque()
        self._come = asyncio.Event()
        self._busy = False

    async def hear(self, text: str) -> None:
        """Take a message: what switches off and what renews is done, the rest waits its turn."""
        try:
            command = _understood(text)
            verb = _VERBS[command.verb]
            schema = verb.schema
            asked = schema.model_validate(command.asked)
            at_once = verb.switches_off or verb is Verbs.renew
            if len(self._waiting) >= MOST_WAITING and not at_once:
                raise RefusedError(
                    "busy", f"{MOST_WAITING} commands wait", "wait for answers; OFF is still heard"
                )
        except ValidationError as error:
            _, said, hint = foremost(error.errors(), schema)
            fault = BadInputError("bad_request", said, hint)
            await self._refuse(_id_of(text), fault)
        except HapticError as error:
            await self._refuse(_id_of(text), error)
        else:
            said_id = command.id
            if verb.switches_off:
                await self._switch_off(said_id, command.verb)
            elif verb is Verbs.renew:
                await self._do([_Waiting(said_id, verb.said_json, asked, command.lease)])
            else:
                waiting = _Waiting(said_id, verb.said_json, asked, command.lease)
                self._waiting.append(waiting)
                self._come.set()

    async def work(self) -> None:
        """For ever: do what waits."""
        while True:
            await self._come.wait()
            self._come.clear()
            while self._waiting:
                self._busy = True
                await self._do(self._next())
                self._busy = False

    async def keep(self) -> None:
        """For ever: a command that takes long does not cost the lease."""
        while True:
            await asyncio.sleep(RENEWAL_S)
            if self._busy and self._token:
                with suppress(HapticError):
                    self._daemon.renew(self._token)

    async def close(self) -> None:
        """The client has gone: a lease of its own ends."""
        self._waiting.clear()
        with suppress(HapticError):
            if self._token and self._daemon.renew(self._token):
                await asyncio.wrap_future(self._off.ask(OFF_VERBS["disarm"]))

    def _next(self) -> list[_Waiting]:
        """What is done at once: one command, or all changes of a scene that follow each other."""
        first = self._waiting.popleft()
        together = [first]
        count = _changes(first, first)
        while count and self._waiting and (more := _changes(self._waiting[0], first)):
            count += more
            if count > MOST_CHANGES:
                break
            together.append(self._waiting.popleft())
        return together

    async def _do(self, together: list[_Waiting]) -> None:
        """One command, or several as one; where that is refused, each by itself."""
        _, do, asked, lease = together[0]
        if len(together) > 1:
            asked = _merged([one.asked for one in together if isinstance(one.asked, SceneChange)])
        try:
            answer = await to_thread.run_sync(do, self._daemon, asked, lease or self._token)
        except HapticError as error:
            if len(together) == 1:
                await self._refuse(together[0].id, error)
            for one in together if len(together) > 1 else []:
                await self._do([one])
            return
        except Exception as error:  # of a plug-in, too
            fault = HapticError("internal", message_of(error), "a fault of the program")
            for one in together:
                await self._refuse(one.id, fault, 500)
            return
        if isinstance(asked, ArmRequest):
            self._token = json.loads(answer)["token"]
        for one in together:
            await self._answer(one.id, answer)

    async def _switch_off(self, said_id: int | str | None, name: str) -> None:
        overtaken, self._waiting = self._waiting, deque()
        answer = await asyncio.wrap_future(self._off.ask(OFF_VERBS[name]))
        if answer.status == 200:
            await self._answer(said_id, answer.body.decode())
        else:
            said = {"id": said_id, "status": answer.status, **json.loads(answer.body)}
            await self._send(json.dumps(said))
        for one in overtaken:
            error = RefusedError("overtaken", f"{name} came after it", "ask again")
            await self._refuse(one.id, error)

    async def _answer(self, said_id: int | str | None, answer: str) -> None:
        tick = self._daemon.newest_tick + TAKEN_TICKS
        await self._send(f'{{"id": {json.dumps(said_id)}, "tick": {tick}, "answer": {answer}}}')

    async def _refuse(
        self, said_id: int | str | None, error: HapticError, status: int | None = None
    ) -> None:
        said = {"id": said_id, "status": status or status_of(error)}
        await self._send(json.dumps(said | ErrorReport.of(error).model_dump()))


def _id_of(text: str) -> int | str | None:
    """The number of a request, also of one that cannot be read otherwise: somebody waits for it."""
    try:
        return _Numbered.model_validate_json(text).id
    except ValidationError:
        return None


def _understood(text: str) -> Command:
    """Raises BadInputError for what is no command."""
    if text in OFF_VERBS:  # as the other streams hear it
        return Command(verb=text)
    try:
        command = Command.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        said = "this is no JSON" if first["type"] == "json_invalid" else problem(first)
        raise BadInputError(
            "bad_request", said, 'send {"id": 1, "verb": "set", "asked": {"cof": 0.6}}'
        ) from error
    if command.verb not in _VERBS:
        raise BadInputError(
            "not_found", f"no verb is called '{command.verb}'", nearest(command.verb, list(_VERBS))
        )
    return command


def _changes(one: _Waiting, first: _Waiting) -> int:
    """How many changes of a scene; 0 for what cannot be done together with the first."""
    a, b = one.asked, first.asked
    if not (isinstance(a, SceneChange) and isinstance(b, SceneChange)):
        return 0
    alike = (one.lease, a.nearest) == (first.lease, b.nearest)
    return len(a.changes) if alike else 0


def _merged(asked: list[SceneChange]) -> SceneChange:
    """All of them as one: of an object's places and turns the newest, where nothing else was done
    with it between.
    """
    kept, newer = [], set[tuple[str, str]]()
    for change in reversed([change for each in asked for change in each.changes]):
        if isinstance(change, Move | Turn):
            if (change.do, change.id) in newer:
                continue
            newer.add((change.do, change.id))
        else:
            newer.clear()
        kept.append(change)
    return SceneChange.model_construct(
        changes=kept[::-1], show=any(each.show for each in asked), nearest=asked[0].nearest
    )
