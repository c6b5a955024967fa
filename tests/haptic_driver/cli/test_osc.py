"""Commands as Open Sound Control messages: by a token, on this machine alone."""

from __future__ import annotations

import json
import signal
import socket as udp
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from haptic_driver.cli.osc import MOST_WAITING, Commands, Lasting, Message, Turns
from haptic_driver.client import HapticClient
from haptic_driver.daemon.state_machine import DaemonState
from haptic_driver.errors import BadInputError
from tests.haptic_driver.daemon.bench_control import BenchControl, serving
from tests.waiting import HANG_S, until

ANSWER_S = 20.0


def socket_of_udp():
    made = udp.socket(udp.AF_INET, udp.SOCK_DGRAM)
    made.settimeout(ANSWER_S)
    return made


@pytest.fixture
def commands(socket):
    with HapticClient(socket) as client, client.channel() as channel:
        yield Commands(channel, "secret")


def test_a_daemon_that_comes_back_is_found_again(tmp_path):
    """After a restart every verb but OFF failed for good."""
    with serving(BenchControl(), tmp_path):
        lasting = Lasting(HapticClient(tmp_path / "d.sock"))
        commands = Commands(lasting, "secret")
        assert commands.do("/haptic/status", ["secret"])[1] == "ok"
    assert commands.do("/haptic/status", ["secret"])[1] == "no_answer"
    assert commands.do("/haptic/status", ["secret"])[1] == "no_daemon"
    with serving(BenchControl(), tmp_path):
        assert commands.do("/haptic/arm", ["secret", 5.0])[1] == "ok"
        assert commands.do("/haptic/set", ["secret", 0.6])[1] == "ok"
        lasting.close()


def test_verbs_take_their_values_in_order_or_as_json(commands, control):
    assert commands.do("/haptic/arm", ["secret", 5.0])[:2] == ["arm", "ok"]
    verb, ok, answer = commands.do("/haptic/set", ["secret", 0.6])
    assert (verb, ok, json.loads(answer)["target_cof"]) == ("set", "ok", 0.6)
    verb, ok, answer = commands.do("/haptic/set", ["secret", '{"cof": 0.5, "nearest": true}'])
    assert (verb, ok, json.loads(answer)["target_cof"]) == ("set", "ok", 0.5)
    assert commands.do("/haptic/set", ["secret", '{"coff": 0.5}'])[1] == "bad_request"
    assert commands.do("/haptic/play", ["secret", "linen"])[1] == "ok"
    turned = json.dumps([{"do": "turn", "id": "a", "rotation_deg": 10.0}])
    assert commands.do("/haptic/change_scene", ["secret", turned])[1] != "bad_request"
    assert commands.do("/haptic/off", ["secret"])[:2] == ["off", "ok"]
    assert control.machine.state is DaemonState.ARMED


@pytest.mark.parametrize(
    ("address", "values", "code"),
    [
        ("/haptic/sett", ["secret", 0.6], "not_found"),
        ("/haptic/set", ["secret", "soft"], "bad_request"),
    ],
)
def test_what_cannot_be_done_is_answered_with_its_code(commands, address, values, code):
    assert commands.do(address, values)[1] == code


def test_without_the_token_nothing_but_off_is_done(commands, control):
    commands.do("/haptic/arm", ["secret", 5.0])
    commands.do("/haptic/set", ["secret", 0.6])
    for values in ([], ["other", 0.7], [0.7]):
        assert commands.do("/haptic/set", values) is None
    assert control.status().target_cof == 0.6
    assert commands.do("/haptic/off", [])[:2] == ["off", "ok"]
    assert control.status().target_cof is None


class SlowChannel:
    """It answers `play` when it is let go, and everything else at once; `asked` has the verbs."""

    def __init__(self):
        self.asked = []
        self.begun, self.let_go = threading.Event(), threading.Event()

    def ask(self, verb, said):
        self.asked.append(verb.path)
        if verb.path == "/texture":
            self.begun.set()
            assert self.let_go.wait(HANG_S)
        return SimpleNamespace(model_dump_json=lambda: "{}")


@pytest.fixture
def channel():
    channel = SlowChannel()
    yield channel
    channel.let_go.set()


