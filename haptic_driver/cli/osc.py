"""`haptic osc`: commands to the daemon as Open Sound Control messages, on this machine alone."""

from __future__ import annotations

import json
import secrets
from collections.abc import Sequence
from hmac import compare_digest
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from haptic_driver.cli.control import client_of
from haptic_driver.cli.daemon import SocketOption
from haptic_driver.cli.output import Json, report, stderr, stdout
from haptic_driver.daemon.verbs import Verb, methods
from haptic_driver.errors import BadInputError, HapticError, optional
from model.support.errors import nearest

if TYPE_CHECKING:
    from haptic_driver.client import Channel

HOST = "127.0.0.1"
PREFIX = "/haptic/"
OscValue = str | int | float | bool


class Commands:
    """What messages `/haptic/VERB TOKEN ...` ask for, done on a command channel.

    Verbs are methods of the Python client; what follows the token are their arguments in order, or
    JSON. Whoever falls silent for longer than the lease loses it.
    """

    def __init__(self, channel: Channel, token: str) -> None:
        self._channel, self._token = channel, token

    def do(self, address: str, values: Sequence[OscValue]) -> list[OscValue] | None:
        """The values of an answer: the verb, and `ok` with JSON or an error's code, words and hint.
        None where it is not heard: without the token nothing is but what switches off.
        """
        name = address.removeprefix(PREFIX)
        verb = methods().get(name)
        if not self.is_known(values) and not (verb is not None and verb.switches_off):
            return None
        try:
            return [name, "ok", self._done(name, verb, values[1:])]
        except HapticError as error:
            return [name, error.code, error.message, error.hint]

    def is_known(self, values: Sequence[OscValue]) -> bool:
        """Whether the token stands first."""
        return bool(values) and compare_digest(str(values[0]).encode(), self._token.encode())

    def _done(self, name: str, verb: Verb[..., Any, Any] | None, values: Sequence[Any]) -> str:
        if verb is None:
            hint = nearest(name, list(methods()))
            raise BadInputError("not_found", f"no verb is called '{name}'", hint)
        answer: str = self._channel.ask(verb, _said(verb, values)).model_dump_json()
        return answer


def _said(verb: Verb[..., Any, Any], values: Sequence[OscValue]) -> dict[str, Any]:
    """A request by its fields in order; a text that is JSON counts as what it says."""
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


def osc(
    port: Annotated[int, Option(min=0, max=65535, help="UDP port; 0: any that is free.")] = 9001,
    socket: SocketOption = None,
    as_json: Json = False,
) -> None:
    """Take commands for a running daemon as Open Sound Control messages, until Ctrl-C.

    `/haptic/arm TOKEN 1.0`, `/haptic/set TOKEN 0.6`, `/haptic/play TOKEN linen`, `/haptic/off`. It
    listens on this machine alone; the token is printed. Answers go to the sender as
    `/haptic/answer`. A lease that no message renews runs out, and the output goes to zero.

    Example: `haptic osc --port 9001`
    """
    servers = optional("pythonosc.osc_server", "osc", "OSC")
    dispatcher = optional("pythonosc.dispatcher", "osc", "OSC").Dispatcher()
    builder = optional("pythonosc.osc_message_builder", "osc", "OSC")
    token = secrets.token_urlsafe(9)
    with client_of(socket) as client, client.channel() as channel:
        commands = Commands(channel, token)

        def hear(sender: tuple[str, int], address: str, *values: OscValue) -> None:
            answer = commands.do(address, values)
            if answer is None:
                stderr.print(f"{address} without the token is not heard", markup=False)
            elif not commands.is_known(values):
                stderr.print(f"{answer[0]} without the token: {answer[1]}", markup=False)
            else:
                message = builder.build_msg(f"{PREFIX}answer", answer)
                server.socket.sendto(message.dgram, sender)

        dispatcher.set_default_handler(hear, needs_reply_address=True)
        try:
            server = servers.BlockingOSCUDPServer((HOST, port), dispatcher)
        except OSError as error:
            said = f"port {port} cannot be had ({error})"
            raise HapticError("port_taken", said, "Give another --port, or 0") from error
        with server:
            heard_at = server.server_address[1]
            where = {"host": HOST, "port": heard_at, "token": token}
            text = f"listening on {HOST}:{heard_at}; token {token}"
            report(as_json, where, lambda: stdout.print(text))
            try:
                server.serve_forever()
            except KeyboardInterrupt:
                return  # the usual end: the channel closes, and its lease with it
