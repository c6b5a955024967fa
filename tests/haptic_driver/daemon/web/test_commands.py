"""The command channel as a WebSocket client sees it: order, merging, OFF, and the lease."""

from __future__ import annotations

import json
import threading

import pytest
from websockets.sync.client import unix_connect

from haptic_driver.client import HapticClient, NoDaemonError, circle
from haptic_driver.daemon.messages import DaemonState
from haptic_driver.daemon.web import server
from haptic_driver.daemon.web.commands import MOST_WAITING
from haptic_driver.errors import HapticError
from tests.haptic_driver.daemon.bench_control import BenchControl, serving
from tests.waiting import until


@pytest.fixture
def control(tmp_path):
    bench = BenchControl()
    with serving(bench, tmp_path):
        yield bench


@pytest.fixture
def line(control, tmp_path):
    with unix_connect(str(tmp_path / "d.sock"), "ws://haptic/commands") as line:
        yield line


class Held:
    """A change of a scene that waits."""

    def __init__(self, change):
        self.change = change
        self.begun, self.let_go = threading.Event(), threading.Event()

    def __call__(self, *arguments, **options):
        self.begun.set()
        self.let_go.wait(30.0)
        return self.change(*arguments, **options)


@pytest.fixture
def held(line, control, monkeypatch):
    """A scene whose next change has begun and waits; it is command 1."""
    armed(line)
    held = Held(control.change_scene)
    monkeypatch.setattr(control, "change_scene", held)
    say(line, 1, "change_scene", changes=[move(1.0)])
    assert held.begun.wait(30.0)
    yield held
    held.let_go.set()


def say(line, number, verb, **asked):
    line.send(json.dumps({"id": number, "verb": verb, "asked": asked}))


def answer(line):
    return json.loads(line.recv(30.0))


def ask(line, verb, **asked):
    say(line, 1, verb, **asked)
    return answer(line)


def move(x_mm):
    return {"do": "move", "id": "key", "x_mm": x_mm, "y_mm": 5.0}


def armed(line):
    assert ask(line, "arm", lease_s=60.0)["answer"]["lease_s"] == 60.0
    made = {"shape": {"kind": "circle", "radius_mm": 4.0}, "origin_mm": [10.0, 5.0], "cof": 0.6}
    assert "answer" in ask(line, "change_scene", changes=[{"do": "add", "id": "key", **made}])


def test_commands_are_done_in_order_and_answered_by_their_ids(line, control):
    say(line, "a", "arm", lease_s=5.0)
    say(line, 2, "set", cof=0.6)
    say(line, 3, "status")
    first, second, third = answer(line), answer(line), answer(line)
    assert [first["id"], second["id"], third["id"]] == ["a", 2, 3]
    assert first["answer"]["token"]
    assert second["answer"]["target_cof"] == third["answer"]["target_cof"] == 0.6
    assert second["tick"] >= 2


@pytest.mark.parametrize(
    ("said", "status", "code"),
    [
        ("no JSON", 422, "bad_request"),
        ('{"verb": "sett"}', 422, "not_found"),
        ('{"id": 1, "verb": "set", "asked": {"cof": 0.6}}', 409, "not_armed"),
    ],
)
def test_what_cannot_be_done_is_refused_and_the_channel_goes_on(line, said, status, code):
    line.send(said)
    refused = answer(line)
    assert (refused["status"], refused["error"]["code"]) == (status, code)
    assert "answer" in ask(line, "status")


def test_a_slip_of_the_pen_is_answered_by_the_nearest_word(line):
    line.send('{"id": 1, "verb": "set", "asked": {"cog": 0.6}}')
    assert answer(line)["error"]["hint"].startswith("Did you mean 'cof'?")


@pytest.mark.parametrize("number", [7, "seven"])
@pytest.mark.parametrize(
    "said",
    [
        {"verb": "nosuch"},
        {},
        {"verb": 3},
        {"verb": "set", "asked": [0.6]},
        {"verb": "set", "asked": {"cof": "soft"}},
        {"verb": "set", "more": 1},
        {"verb": "set", "lease": None},
    ],
)
def test_a_request_that_is_refused_unread_is_answered_by_its_id(line, said, number):
    """A page that asked for a verb that is not there waited for ever."""
    line.send(json.dumps({"id": number, **said}))
    refused = answer(line)
    assert (refused["id"], refused["status"]) == (number, 422)


@pytest.mark.parametrize("said", ["no JSON", "[1]", "7", '{"id": [1], "verb": "status"}'])
def test_what_has_no_id_that_can_be_read_is_refused_without(line, said):
    line.send(said)
    refused = answer(line)
    assert (refused["id"], refused["status"]) == (None, 422)


def test_what_the_program_gets_wrong_is_answered(line, control, monkeypatch):
    monkeypatch.setattr(control, "scene_shown", lambda: 1 / 0)
    refused = ask(line, "scene_shown")
    assert (refused["status"], refused["error"]["code"]) == (500, "internal")