@pytest.fixture
def told():
    return []


@pytest.fixture
def turns(channel, told):
    """Messages of one sender; `play` has begun, and waits."""
    tell = lambda message, answer: told.append(answer and answer[:2])  # noqa: E731
    turns = Turns(Commands(channel, "secret"), tell)
    with turns.taken():
        turns.hear(message("play", "secret", "linnen"))
        assert channel.begun.wait(HANG_S)
        yield turns


def message(name, *values, **more):
    return Message(f"/haptic/{name}", list(values), ("127.0.0.1", 9), **more)


@pytest.mark.parametrize("verb", ["off", "disarm"])
@pytest.mark.parametrize("token", [["secret"], ["wrong"], []])
def test_what_switches_off_waits_for_no_message(turns, channel, told, verb, token):
    """A texture that was not there kept the voltage on for three seconds."""
    turns.hear(message("set", "secret", 0.6))
    turns.hear(message(verb, *token))
    assert channel.asked == ["/texture", f"/{verb}"]
    answered = [[verb, "ok"]] * (token == ["secret"])
    assert told == [*answered, ["set", "overtaken"]]
    turns.hear(message("status", "secret"))
    channel.let_go.set()
    until(lambda: ["status", "ok"] in told)
    assert ["play", "ok"] in told
    assert told.count([verb, "ok"]) == 1


def test_what_came_to_the_daemon_after_an_off_that_was_said_later_is_off_again(turns, channel):
    """OFF has a connection of its own, on which it may arrive first."""
    turns.hear(message("off"))
    turns.hear(message("disarm"))
    turns.hear(message("arm", "secret", 5.0))
    channel.let_go.set()
    until(lambda: "/arm" in channel.asked)
    assert channel.asked == ["/texture", "/off", "/disarm", "/disarm", "/arm"]


def test_a_message_that_is_not_due_keeps_no_off_waiting(turns, channel, told):
    channel.let_go.set()
    turns.hear(message("set", "secret", 0.6, due_s=time.monotonic() + 3600.0))
    turns.hear(message("off", "secret", due_s=time.monotonic() + 3600.0))
    assert "/off" in channel.asked
    assert ["set", "overtaken"] in told
    assert "/set" not in channel.asked


def test_a_bundle_of_another_hour_without_the_token_keeps_nobody_waiting(turns, channel, told):
    channel.let_go.set()
    turns.hear(message("set", "wrong", 0.6, due_s=time.monotonic() + 3600.0))
    turns.hear(message("status", "secret"))
    until(lambda: ["status", "ok"] in told)


def test_more_than_can_wait_is_told_to_who_has_the_token(turns, channel, told):
    for _ in range(MOST_WAITING):
        turns.hear(message("set", "secret", 0.6))
    turns.hear(message("set", "wrong", 0.7))
    assert told == []
    turns.hear(message("set", "secret", 0.7))
    assert told == [["set", "busy"]]
    turns.hear(message("off", "secret"))
    assert told[1:] == [["off", "ok"], *MOST_WAITING * [["set", "overtaken"]]]


def test_a_fault_of_the_program_is_answered_and_the_next_message_is_heard(told):
    asked = iter([ZeroDivisionError("by zero")])

    def ask(verb, said):
        for error in asked:
            raise error
        return SimpleNamespace(model_dump_json=lambda: "{}")

    turns = Turns(
        Commands(SimpleNamespace(ask=ask), "secret"), lambda _, answer: told.append(answer)
    )
    with turns.taken():
        turns.hear(message("status", "secret"))
        turns.hear(message("status", "secret"))
        until(lambda: len(told) == 2)
    assert [answer[:2] for answer in told] == [["status", "internal"], ["status", "ok"]]


