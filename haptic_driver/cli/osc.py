"""`haptic osc`: commands to the daemon as Open Sound Control messages, on this machine alone."""

from __future__ import annotations

import json
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from hmac import compare_digest
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from typer import Option

from haptic_driver.cli.control import client_of
from haptic_driver.cli.daemon import SocketOption
from haptic_driver.cli.output import Json, report, stderr, stdout
from haptic_driver.daemon.private_file import kept_token
from haptic_driver.daemon.verbs import Verb, methods
from haptic_driver.errors import BadInputError, HapticError, message_of, optional
from haptic_driver.processes.started import start_thread
from model.support.errors import nearest

if TYPE_CHECKING:
    from haptic_driver.client import Channel, HapticClient

HOST = "127.0.0.1"
PREFIX = "/haptic/"
MOST_WAITING = 256  # as on the command channel
MOST_BYTES = 65507  # of a datagram
LOST = ("no_answer", "no_daemon")  # of a daemon that has gone
OscValue = str | int | float | bool


class Lasting:
    """A daemon's command channel, opened anew by whoever asks after the daemon has gone."""

    def __init__(self, client: HapticClient) -> None:
        self._client = client
        self._open = ExitStack()
        self._channel: Channel | None = self._open.enter_context(client.channel())

    def ask(self, verb: Verb[..., Any, Any], said: dict[str, Any]) -> Any:
        """As `Channel.ask`; the first that is asked of a daemon that has gone is not answered."""
        if verb.switches_off:
            return self._client.ask(verb, said)
        try:
            if self._channel is None:
                self._channel = self._open.enter_context(self._client.channel())
            return self._channel.ask(verb, said)
        except HapticError as error:
            if error.code in LOST:
                self.close()
            raise

    def close(self) -> None:
        """Hang up, and let the lease go."""
        self._channel = None
        with suppress(HapticError):
            self._open.close()


class Commands:
    """What messages `/haptic/VERB TOKEN ...` ask for, done on a command channel.

    Verbs are methods of the Python client; what follows the token are their arguments in order, or
    one JSON object. Whoever falls silent for longer than the lease loses it.
    """

    def __init__(self, channel: Lasting, token: str) -> None:
        self._channel, self._token = channel, token

    def do(self, address: str, values: Sequence[OscValue]) -> list[OscValue] | None:
        """The values of an answer: the verb, and `ok` with JSON or an error's code, words and hint.
        None where it is not heard: without the token nothing is but what switches off.
        """
        name = address.removeprefix(PREFIX)
        if not self.is_known(values) and not switches_off(address):
            return None
        try:
            return [name, "ok", self._done(name, methods().get(name), values[1:])]
        except HapticError as error:
            return [name, error.code, error.message, error.hint]
        except Exception as error:  # or one message would be the last that is heard
            return [name, "internal", message_of(error), "a fault of the program"]

    def is_known(self, values: Sequence[OscValue]) -> bool:
        """Whether the token stands first."""
        return bool(values) and compare_digest(str(values[0]).encode(), self._token.encode())

    def _done(self, name: str, verb: Verb[..., Any, Any] | None, values: Sequence[Any]) -> str:
        if verb is None:
            hint = nearest(name, list(methods()))
            raise BadInputError("not_found", f"no verb is called '{name}'", hint)
        answer: str = self._channel.ask(verb, _said(verb, values)).model_dump_json()
        return answer


def switches_off(address: str) -> bool:
    """Whether a message there does, with or without the token."""
    verb = methods().get(address.removeprefix(PREFIX))
    return verb is not None and verb.switches_off


class Message(NamedTuple):
    """What has come, and from where. `due_s`, on CLOCK_MONOTONIC: a bundle may say when. `became`:
    the answer to what is done already, and has to be told alone.
    """

    address: str
    values: Sequence[OscValue]
    sender: tuple[str, int]
    due_s: float = 0.0
    became: list[OscValue] | None = None

    @property
    def name(self) -> str:
        """Of the verb."""
        return self.address.removeprefix(PREFIX)


class Turns:
    """Messages one after the other, in a thread. What switches off is done by who hears it, waits
    for none of them, and refuses those that wait. `tell` takes each with its answer.
    """

    def __init__(
        self, commands: Commands, tell: Callable[[Message, list[OscValue] | None], None]
    ) -> None:
        self._commands, self._tell = commands, tell
        self._changed = threading.Condition()
        self._waiting: deque[Message] = deque()
        self._busy = self._closed = False
        self._again: set[str] = set()  # what has switched off while the present message was asked

    @contextmanager
    def taken(self) -> Iterator[None]:
        """In the block messages are done."""
        start_thread("turns", self._work)
        try:
            yield
        finally:
            with self._changed:
                self._closed = True
                self._changed.notify()

    def hear(self, message: Message) -> None:
        """Returns at once, or when the output is off."""
        known = self._commands.is_known(message.values)
        if switches_off(message.address):
            self._switch_off(message)
        elif not self._wait(message if known else message._replace(due_s=0.0)) and known:
            said = f"{MOST_WAITING} messages wait", "wait for answers; OFF is still heard"
            self._tell(message, [message.name, "busy", *said])

    def _wait(self, message: Message) -> bool:
        with self._changed:
            if len(self._waiting) >= MOST_WAITING:
                return False
            self._waiting.append(message)
            self._changed.notify()
            return True

    def _switch_off(self, message: Message) -> None:
        with self._changed:
            before, self._waiting = self._waiting, deque()
            if self._busy:
                self._again.add(message.name)
        became = self._commands.do(message.address, message.values)
        if self._commands.is_known(message.values):
            self._tell(message, became)
        else:  # the console may be stopped, and the next OFF has to be heard
            self._wait(message._replace(became=became))
        for one in before:
            if one.became is None and self._commands.is_known(one.values):
                said = f"{message.name} came after it", "ask again"
                self._tell(one, [one.name, "overtaken", *said])
            else:
                self._wait(one)

    def _work(self) -> None:
        while (message := self._next()) is not None:
            became = message.became
            if became is None:
                became = self._commands.do(message.address, message.values)
                self._switch_off_again()
            self._tell(message, became)

    def _next(self) -> Message | None:
        """The first that waits, once it is due; None at the end."""
        with self._changed:
            while not self._closed:
                early_s = self._waiting[0].due_s - time.monotonic() if self._waiting else None
                if early_s is not None and early_s <= 0.0:
                    message = self._waiting.popleft()
                    self._busy = message.became is None
                    return message
                self._changed.wait(early_s)
        return None

    def _switch_off_again(self) -> None:
        """By its own connection OFF may have come to the daemon before what was said before it."""
        while True:
            with self._changed:
                again, self._again = self._again, set()
                self._busy = bool(again)
            if not again:
                return
            self._commands.do(PREFIX + ("disarm" if "disarm" in again else "off"), [])