def heard(line):
    """What was said before has been taken: a renewal overtakes it."""
    assert "token" in ask(line, "renew")["answer"]


def test_of_places_that_came_meanwhile_the_newest_counts(line, control, held):
    for number in range(2, 6):
        say(line, number, "change_scene", changes=[move(float(number))])
    heard(line)
    held.let_go.set()
    assert [answer(line)["id"] for _ in range(5)] == [1, 2, 3, 4, 5]
    changed = [changes for name, *changes in control.calls if name == "change_scene"]
    assert [[change.x_mm for change in changes] for changes in changed[1:]] == [[1.0], [5.0]]


def test_of_several_that_cannot_be_done_together_each_has_its_own_answer(line, control, held):
    say(line, 2, "change_scene", changes=[move(2.0)])
    say(line, 3, "change_scene", changes=[{"do": "remove", "id": "nobody"}])
    say(line, 4, "change_scene", changes=[move(4.0)])
    heard(line)
    held.let_go.set()
    assert ["error" in answer(line) for _ in range(4)] == [False, False, True, False]


@pytest.mark.parametrize("written", ["off", '{"id": 9, "verb": "off"}'])
def test_off_waits_for_nothing_and_what_came_before_it_is_refused(line, control, held, written):
    say(line, 2, "set", cof=0.7)
    line.send(written)
    assert answer(line)["answer"]["state"] == "armed"
    overtaken = answer(line)
    assert (overtaken["id"], overtaken["error"]["code"]) == (2, "overtaken")


def test_who_asks_faster_than_can_be_done_is_told(line, control, held):
    for number in range(2, MOST_WAITING + 3):
        say(line, number, "set", cof=0.6)
    refused = answer(line)
    assert (refused["id"], refused["error"]["code"]) == (MOST_WAITING + 2, "busy")
    heard(line)
    line.send("off")
    assert answer(line)["answer"]["state"] == "armed"
    assert {answer(line)["error"]["code"] for _ in range(MOST_WAITING)} == {"overtaken"}


def test_a_command_that_takes_long_keeps_the_lease(line, control, held):
    until_s = control.machine.lease_until_s
    until(lambda: control.machine.lease_until_s > until_s)


def test_the_lease_ends_with_the_channel_and_no_other_does(line, control, tmp_path):
    with unix_connect(str(tmp_path / "d.sock"), "ws://haptic/commands") as other:
        armed(other)
        line.close()
        assert control.machine.state is DaemonState.RENDERING
    until(lambda: control.machine.state is DaemonState.IDLE)


STREAMS = {
    "watch": lambda client: next(client.watch()),
    "channel": lambda client: client.channel().__enter__(),
}


@pytest.mark.parametrize("stream", STREAMS)
def test_a_stream_without_the_token_is_not_said_to_meet_no_daemon(tmp_path, stream):
    with serving(BenchControl(), tmp_path, 0) as url:
        client = HapticClient(url.partition("?")[0] + "?token=wrong")
        with pytest.raises(HapticError) as refused:
            STREAMS[stream](client)
    assert refused.value.code == "no_token"


@pytest.mark.parametrize("stream", STREAMS)
def test_a_stream_that_a_crowded_daemon_refuses_is_said_to_be_so(tmp_path, monkeypatch, stream):
    monkeypatch.setattr(server, "MOST_AT_ONCE", 0)
    with serving(BenchControl(), tmp_path):
        client = HapticClient(tmp_path / "d.sock")
        with pytest.raises(HapticError) as refused:
            STREAMS[stream](client)
    assert refused.value.code == "busy"


def test_a_held_lease_changes_its_scene_over_one_channel(control, tmp_path):
    """A connection for each change took 24 ms on a slow machine, of 17 ms that a frame lasts."""
    with HapticClient(tmp_path / "d.sock") as client, client.armed(5.0) as session:
        session.scene.add("key", circle(10.0, 5.0, 4.0), 0.7)
        line = session._channel
        session.scene.move("key", 12.0, 5.0)
        assert session._channel is line
        assert control.scene.object[0].origin_mm == [12.0, 5.0]
        client.off()
        assert control.machine.state is DaemonState.ARMED


def test_an_answer_that_came_too_late_is_not_taken_for_the_next(control, tmp_path, monkeypatch):
    held = Held(control.scene_shown)
    monkeypatch.setattr(control, "scene_shown", held)
    with HapticClient(tmp_path / "d.sock") as client, client.channel() as channel:
        monkeypatch.setattr("haptic_driver.client.TIMEOUT_S", 0.1)
        with pytest.raises(NoDaemonError):
            channel.scene_shown()
        held.let_go.set()
        monkeypatch.setattr("haptic_driver.client.TIMEOUT_S", 30.0)
        assert channel.arm(5.0).lease_s == 5.0
        assert channel.off().state is DaemonState.ARMED
