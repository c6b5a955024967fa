"""Commands as Open Sound Control messages: by a token, on this machine alone."""

from __future__ import annotations

import json
import signal
import socket as udp
import subprocess
import sys

import pytest

from haptic_driver.cli.osc import Commands
from haptic_driver.client import HapticClient
from haptic_driver.daemon.state_machine import DaemonState

ANSWER_S = 20.0


def socket_of_udp():
    made = udp.socket(udp.AF_INET, udp.SOCK_DGRAM)
    made.settimeout(ANSWER_S)
    return made


@pytest.fixture
def commands(socket):
    with HapticClient(socket) as client, client.channel() as channel:
        yield Commands(channel, "secret")


def test_verbs_take_their_values_in_order_or_as_json(commands, control):
    assert commands.do("/haptic/arm", ["secret", 5.0])[:2] == ["arm", "ok"]
    verb, ok, answer = commands.do("/haptic/set", ["secret", 0.6])
    assert (verb, ok, json.loads(answer)["target_cof"]) == ("set", "ok", 0.6)
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


@pytest.mark.process
def test_messages_of_an_osc_client_are_answered_and_the_lease_ends_with_the_command(
    socket, control
):
    osc = pytest.importorskip("pythonosc.osc_message", reason="python-osc is not installed")
    builder = pytest.importorskip("pythonosc.osc_message_builder")
    line = [sys.executable, "-c", "from haptic_driver.cli.main import run; run()", "osc"]
    with subprocess.Popen([*line, "--port", "0"], stdout=subprocess.PIPE, text=True) as command:
        where, token = command.stdout.readline().removeprefix("listening on ").split("; token ")
        host, port = where.split(":")
        assert host == "127.0.0.1"
        with socket_of_udp() as client:
            asked = builder.build_msg("/haptic/arm", [token.strip(), 10.0])
            client.sendto(asked.dgram, (host, int(port)))
            answer = osc.OscMessage(client.recv(4096))
        assert (answer.address, answer.params[:2]) == ("/haptic/answer", ["arm", "ok"])
        assert control.machine.state is DaemonState.ARMED
        command.send_signal(signal.SIGINT)
        assert command.wait(ANSWER_S) == 0
    assert control.machine.state is DaemonState.IDLE