def _said(verb: Verb[..., Any, Any], values: Sequence[OscValue]) -> dict[str, Any]:
    """A request by its fields in order, or as one object; a text that is JSON counts as what it
    says.
    """
    if len(values) == 1 and isinstance(whole := _value(values[0]), dict):
        return whole
    fields = list(verb.schema.model_fields)
    if len(values) > len(fields):
        said = f"{len(values)} values, for {', '.join(fields) or 'none'}"
        raise BadInputError("bad_request", said, f"give at most {len(fields)}")
    return {name: _value(value) for name, value in zip(fields, values, strict=False)}


def _value(value: OscValue) -> Any:
    if isinstance(value, str) and value[:1] in ("[", "{"):
        try:
            return json.loads(value)
        except ValueError as error:
            raise BadInputError("bad_request", f"{value!r}: {error}", "give JSON") from error
    return value


def _datagram(builder: Any, answer: list[OscValue]) -> bytes:
    said: bytes = builder.build_msg(f"{PREFIX}answer", answer).dgram
    if len(said) > MOST_BYTES:
        words = f"{len(said)} bytes are more than a message holds", "ask by HTTP or from Python"
        said = builder.build_msg(f"{PREFIX}answer", [answer[0], "too_long", *words]).dgram
    return said


def osc(
    port: Annotated[int, Option(min=0, max=65535, help="UDP port; 0: any that is free.")] = 9001,
    socket: SocketOption = None,
    token_file: Annotated[
        Path | None, Option(help="Keep the token there, so that it stays; made where missing.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Take commands for a running daemon as Open Sound Control messages, until Ctrl-C.

    `/haptic/arm TOKEN 1.0`, `/haptic/set TOKEN 0.6`, `/haptic/play TOKEN linen`, `/haptic/off`. It
    listens on this machine alone; the token is printed. Answers go to the sender as
    `/haptic/answer`, but of messages without the token to the console alone. `off` and `disarm`
    wait for no other message. A lease that no message renews runs out, and the output goes to zero.

    Example: `haptic osc --port 9001`
    """
    servers = optional("pythonosc.osc_server", "osc", "OSC")
    packets = optional("pythonosc.osc_packet", "osc", "OSC")
    builder = optional("pythonosc.osc_message_builder", "osc", "OSC")
    token = secrets.token_urlsafe(9) if token_file is None else kept_token(token_file)
    with client_of(socket) as client, closing(Lasting(client)) as channel:
        commands = Commands(channel, token)

        def tell(message: Message, answer: list[OscValue] | None) -> None:
            # a sender or console that has gone is told nothing; rich makes SystemExit of the latter
            with suppress(OSError, SystemExit):
                if answer is None:
                    stderr.print(f"{message.address} without the token is not heard", markup=False)
                elif not commands.is_known(message.values):
                    stderr.print(f"{answer[0]} without the token: {answer[1]}", markup=False)
                else:
                    server.socket.sendto(_datagram(builder, answer), message.sender)

        turns = Turns(commands, tell)

        class Dispatcher:
            """In the place of the library's, which sleeps until a bundle is due."""

            def call_handlers_for_packet(self, data: bytes, sender: tuple[str, int]) -> list[Any]:
                with suppress(packets.ParseError):
                    for at_s, said in packets.OscPacket(data).messages:
                        due_s = time.monotonic() + at_s - time.time()
                        turns.hear(Message(said.address, said.params, sender, due_s))
                return []

        try:
            server = servers.BlockingOSCUDPServer((HOST, port), Dispatcher())
        except OSError as error:
            said = f"port {port} cannot be had ({error})"
            raise HapticError("port_taken", said, "Give another --port, or 0") from error
        with server, turns.taken():
            heard_at = server.server_address[1]
            where = {"host": HOST, "port": heard_at, "token": token}
            held = f"token {token}" if token_file is None else f"its token is in {token_file}"
            text = f"listening on {HOST}:{heard_at}; {held}"
            report(as_json, where, lambda: stdout.print(text))
            try:
                server.serve_forever()
            except KeyboardInterrupt:
                return  # the usual end: the channel closes, and its lease with it