class Listening:
    """`haptic osc` in a process of its own, and a client that it answers."""

    def __init__(self, command):
        self._osc = pytest.importorskip("pythonosc.osc_message", reason="no python-osc")
        self._builder = pytest.importorskip("pythonosc.osc_message_builder")
        where, token = command.stdout.readline().removeprefix("listening on ").split("; token ")
        host, port = where.split(":")
        assert host == "127.0.0.1"
        self.command, self.token, self._to = command, token.strip(), (host, int(port))
        self._client = socket_of_udp()

    def say(self, name, *values):
        self.say_as(self.token, name, *values)

    def say_as(self, token, name, *values):
        asked = self._builder.build_msg(f"/haptic/{name}", [token, *values])
        self._client.sendto(asked.dgram, self._to)

    def say_all_at(self, when, *names):
        """As one bundle."""
        bundles = pytest.importorskip("pythonosc.osc_bundle_builder")
        bundle = bundles.OscBundleBuilder(when)
        for name in names:
            bundle.add_content(self._builder.build_msg(f"/haptic/{name}", [self.token]))
        self._client.sendto(bundle.build().dgram, self._to)

    def answer(self):
        answer = self._osc.OscMessage(self._client.recv(65536))
        assert answer.address == "/haptic/answer"
        return answer.params

    def close(self):
        self._client.close()


@contextmanager
def listening_osc(**options):
    pytest.importorskip("pythonosc", reason="python-osc is not installed")
    line = [sys.executable, "-c", "from haptic_driver.cli.main import run; run()", "osc"]
    line += ["--port", "0"]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True, **options) as command:
        listening = Listening(command)
        yield listening
        listening.close()
        command.send_signal(signal.SIGINT)
        assert command.wait(ANSWER_S) == 0


@pytest.fixture
def listening(socket):
    with listening_osc() as listening:
        yield listening


@pytest.mark.process
def test_messages_of_an_osc_client_are_answered_and_the_lease_ends_with_the_command(
    listening, control
):
    listening.say("arm", 10.0)
    assert listening.answer()[:2] == ["arm", "ok"]
    assert control.machine.state is DaemonState.ARMED
    listening.command.send_signal(signal.SIGINT)
    assert listening.command.wait(ANSWER_S) == 0
    assert control.machine.state is DaemonState.IDLE


@pytest.mark.process
def test_off_by_osc_is_answered_while_a_texture_is_being_read(listening, control, monkeypatch):
    begun, let_go = threading.Event(), threading.Event()

    def play(*_, **__):
        begun.set()
        assert let_go.wait(HANG_S)
        raise BadInputError("unknown_texture", "there is no texture 'linnen'", "linen")

    monkeypatch.setattr(control, "play", play)
    listening.say("arm", 60.0)
    listening.say("set", 0.6)
    assert [listening.answer()[1] for _ in range(2)] == ["ok", "ok"]
    listening.say("play", "linnen")
    assert begun.wait(HANG_S)
    listening.say("off")
    try:
        assert listening.answer()[:2] == ["off", "ok"]
        assert control.status().target_cof is None
    finally:
        let_go.set()
    assert listening.answer()[:2] == ["play", "unknown_texture"]


@pytest.mark.process
def test_who_lacks_the_token_gets_no_answer_and_the_console_says_what_became(socket, control):
    """As the docs say: an answer would tell a stranger the rig's state."""
    with listening_osc(stderr=subprocess.PIPE) as listening:
        listening.say("arm", 60.0)
        listening.say("set", 0.6)
        assert [listening.answer()[0] for _ in range(2)] == ["arm", "set"]
        listening.say_as("wrong", "set", 0.7)
        listening.say_as("wrong", "off")
        until(lambda: control.status().target_cof is None)
        listening.say("status")
        assert listening.answer()[0] == "status"
        told = [listening.command.stderr.readline() for _ in range(2)]
    assert set(told) == {
        "off without the token: ok\n",
        "/haptic/set without the token is not heard\n",
    }


@pytest.mark.process
def test_a_bundle_of_another_hour_keeps_no_off_waiting(listening, control):
    listening.say_all_at(time.time() + 3600.0, "arm")
    listening.say("off")
    assert {listening.answer()[0]: None for _ in range(2)} == {"off": None, "arm": None}
    assert control.machine.state is DaemonState.IDLE


@pytest.mark.process
def test_an_answer_that_no_datagram_holds_is_said_to_be_too_long(listening, control, monkeypatch):
    monkeypatch.setattr(control, "textures", lambda: ["x" * 70000])
    listening.say("texture_names")
    assert listening.answer()[:2] == ["texture_names", "too_long"]
